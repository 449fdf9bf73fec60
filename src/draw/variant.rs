//! Pipelines of the splat passes, by what distinguishes them.

use std::collections::HashMap;

use ash::vk;

use crate::error::Result;
use crate::gpu::ordered::OrderedPass;
use crate::gpu::program::{BlendMode, ColorTarget, DepthMode, GraphicsInfo, Program, Stream};
use crate::gpu::spirv::{Shader, generated as spirv};
use crate::gpu::{Context, Enabled, Interlock};
use crate::stats::OrderedAccess;
use crate::structure::Packing;
use crate::structure::nodes::ErrorRule;
use crate::style::{Ellipse, Front, Interval, Style, SumPrecision, Voronoi};
use crate::technique::Blend;

use super::layers::LAYER_DEPTH;
use super::params::Lens;
use super::plan::{CloudTraits, FramePlan};
use super::targets::{DEPTH, FRONT, SURFACE, TargetPlan, sums_format};

/// Shaders that share the splats' layout, as far as the host enabled what they need: set 0 parameters, set 1 a chunk, set 2
/// counters, set 3 attachments that are read, set 4 the same as storage.
pub fn shaders(enabled: &Enabled) -> Vec<&'static Shader> {
    let mut shaders = vec![
        &spirv::DRAW_POINT_VERT,
        &spirv::DRAW_QUAD_VERT,
        &spirv::DRAW_VISIBILITY_FRAG,
        &spirv::DRAW_ACCUMULATE_FRAG,
        &spirv::DRAW_ACCUMULATE_SURFACE_FRAG,
        &spirv::DRAW_TRIANGLE_VERT,
        &spirv::DRAW_VISIBILITY_FRAG_TRIANGLE,
        &spirv::DRAW_ACCUMULATE_FRAG_TRIANGLE,
        &spirv::DRAW_ACCUMULATE_SURFACE_FRAG_TRIANGLE,
        &spirv::DRAW_OCCLUSION_VERT,
        &spirv::DRAW_OCCLUSION_FRAG,
        &spirv::SELECT_COUNT_COMP,
        &spirv::SELECT_MARK_COMP,
        &spirv::SELECT_SCAN_COMP,
        &spirv::SELECT_LIST_COMP,
    ];
    if enabled.rasterization_order {
        shaders.extend([
            &spirv::DRAW_FUZZY_FRAG,
            &spirv::DRAW_FUZZY_SURFACE_FRAG,
            &spirv::DRAW_FUZZY_FRAG_TRIANGLE,
            &spirv::DRAW_FUZZY_SURFACE_FRAG_TRIANGLE,
        ]);
    }
    shaders.extend(interlock(enabled).into_iter().flatten());
    if enabled.output_layer {
        shaders.extend([
            &spirv::DRAW_POINT_LAYERED_VERT,
            &spirv::DRAW_QUAD_LAYERED_VERT,
            &spirv::DRAW_GROUPS_FRAG,
            &spirv::DRAW_GROUPS_SURFACE_FRAG,
            &spirv::DRAW_TRIANGLE_LAYERED_VERT,
            &spirv::DRAW_GROUPS_FRAG_TRIANGLE,
            &spirv::DRAW_GROUPS_SURFACE_FRAG_TRIANGLE,
        ]);
    }
    shaders
}

/// Of splats and of triangles.
fn interlock(enabled: &Enabled) -> Option<[&'static Shader; 2]> {
    match enabled.interlock {
        Interlock::Absent => None,
        Interlock::Pixel => Some([&spirv::DRAW_FUZZY_INTERLOCK_FRAG, &spirv::DRAW_FUZZY_INTERLOCK_FRAG_TRIANGLE]),
        Interlock::Implicit => Some([&spirv::DRAW_FUZZY_IMPLICIT_FRAG, &spirv::DRAW_FUZZY_IMPLICIT_FRAG_TRIANGLE]),
    }
}

/// Vertex streams in the order of `Chunk::streams`; only `draw/point_layered.vert` reads the last one. A quantised place is
/// read as fractions, which the shader turns back: whole numbers would need another type of attribute than floats.
fn streams(packing: Packing) -> [Stream; 4] {
    let (geometry, normals) = match packing {
        Packing::Full => ((16, vk::Format::R32G32B32A32_SFLOAT), (4, vk::Format::R32_UINT)),
        Packing::Exact => ((12, vk::Format::R32G32B32_SFLOAT), (2, vk::Format::R16_UINT)),
        Packing::Quantised => ((4, vk::Format::A2B10G10R10_UNORM_PACK32), (1, vk::Format::R8_UINT)),
    };
    [geometry, normals, (4, vk::Format::R32_UINT), (1, vk::Format::R8_UINT)]
        .map(|(stride, format)| Stream { stride, format })
}

