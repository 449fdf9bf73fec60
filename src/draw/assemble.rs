//! From a frame's input to draws: what every view draws of every instance, and the parameters that shaders take for it.

use crate::gpu::layout::DrawParams;
use crate::host::{FrameInput, Instance};
use crate::select::{DrawList, Sight, Slabs, View, cut};
use crate::structure::flat::Block;
use crate::structure::packing::Packed;
use crate::style::{Ellipse, Voronoi};
use crate::technique::Selection;

use super::area::Area;
use super::cloud::DeviceCloud;
use super::faces::face_runs;
use super::large::{may_hold_large, whole_in_front};
use super::list::Listing;
use super::params::{Camera, scale};
use super::patches::{Seen, Shown};
use super::plan::{CloudTraits, FramePlan};
use super::slot::PARAMS_STRIDE;
use super::splats::{Draw, Run, runs};
use super::targets::TargetPlan;
use super::variant::{Large, Role, Variant};

/// What decides, the same for all views.
pub struct Scene<'a> {
    /// What the host asks for.
    pub input: &'a FrameInput<'a>,
    /// What that becomes.
    pub plan: &'a FramePlan,
    /// Attachments that there are.
    pub targets: TargetPlan,
    /// Largest sprite \[px\]; the greatest float with quads.
    pub sprite_limit: f64,
    /// A camera a view.
    pub cameras: &'a [Camera],
}

/// All of a frame's draws.
#[derive(Default)]
pub struct Assembly {
    /// View by view, instance by instance.
    pub views: Vec<Vec<Draw>>,
    /// Parameters, in the same order.
    pub params: Vec<DrawParams>,
    /// What is compacted.
    pub listing: Listing,
    /// What of the picture all of it can reach, in any view.
    pub area: Area,
}

