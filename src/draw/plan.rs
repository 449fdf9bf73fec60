//! What a frame will run, as a pure function of its input: no Vulkan call, testable at every edge.

use crate::stats::{OrderedAccess, Skip};
use crate::structure::Packing;
use crate::structure::nodes::ErrorRule;
use crate::style::{BackFaces, Footprint, Shading, Style, SumPrecision, Voronoi};
use crate::technique::{Blend, Primitive, Technique};

/// What is known of a cloud before it is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CloudTraits {
    /// It has normals.
    pub normals: bool,
    /// It has colours.
    pub colors: bool,
    /// See `PointCloud::closed`.
    pub closed: bool,
    /// Number of groups, and whether splats of one may overlap.
    pub groups: Option<(u32, bool)>,
    /// What is tested point by point, if anything is.
    pub rule: Option<ErrorRule>,
    /// It has faces besides points.
    pub triangles: bool,
    /// How many bytes its points have.
    pub packing: Packing,
    /// Its points come in patches, with radii from a cut.
    pub layered: bool,
}

/// What the host has that decides: all but the frame itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surroundings {
    /// The host's pass has a depth attachment.
    pub depth_target: bool,
    /// The host's own geometry hides what is behind it.
    pub host_depth: bool,
    /// Largest point size \[px\], 1 where `largePoints` is not enabled.
    pub sprite_limit: f32,
    /// How `fuzzy` can be drawn.
    pub ordered: Option<OrderedAccess>,
    /// `groups` can be drawn.
    pub output_layer: bool,
}

/// What a frame runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FramePlan {
    /// What is drawn: the blend that was asked for, unless the host cannot.
    pub blend: Blend,
    /// How `fuzzy` is drawn; `None` for other blends.
    pub ordered: Option<OrderedAccess>,
    /// Precision of the sums.
    pub sums: SumPrecision,
    /// Layers of `groups`; 0 for other blends.
    pub layers: u32,
    /// What decides within a layer of `groups`; `Off` where no group overlaps itself, and for other blends.
    pub voronoi: Voronoi,
    /// Sums of normals are lit.
    pub lit: bool,
    /// The front's depth leaves the splat passes.
    pub front: bool,
    /// Quads are drawn for everything.
    pub quads: bool,
    /// Footprints are hard discs.
    pub disc: bool,
    /// Footprints are squares of a given size.
    pub pixels: bool,
    /// What is not run, and why.
    pub skipped: Vec<Skip>,
}