/// Which pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Role {
    /// Least z + ε, depth alone.
    Visibility,
    /// Sums of what lies within the tolerance.
    Accumulate,
    /// The nearest fragment.
    Opaque,
    /// Ordered depth test and blending, attachments or storage images.
    Fuzzy(OrderedAccess),
    /// One layer a group.
    Groups,
    /// Balls that are tested, depth alone and not written.
    Occlusion,
    /// Counting: compute.
    Count,
    /// Compaction: three compute passes.
    Compact(Step),
}

/// One of the passes of compaction, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Step {
    /// Which points.
    Mark,
    /// How many before each tile.
    Scan,
    /// Their numbers.
    List,
}

/// A pipeline's key: the specialisation constants of `glsl/shared/params.glsl`, and the fixed state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Variant {
    /// Which pass.
    pub role: Role,
    /// Quads pulled from storage, not point primitives.
    pub quads: bool,
    /// Faces, pulled from storage; neither sprites nor quads.
    pub triangles: bool,
    /// FOOTPRINT.
    pub footprint: u32,
    /// APPROXIMATE.
    pub approximate: bool,
    /// CULL_BACK.
    pub cull: bool,
    /// HAS_NORMAL.
    pub normals: bool,
    /// HAS_COLOR.
    pub colors: bool,
    /// LARGE.
    pub large: Large,
    /// PERSPECTIVE and PAIRS.
    pub lens: Lens,
    /// VORONOI.
    pub voronoi: Voronoi,
    /// FRONT_FIRST.
    pub front: Front,
    /// The last attachment, of normals and what else light or depth need, is there.
    pub surface: bool,
    /// Precision of the sums of colours.
    pub sums: SumPrecision,
    /// INTERVAL and RULE: what is tested point by point, where that is not left to compaction.
    pub test: Option<(Interval, ErrorRule)>,
    /// LISTED, for quads; point primitives have the list as their indices.
    pub listed: bool,
    /// PACKING.
    pub packing: Packing,
    /// LAYERED.
    pub layered: bool,
}

/// What becomes of splats that a sprite cannot hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum Large {
    /// They are left out.
    Never = 0,
    /// Nothing else is drawn: after the others.
    Only = 1,
    /// Everything is drawn, in stored order.
    Too = 2,
}

impl Variant {
    /// The variant that draws a cloud in a pass. `large` unless never: as quads.
    pub fn new(
        role: Role,
        plan: &FramePlan,
        style: &Style,
        cloud: &CloudTraits,
        targets: &TargetPlan,
        large: Large,
        lens: Lens,
    ) -> Variant {
        Variant {
            role,
            quads: plan.quads || large != Large::Never,
            triangles: false,
            footprint: if plan.pixels { 2 } else { plan.disc as u32 },
            approximate: style.ellipse == Ellipse::Approximate,
            cull: plan.culls(style, cloud),
            normals: cloud.normals,
            colors: cloud.colors,
            large,
            lens,
            voronoi: plan.voronoi,
            front: style.front,
            surface: if plan.blend == Blend::Groups { plan.lit } else { targets.surface },
            sums: plan.sums,
            test: cloud.rule.map(|rule| (style.interval, rule)),
            listed: false,
            packing: cloud.packing,
            layered: cloud.layered,
        }
    }

    /// The variant that counts what this one draws, each point tested as `test` says.
    pub fn count(self, test: Option<(Interval, ErrorRule)>) -> Variant {
        Variant { role: Role::Count, test, listed: false, ..self }
    }

    /// The variant of a compute pass: nothing else tells them apart.
    pub fn compute(test: Option<(Interval, ErrorRule)>, packing: Packing, step: Step) -> Variant {
        Variant {
            test: if step == Step::Mark { test } else { None },
            packing: if step == Step::Mark { packing } else { Packing::Full },
            ..Variant::plain(Role::Compact(step))
        }
    }

    /// The variant of a role that nothing else tells apart.
    pub fn plain(role: Role) -> Variant {
        Variant {
            role,
            quads: false,
            triangles: false,
            footprint: 0,
            approximate: false,
            cull: false,
            normals: false,
            colors: false,
            large: Large::Never,
            lens: Lens::default(),
            voronoi: Voronoi::Off,
            front: Front::Nearest,
            surface: false,
            sums: SumPrecision::Single,
            test: None,
            listed: false,
            packing: Packing::Full,
            layered: false,
        }
    }