impl Scene<'_> {
    /// A view as an instance's cloud sees it.
    pub fn sight(&self, view: &View, instance: &Instance, cloud: &DeviceCloud) -> Sight {
        let extent = [self.input.extent.width, self.input.extent.height];
        Sight::new(view, extent, &instance.transform, cloud.flat().origin, self.input.style)
    }

    /// What is known of a cloud in one view: closed only where the eye is outside it.
    pub fn traits(&self, camera: &Camera, instance: &Instance, cloud: &DeviceCloud) -> CloudTraits {
        let (matrix, scale) = camera.eye_from_cloud(&instance.transform, cloud.flat().origin);
        let radius_scale = self.input.style.radius_scale as f64 * scale;
        let mut traits = cloud.traits();
        traits.closed = traits.closed && whole_in_front(cloud.cloud.surface(), camera, &matrix, radius_scale);
        traits
    }

    /// What this frame shows of one cloud, and whether what faces away is culled in all of that.
    pub fn sights(&self, cloud: &DeviceCloud, shows: impl Fn(&Instance) -> bool) -> (Vec<(Seen, Sight)>, bool) {
        let mut culled = true;
        let mut sights = Vec::new();
        for (v, (camera, view)) in self.cameras.iter().zip(self.input.views).enumerate() {
            for (i, instance) in self.input.instances.iter().enumerate().filter(|(_, i)| shows(i)) {
                culled &= self.plan.culls(self.input.style, &self.traits(camera, instance, cloud));
                sights.push((Seen { view: v, instance: i }, self.sight(view, instance, cloud)));
            }
        }
        (sights, culled)
    }

    /// Everything. `clouds`: those of the instances, in their order.
    pub fn assemble(&self, clouds: &[&DeviceCloud]) -> Assembly {
        let mut all = Assembly::default();
        for (number, camera) in self.cameras.iter().enumerate() {
            let slabs = match self.plan.voronoi {
                Voronoi::Slabs => {
                    let drawn = clouds.iter().zip(self.input.instances).map(|(c, i)| (c.flat(), i.transform));
                    Some(Slabs::new(&self.input.views[number], self.input.style, drawn))
                }
                Voronoi::Cones | Voronoi::Off => None,
            };
            let instances = 0..clouds.len();
            let draws =
                instances.map(|i| self.draw([number, i], camera, clouds[i], slabs.as_ref(), &mut all)).collect();
            all.views.push(draws);
        }
        all
    }

    fn draw(
        &self,
        [view, instance]: [usize; 2],
        camera: &Camera,
        cloud: &DeviceCloud,
        slabs: Option<&Slabs>,
        all: &mut Assembly,
    ) -> Draw {
        let Scene { input, plan, targets, sprite_limit, .. } = self;
        let (seen, style, flat) = (&input.instances[instance], input.style, cloud.flat());
        let sight = self.sight(&input.views[view], seen, cloud);
        let block = self.params(camera, seen, cloud, &sight, slabs);
        let traits = self.traits(camera, seen, cloud);
        let (matrix, _) = camera.eye_from_cloud(&seen.transform, flat.origin);
        let radius_scale = style.radius_scale as f64 * scale(&seen.transform);
        // A point of a given size is a sprite or, with quads, a quad: never cast.
        let may_be_large = |block: &Block| {
            let low_pass = style.low_pass as f64;
            !plan.pixels && may_hold_large(block, camera, &matrix, radius_scale, low_pass, input.extent, *sprite_limit)
        };
        let mut reach = |block: &Block| {
            // The affine approximation of a disc is larger than the disc on its far side, by less than half where it is drawn so.
            let grown = if style.ellipse == Ellipse::Approximate { 1.5 } else { 1.0 };
            all.area.add(block, camera, &matrix, grown * style.radius_scale as f64, style.footprint_margin());
        };
        let mut list = DrawList::default();
        let Shown { runs: submitted, doubtful, tests, balls } = match &cloud.patches {
            Some(patches) => patches.shown(Seen { view, instance }, |block| {
                reach(block);
                may_be_large(block)
            }),
            None => {
                cut::cut(&cloud.cloud, &sight, style, plan.culls(style, &traits), 0, &mut list);
                if !list.spans.is_empty() {
                    reach(&Block { radius: cloud.bounds.radius.max(list.least()), ..cloud.bounds });
                }
                if !list.triangles.is_empty() {
                    cloud.cloud.triangles().iter().flat_map(|faces| &faces.blocks).for_each(reach);
                }
                Shown { runs: resident_runs(cloud, &list, may_be_large), ..Shown::default() }
            }
        };
        let lens = camera.lens(input.extent);
        let variant = |large| Variant::new(Role::Visibility, plan, style, &traits, targets, large, lens);
        let main = variant(Large::Never);
        let params = (all.params.len() as u64 * PARAMS_STRIDE) as u32;
        all.params.push(block);
        let listed = main.test.is_some() && input.technique.selection == Selection::Compute;
        let drawn = if listed {
            let alike = |a: &Run, b: &Run| (a.chunk, a.large) == (b.chunk, b.large);
            let range = |part: &[Run]| Run {
                range: Some(all.listing.add([instance, part[0].chunk], params, main.test, part)),
                count: part.iter().map(|r| r.count).sum(),
                ..part[0]
            };
            submitted.chunk_by(alike).map(range).collect()
        } else {
            submitted.clone()
        };
        Draw {
            cloud: instance,
            params,
            submitted,
            runs: drawn,
            doubtful,
            tests,
            balls,
            test: main.test,
            main: main.of_list(listed),
            // Where the order counts, what a sprite cannot hold must not come after everything else.
            large: variant(if plan.ordered.is_some() { Large::Too } else { Large::Only }).of_list(listed),
            faces: face_runs(&list.triangles, cloud.resident_faces()),
            // Behind the groups' own layers.
            triangles: (main.of_triangles(), plan.layers.saturating_sub(1)),
        }
    }

    fn params(
        &self,
        camera: &Camera,
        instance: &Instance,
        cloud: &DeviceCloud,
        sight: &Sight,
        slabs: Option<&Slabs>,
    ) -> DrawParams {
        let (input, flat) = (self.input, cloud.flat());
        let mut block = camera.draw_params(
            input.extent,
            &instance.transform,
            (flat.origin, &cloud.bounds),
            input.style,
            self.plan.disc,
            self.sprite_limit.min(3e38) as f32,
        );
        if let Some(slabs) = slabs {
            block.slab_near = slabs.near as f32;
            block.slab_thickness = slabs.thickness as f32;
            block.slab_count = slabs.count as f32;
        }
        let test = sight.test();
        (block.test_eye, block.tau) = (test.eye, test.tau);
        if let Some(radii) = flat.packed.as_ref().map(Packed::radii) {
            (block.radius_most, block.radius_step) = (radii.most, radii.step);
        }
        block.slot_shift = cloud.patches.as_ref().map_or(0, |patches| patches.shift());
        block
    }
}

/// Spans of a cloud that is here as a whole, as runs.
fn resident_runs(cloud: &DeviceCloud, list: &DrawList, may_be_large: impl Fn(&Block) -> bool) -> Vec<Run> {
    if list.spans.is_empty() {
        return Vec::new();
    }
    let blocks = &cloud.flat().blocks;
    let least = list.least();
    // A radius that is nowhere too large: most blocks are done with by that alone.
    let whole =
        |halvings: i32| Block { radius: cloud.bounds.radius.max(least) * 0.5f32.powi(halvings), ..cloud.bounds };
    let small = (0..16).map(whole).find(|b| !may_be_large(b)).map_or(0.0, |b| b.radius);
    let widened = |b: &Block| Block { radius: b.radius.max(least), ..*b };
    let is_large = |b: &Block| b.radius > small && may_be_large(b);
    let large: Vec<u32> = (0..).zip(blocks).filter(|(_, b)| is_large(&widened(b))).map(|(i, _)| i).collect();
    let chunks: Vec<[u32; 2]> = cloud.chunks.iter().map(|c| [c.first, c.count]).collect();
    runs(&list.spans, &chunks, blocks, &large)
}