impl FramePlan {
    /// Decides for one frame.
    pub fn new(
        technique: &Technique,
        style: &Style,
        clouds: &[CloudTraits],
        &Surroundings { depth_target, host_depth, sprite_limit, ordered, output_layer }: &Surroundings,
    ) -> FramePlan {
        let mut skipped = Vec::new();
        let mut skip = |stage, reason| skipped.push(Skip { stage, reason });
        let blend = match technique.blend {
            Blend::Fuzzy if ordered.is_none() => {
                skip("fuzzy", "neither rasterization-order access nor interlock is enabled: two-pass is drawn");
                Blend::TwoPass
            }
            Blend::Groups if !output_layer => {
                skip("groups", "shaderOutputLayer is not enabled: two-pass is drawn");
                Blend::TwoPass
            }
            blend => blend,
        };
        let ordered = ordered.filter(|_| blend == Blend::Fuzzy);
        let mut sums = style.sums;
        if ordered == Some(OrderedAccess::Interlock) && sums != SumPrecision::Single {
            skip("half sums", "the interlock's storage images have one format, in single precision");
            sums = SumPrecision::Single;
        }
        let (mut layers, mut voronoi) = (0, Voronoi::Off);
        if blend == Blend::Groups {
            let groups = || clouds.iter().filter_map(|c| c.groups);
            layers = groups().map(|(count, _)| count).max().unwrap_or(0).max(1);
            // Faces do not overlap each other, and splats may lie on them.
            layers += clouds.iter().any(|c| c.triangles) as u32;
            voronoi = style.voronoi;
            if voronoi == Voronoi::Off {
                skip("voronoi depth", "not asked for");
            } else if !groups().any(|(_, overlapping)| overlapping) {
                skip("voronoi depth", "no group overlaps itself");
                voronoi = Voronoi::Off;
            }
        }
        let opaque = blend == Blend::Opaque;
        let pixels = opaque && matches!(style.footprint, Footprint::Pixels(_));

        let lit = if style.shading == Shading::None {
            skip("normals", "no shading asked for");
            false
        } else if !clouds.iter().any(|c| c.normals) {
            skip("normals", "no cloud has normals: every splat faces the viewer and is fully lit");
            false
        } else {
            true
        };
        let front = depth_target || style.eye_dome.is_some();
        if !front {
            skip("front depth", "no depth target and no eye-dome lighting");
        }
        if !lit && !front {
            skip("surface attachment", "neither light nor the front's depth is needed");
        }
        if style.eye_dome.is_none() {
            skip("eye-dome lighting", "not asked for");
        }
        if !host_depth {
            skip("host depth", "the host has no depth to be hidden by");
        }
        match blend {
            Blend::Opaque => skip("visibility", "opaque: the depth test alone decides"),
            Blend::Fuzzy => skip("visibility", "fuzzy: every fragment is tested where it is blended"),
            Blend::Groups => skip("visibility", "groups: every layer has its front"),
            Blend::TwoPass => {}
        }
        if !clouds.iter().any(|c| c.colors) {
            skip("colours", "no cloud has colours: the base colour is used");
        }
        // With the margin of glsl/shared/splat.glsl.
        let too_wide = matches!(style.footprint, Footprint::Pixels(side) if opaque && side + 0.25 > sprite_limit);
        let quads = technique.primitive == Primitive::Quad || sprite_limit <= 1.0 || too_wide;
        if quads && technique.primitive == Primitive::Point {
            let reason = if too_wide {
                "wider than the largest point: quads are drawn"
            } else {
                "largePoints is not enabled: quads are drawn"
            };
            skip("point sprites", reason);
        }
        FramePlan { blend, ordered, sums, layers, voronoi, lit, front, quads, disc: opaque && !pixels, pixels, skipped }
    }

    /// Whether the attachment of normals and the front's depth is needed. `fuzzy` has the depth elsewhere.
    pub fn surface(&self) -> bool {
        self.lit || (self.front && self.ordered.is_none())
    }

