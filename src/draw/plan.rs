//! What a frame will run, as a pure function of its input: no Vulkan call, testable at every edge.

use crate::stats::Skip;
use crate::style::{BackFaces, Footprint, Shading, Style};
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
}

/// What a frame runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FramePlan {
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
    /// Decides for one frame. `depth_target`: the host's pass has a depth attachment. `sprite_limit`: largest point
    /// size \[px\], 1 where `largePoints` is not enabled.
    pub fn new(
        technique: &Technique,
        style: &Style,
        clouds: &[CloudTraits],
        depth_target: bool,
        host_depth: bool,
        sprite_limit: f32,
    ) -> FramePlan {
        let mut skipped = Vec::new();
        let mut skip = |stage, reason| skipped.push(Skip { stage, reason });
        let opaque = technique.blend == Blend::Opaque;
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
        if opaque {
            skip("visibility", "opaque: the depth test alone decides");
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
        FramePlan { lit, front, quads, disc: opaque && !pixels, pixels, skipped }
    }

    /// Whether the second attachment, of normals and the front's depth, is needed.
    pub fn surface(&self) -> bool {
        self.lit || self.front
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

    const SCAN: CloudTraits = CloudTraits { normals: true, colors: true, closed: false };

    fn plan(style: &Style, clouds: &[CloudTraits], depth: bool) -> FramePlan {
        FramePlan::new(&Technique::default(), style, clouds, depth, false, 255.0)
    }

    fn skips(plan: &FramePlan, stage: &str) -> bool {
        plan.skipped.iter().any(|s| s.stage == stage)
    }

    #[test]
    fn every_skip_has_its_scene() {
        let style = Style::default();
        let full = Style { eye_dome: Some(Default::default()), ..style };
        let all = FramePlan::new(&Technique::default(), &full, &[SCAN], true, true, 255.0);
        assert_eq!(all.skipped, [], "this scene needs everything");
        assert!(all.lit && all.front && !all.quads);

        assert!(skips(&plan(&Style { shading: Shading::None, ..style }, &[SCAN], true), "normals"));
        assert!(skips(&plan(&style, &[CloudTraits { normals: false, ..SCAN }], true), "normals"));
        assert!(skips(&plan(&style, &[SCAN], false), "front depth"));
        assert!(!skips(&plan(&full, &[SCAN], false), "front depth"));
        assert!(skips(&plan(&style, &[CloudTraits { colors: false, ..SCAN }], true), "colours"));
        assert!(skips(&plan(&style, &[], true), "normals"));
        let opaque = Technique { blend: Blend::Opaque, ..Default::default() };
        assert!(skips(&FramePlan::new(&opaque, &style, &[SCAN], true, true, 255.0), "visibility"));
        let small = FramePlan::new(&Technique::default(), &style, &[SCAN], true, true, 1.0);
        assert!(small.quads && skips(&small, "point sprites"));
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