    /// The variant that draws the triangles of the same cloud: what makes no difference to them is off.
    pub fn of_triangles(self) -> Variant {
        Variant {
            quads: false,
            triangles: true,
            footprint: 0,
            approximate: false,
            large: Large::Never,
            lens: self.lens.single(),
            voronoi: Voronoi::Off,
            test: None,
            listed: false,
            ..self
        }
    }

    /// The variant that tests the same cloud's balls.
    pub fn of_balls(self) -> Variant {
        Variant { lens: self.lens.single(), ..Variant::plain(Role::Occlusion) }
    }

    /// The same for points whose numbers compaction has listed.
    pub fn of_list(self, listed: bool) -> Variant {
        if listed { Variant { listed, test: None, ..self } } else { self }
    }

    fn build(&self, context: &Context, program: &Program, passes: &mut OrderedPasses) -> Result<vk::Pipeline> {
        let constants = [
            self.footprint,
            self.approximate as u32,
            self.cull as u32,
            self.normals as u32,
            // Depth alone needs no colour, so its decoding is left out.
            (self.colors && self.role != Role::Visibility) as u32,
            self.large as u32,
            (self.large != Large::Never || self.role == Role::Count) as u32,
            self.lens.pairs as u32,
            match self.voronoi {
                Voronoi::Off => 0,
                Voronoi::Cones => 1,
                Voronoi::Slabs => 2,
            },
            (self.front == Front::First) as u32,
            self.surface as u32,
            match self.test.map(|(interval, _)| interval) {
                None => 0,
                Some(Interval::Exact) => 1,
                Some(Interval::Published) => 2,
            },
            self.test.map_or(0, |(_, rule)| rule as u32),
            (self.listed && self.quads) as u32,
            match self.packing {
                Packing::Full => 0,
                Packing::Exact => 1,
                // Radii lie elsewhere where there are both.
                Packing::Quantised => 2 + (self.normals && self.colors) as u32,
            },
            self.layered as u32,
            self.lens.perspective as u32,
        ];
        let sum = ColorTarget { format: sums_format(self.sums), blend: BlendMode::Replace };
        let surface = ColorTarget { format: SURFACE, blend: BlendMode::Replace };
        let front = ColorTarget { format: FRONT, blend: BlendMode::Replace };
        let with_surface = |mut colors: Vec<ColorTarget>| {
            colors.extend(self.surface.then_some(surface));
            colors
        };
        let depth = |format, compare, write, mark_hidden| Some(DepthMode { format, compare, write, mark_hidden });
        let form = |[splat, triangle]: [&'static Shader; 2]| if self.triangles { triangle } else { splat };
        let accumulate = form(match self.surface {
            true => [&spirv::DRAW_ACCUMULATE_SURFACE_FRAG, &spirv::DRAW_ACCUMULATE_SURFACE_FRAG_TRIANGLE],
            false => [&spirv::DRAW_ACCUMULATE_FRAG, &spirv::DRAW_ACCUMULATE_FRAG_TRIANGLE],
        });
        let (greater, not_less) = (vk::CompareOp::GREATER, vk::CompareOp::GREATER_OR_EQUAL);
        let mut pass = None;
        let (name, fragment, colors, depth): (_, &Shader, Vec<ColorTarget>, _) = match self.role {
            Role::Count => return program.compute(context, "count", &spirv::SELECT_COUNT_COMP, &constants),
            Role::Compact(step) => {
                let (name, shader) = match step {
                    Step::Mark => ("mark", &spirv::SELECT_MARK_COMP),
                    Step::Scan => ("scan", &spirv::SELECT_SCAN_COMP),
                    Step::List => ("list", &spirv::SELECT_LIST_COMP),
                };
                return program.compute(context, name, shader, &constants);
            }
            Role::Occlusion => ("occlusion", &spirv::DRAW_OCCLUSION_FRAG, vec![], depth(DEPTH, not_less, false, false)),
            Role::Visibility => {
                let shaders = [&spirv::DRAW_VISIBILITY_FRAG, &spirv::DRAW_VISIBILITY_FRAG_TRIANGLE];
                ("visibility", form(shaders), vec![], depth(DEPTH, greater, true, false))
            }
            Role::Accumulate => {
                let mut colors = with_surface(vec![ColorTarget { blend: BlendMode::Add, ..sum }]);
                colors.iter_mut().skip(1).for_each(|c| c.blend = BlendMode::AddMax);
                ("accumulate", accumulate, colors, depth(DEPTH, not_less, false, true))
            }
            Role::Opaque => ("opaque", accumulate, with_surface(vec![sum]), depth(DEPTH, greater, true, false)),
            Role::Fuzzy(OrderedAccess::RasterizationOrder) => {
                pass = Some(passes.get(context, self.sums, self.surface)?);
                let shader = form(match self.surface {
                    true => [&spirv::DRAW_FUZZY_SURFACE_FRAG, &spirv::DRAW_FUZZY_SURFACE_FRAG_TRIANGLE],
                    false => [&spirv::DRAW_FUZZY_FRAG, &spirv::DRAW_FUZZY_FRAG_TRIANGLE],
                });
                ("fuzzy", shader, with_surface(vec![sum, front]), None)
            }
            Role::Fuzzy(OrderedAccess::Interlock) => {
                let shader = interlock(&context.enabled).expect("planned only where it is enabled");
                ("fuzzy", form(shader), vec![], None)
            }
            Role::Groups => {
                let shader = form(match self.surface {
                    true => [&spirv::DRAW_GROUPS_SURFACE_FRAG, &spirv::DRAW_GROUPS_SURFACE_FRAG_TRIANGLE],
                    false => [&spirv::DRAW_GROUPS_FRAG, &spirv::DRAW_GROUPS_FRAG_TRIANGLE],
                });
                ("groups", shader, with_surface(vec![sum, front]), depth(LAYER_DEPTH, greater, true, false))
            }
        };
        let pulled = self.quads || self.triangles || self.role == Role::Occlusion;
        let vertex = match (self.role == Role::Groups, self.quads) {
            _ if self.role == Role::Occlusion => &spirv::DRAW_OCCLUSION_VERT,
            (false, _) if self.triangles => &spirv::DRAW_TRIANGLE_VERT,
            (true, _) if self.triangles => &spirv::DRAW_TRIANGLE_LAYERED_VERT,
            (false, false) => &spirv::DRAW_POINT_VERT,
            (false, true) => &spirv::DRAW_QUAD_VERT,
            (true, false) => &spirv::DRAW_POINT_LAYERED_VERT,
            (true, true) => &spirv::DRAW_QUAD_LAYERED_VERT,
        };
        let streams = &streams(self.packing)[..if self.role == Role::Groups { 4 } else { 3 }];
        program.graphics(
            context,
            &GraphicsInfo {
                name,
                vertex,
                fragment,
                constants: &constants,
                streams: if pulled { &[] } else { streams },
                topology: if pulled { vk::PrimitiveTopology::TRIANGLE_LIST } else { vk::PrimitiveTopology::POINT_LIST },
                colors: &colors,
                depth,
                samples: vk::SampleCountFlags::TYPE_1,
                view_mask: 0,
                render_pass: pass.map(|pass: OrderedPass| (pass.clear, 0)),
                ordered: pass.is_some(),
            },
        )
    }
}

/// Render passes of `fuzzy`, by precision of the sums and whether there are normals: made when first needed.
#[derive(Debug, Default)]
pub struct OrderedPasses {
    made: HashMap<(SumPrecision, bool), OrderedPass>,
}

impl OrderedPasses {
    /// One that clears, for pipelines and targets.
    pub fn get(&mut self, context: &Context, sums: SumPrecision, surface: bool) -> Result<OrderedPass> {
        if let Some(pass) = self.made.get(&(sums, surface)) {
            return Ok(*pass);
        }
        let formats = [sums_format(sums), FRONT, SURFACE];
        let pass = context.ordered_pass(if surface { &formats } else { &formats[..2] })?;
        self.made.insert((sums, surface), pass);
        Ok(pass)
    }
}

/// Pipelines built so far.
#[derive(Debug, Default)]
pub struct Pipelines {
    built: HashMap<Variant, vk::Pipeline>,
    /// What those of `fuzzy` are built for.
    pub passes: OrderedPasses,
}

impl Pipelines {
    /// Builds the variant if it is new, and says whether it was.
    pub fn ensure(&mut self, context: &Context, program: &Program, variant: Variant) -> Result<bool> {
        if self.built.contains_key(&variant) {
            return Ok(false);
        }
        let pipeline = variant.build(context, program, &mut self.passes)?;
        self.built.insert(variant, pipeline);
        Ok(true)
    }

    /// A variant that was ensured.
    pub fn get(&self, variant: &Variant) -> vk::Pipeline {
        self.built[variant]
    }

    /// Destroys them all; none is in use.
    pub fn destroy(self, context: &Context) {
        self.built.into_values().for_each(|pipeline| context.destroy_pipeline(pipeline));
        self.passes.made.into_values().for_each(|pass| context.destroy_ordered_pass(pass));
    }
}