    /// Whether splats of this cloud that face away are dropped.
    pub fn culls(&self, style: &Style, cloud: &CloudTraits) -> bool {
        cloud.normals
            && match style.back_faces {
                BackFaces::Auto => cloud.closed,
                BackFaces::Draw => false,
                BackFaces::Cull => true,
            }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCAN: CloudTraits = CloudTraits {
        normals: true,
        colors: true,
        closed: false,
        groups: None,
        rule: None,
        triangles: false,
        packing: Packing::Full,
        layered: false,
    };
    const ALL: Surroundings = Surroundings {
        depth_target: true,
        host_depth: true,
        sprite_limit: 255.0,
        ordered: Some(OrderedAccess::RasterizationOrder),
        output_layer: true,
    };

    fn blend(blend: Blend) -> Technique {
        Technique { blend, ..Technique::default() }
    }

    fn plan(style: &Style, clouds: &[CloudTraits], depth: bool) -> FramePlan {
        let given = Surroundings { depth_target: depth, host_depth: false, ..ALL };
        FramePlan::new(&blend(Blend::TwoPass), style, clouds, &given)
    }

    fn skips(plan: &FramePlan, stage: &str) -> bool {
        plan.skipped.iter().any(|s| s.stage == stage)
    }

    #[test]
    fn every_skip_has_its_scene() {
        let style = Style::default();
        let full = Style { eye_dome: Some(Default::default()), ..style };
        let all = FramePlan::new(&blend(Blend::TwoPass), &full, &[SCAN], &ALL);
        assert_eq!(all.skipped, [], "this scene needs everything");
        assert!(all.lit && all.front && !all.quads);

        assert!(skips(&plan(&Style { shading: Shading::None, ..style }, &[SCAN], true), "normals"));
        assert!(skips(&plan(&style, &[CloudTraits { normals: false, ..SCAN }], true), "normals"));
        assert!(skips(&plan(&style, &[SCAN], false), "front depth"));
        assert!(!skips(&plan(&full, &[SCAN], false), "front depth"));
        assert!(skips(&plan(&style, &[CloudTraits { colors: false, ..SCAN }], true), "colours"));
        assert!(skips(&plan(&style, &[], true), "normals"));
        for one_pass in [Blend::Opaque, Blend::Fuzzy, Blend::Groups] {
            assert!(skips(&FramePlan::new(&blend(one_pass), &style, &[SCAN], &ALL), "visibility"));
        }
        let given = Surroundings { sprite_limit: 1.0, ..ALL };
        let small = FramePlan::new(&blend(Blend::TwoPass), &style, &[SCAN], &given);
        assert!(small.quads && skips(&small, "point sprites"));
    }

    #[test]
    fn what_the_host_cannot_is_two_pass() {
        let style = Style::default();
        let none = Surroundings { ordered: None, output_layer: false, ..ALL };
        for wanted in [Blend::Fuzzy, Blend::Groups] {
            let given = FramePlan::new(&blend(wanted), &style, &[SCAN], &ALL);
            assert_eq!((given.blend, skips(&given, wanted.name())), (wanted, false));
            let fallen = FramePlan::new(&blend(wanted), &style, &[SCAN], &none);
            assert_eq!((fallen.blend, fallen.ordered, fallen.layers), (Blend::TwoPass, None, 0));
            assert!(skips(&fallen, wanted.name()) && !skips(&fallen, "visibility"));
        }
        assert_eq!(plan(&style, &[SCAN], true).ordered, None, "two-pass needs no order");
        let half = Style { sums: SumPrecision::Half, ..style };
        for (ordered, sums) in
            [(OrderedAccess::Interlock, SumPrecision::Single), (OrderedAccess::RasterizationOrder, SumPrecision::Half)]
        {
            let given = Surroundings { ordered: Some(ordered), ..ALL };
            let plan = FramePlan::new(&blend(Blend::Fuzzy), &half, &[SCAN], &given);
            assert_eq!((plan.sums, skips(&plan, "half sums")), (sums, sums == SumPrecision::Single));
        }
    }

    #[test]
    fn layers_are_the_most_groups_and_voronoi_is_for_overlap() {
        let cloud = |count, overlapping| CloudTraits { groups: Some((count, overlapping)), ..SCAN };
        let plan = |clouds: &[CloudTraits], style: &Style| FramePlan::new(&blend(Blend::Groups), style, clouds, &ALL);
        let style = Style::default();
        let both = plan(&[cloud(5, false), cloud(7, true)], &style);
        assert_eq!((both.layers, both.voronoi), (7, Voronoi::Cones));
        let apart = plan(&[cloud(5, false)], &style);
        assert_eq!((apart.layers, apart.voronoi), (5, Voronoi::Off));
        assert!(skips(&apart, "voronoi depth") && !skips(&both, "voronoi depth"));
        let off = plan(&[cloud(7, true)], &Style { voronoi: Voronoi::Off, ..style });
        assert!(off.voronoi == Voronoi::Off && skips(&off, "voronoi depth"));
        assert_eq!(plan(&[], &style).layers, 1, "an empty frame has a layer to clear");
    }

    #[test]
    fn fuzzy_keeps_the_front_itself() {
        let unlit = Style { shading: Shading::None, ..Style::default() };
        let surface = |b, style| FramePlan::new(&blend(b), style, &[SCAN], &ALL).surface();
        assert!(surface(Blend::TwoPass, &unlit) && !surface(Blend::Fuzzy, &unlit));
        assert!(surface(Blend::Fuzzy, &Style::default()));
    }

    #[test]
    fn back_faces_are_dropped_only_where_nothing_can_be_missed() {
        let p = plan(&Style::default(), &[SCAN], true);
        let closed = CloudTraits { closed: true, ..SCAN };
        assert!(!p.culls(&Style::default(), &SCAN));
        assert!(p.culls(&Style::default(), &closed));
        assert!(!p.culls(&Style { back_faces: BackFaces::Draw, ..Style::default() }, &closed));
        assert!(p.culls(&Style { back_faces: BackFaces::Cull, ..Style::default() }, &SCAN));
        assert!(!p.culls(
            &Style { back_faces: BackFaces::Cull, ..Style::default() },
            &CloudTraits { normals: false, ..closed }
        ));
    }
}
