//! Errors of one node: how far a disk is from what it stands for, and what must be added so that passing is inherited.

use glam::{DVec2, DVec3};

use crate::structure::nodes::SPLIT_REACH;

/// Orientations of the slabs in a node's plane.
const SLABS: usize = 8;
/// What stored lengths are rounded up by: 128 units in the last place, more than single floats lose in both tests of a
/// parent and its child together.
const UP: f64 = 1.0 + 1.0 / (1 << 17) as f64;
/// Least error of an inner node \[cloud units\]: its square must be a normal float.
const LEAST: f64 = 1e-17;
/// The sine that the test computes from 1 − cos² is off by at most 1.1·10⁻³ near 0, twice (parent and child).
const SINE: f64 = 1.0 / 256.0;

/// A length as it is stored: rounded up, so that what holds for the exact one holds in single floats.
pub fn up(length: f64) -> f32 {
    (length.max(LEAST) * UP) as f32
}

/// A disk that a node stands for, as its errors are made of it; lengths in cloud units.
#[derive(Debug, Clone, Copy, Default)]
pub struct Part {
    /// From the node's centre to the disk's.
    pub offset: DVec3,
    /// `None`: it faces the viewer.
    pub normal: Option<DVec3>,
    /// Of the disk.
    pub radius: f64,
    /// How far what is below it reaches beyond its plane along its normal, and against it; 0 for leaves.
    pub above: f64,
    /// See `above`.
    pub below: f64,
    /// How far what is below it covers its plane in every direction at least; the radius for leaves.
    pub inner: f64,
}

impl Part {
    /// All that there is: a leaf, or a node taken for one.
    pub fn disk(offset: DVec3, normal: Option<DVec3>, radius: f64) -> Part {
        Part { offset, normal, radius, above: 0.0, below: 0.0, inner: radius }
    }
}

/// The errors of a node over its parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Errors {
    /// How far the parts reach beyond the node's plane along its normal, at least 0.
    pub above: f64,
    /// And against it.
    pub below: f64,
    /// e_t: the diameter less the width of the tightest slab.
    pub tangential: f64,
    /// Least reach of the parts from the centre in the directions of the slabs, at least 0.
    pub inner: f64,
}

impl Errors {
    /// Of a disk with this normal and diameter over its parts (2003, sections 3.2 and 3.3).
    ///
    /// With leaves alone this is what was published. Inner nodes as parts are widened by what they stand for, where the
    /// published errors take their disks at face value and bound no grandchild: across the plane by `above` and `below`,
    /// along it by taking `inner` for their radius.
    pub fn over(normal: DVec3, diameter: f64, parts: &[Part]) -> Errors {
        let (mut above, mut below) = (0.0f64, 0.0f64);
        let (u, v) = normal.any_orthonormal_pair();
        let (mut high, mut low) = ([f64::NEG_INFINITY; SLABS], [f64::INFINITY; SLABS]);
        for part in parts {
            let along = part.offset.dot(normal);
            let cosine = part.normal.map_or(0.0, |n| n.dot(normal).clamp(-1.0, 1.0));
            let sine = (1.0 - cosine * cosine).sqrt();
            let (with, against) = if cosine >= 0.0 { (part.above, part.below) } else { (part.below, part.above) };
            let reach = |beyond: f64| (part.radius * sine + beyond * cosine.abs()).min(part.radius);
            above = above.max(along + reach(with));
            below = below.max(reach(against) - along);
            let offset = DVec2::new(part.offset.dot(u), part.offset.dot(v));
            let tilt = part.normal.map_or(DVec2::ZERO, |n| DVec2::new(n.dot(u), n.dot(v)));
            for (k, direction) in directions().into_iter().enumerate() {
                let half = part.inner * (1.0 - tilt.dot(direction).powi(2)).max(0.0).sqrt();
                let at = offset.dot(direction);
                high[k] = high[k].max(at + half);
                low[k] = low[k].min(at - half);
            }
        }
        let least = |f: &dyn Fn(usize) -> f64| (0..SLABS).map(f).fold(f64::INFINITY, f64::min);
        Errors {
            above,
            below,
            tangential: (diameter - least(&|k| high[k] - low[k])).max(0.0),
            inner: least(&|k| high[k].min(-low[k])).max(0.0),
        }
    }

    /// e_p: the distance of the planes, parallel to the node's, that hold all parts.
    pub fn perpendicular(&self) -> f64 {
        self.above + self.below
    }
}

/// Of half a turn, without functions that each platform rounds its own way.
fn directions() -> [DVec2; SLABS] {
    const C: f64 = 0.923_879_532_511_286_7;
    const S: f64 = 0.382_683_432_365_089_8;
    const H: f64 = std::f64::consts::FRAC_1_SQRT_2;
    [(1.0, 0.0), (C, S), (H, H), (S, C), (0.0, 1.0), (-S, C), (-H, H), (-C, S)].map(DVec2::from)
}

/// What a child demands of its parent under [`Split`](crate::structure::nodes::ErrorRule::Split): (e_p, e_t).
///
/// `normals` are the two nodes', `None` where the child's error is the same from everywhere. See the module's proof.
pub fn inherited(
    perpendicular: f64,
    tangential: f64,
    normals: Option<(DVec3, DVec3)>,
    tau_max: f64,
    apart: f64,
) -> (f64, f64) {
    let cosine = normals.map_or(0.0, |(a, b)| a.dot(b).abs().min(1.0));
    let sine = (1.0 - cosine * cosine).sqrt();
    let all = perpendicular.hypot(tangential);
    // The most that a turn by up to θ makes of one component, whatever the other.
    let turned = |this: f64, other: f64| {
        if other * cosine >= this * sine { this * cosine + other * sine } else { all }
    };
    let moved = (2.0 + SPLIT_REACH as f64) * tau_max * apart;
    let ep = turned(perpendicular, tangential) + moved;
    (ep, turned(tangential, perpendicular) + moved + SINE * ep)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use crate::structure::nodes::{ErrorRule, Node, Test};

    #[test]
    fn errors_of_four_disks_in_a_square() {
        // Side 1, radii 0.5: the tightest slab is 2 wide, along the sides.
        let leaf = |x, y, z| Part::disk(DVec3::new(x, y, z), Some(DVec3::Z), 0.5);
        let parts = [leaf(0.5, 0.5, 0.1), leaf(-0.5, 0.5, -0.1), leaf(0.5, -0.5, -0.1), leaf(-0.5, -0.5, 0.1)];
        let errors = Errors::over(DVec3::Z, 2.5, &parts);
        assert!((errors.perpendicular() - 0.2).abs() < 1e-12, "{errors:?}");
        assert!((errors.tangential - 0.5).abs() < 1e-9 && (errors.inner - 1.0).abs() < 1e-9, "{errors:?}");
        // A disk on edge reaches as far as its radius; one without normal as well.
        for normal in [Some(DVec3::X), None] {
            let errors = Errors::over(DVec3::Z, 1.0, &[Part { normal, ..leaf(0.0, 0.0, 0.0) }]);
            assert!((errors.perpendicular() - 1.0).abs() < 1e-12, "{errors:?}");
        }
    }

    #[test]
    fn what_is_inherited_bounds_every_turn() {
        let turn = |a: f64| DVec3::new(a.sin(), 0.0, a.cos());
        for theta in (0..=90).map(|a| f64::from(a).to_radians()) {
            for (ep, et) in [(1.0, 0.0), (0.0, 1.0), (1.0, 0.1), (0.1, 1.0), (1.0, 1.0)] {
                let (p, t) = inherited(ep, et, Some((turn(0.0), turn(theta))), 0.1, 0.0);
                for alpha in (0..=90).map(|a| f64::from(a).to_radians()) {
                    let parent = p * alpha.sin() + t * alpha.cos();
                    for k in -8..=8 {
                        let child = alpha + theta * f64::from(k) / 8.0;
                        let error = ep * child.sin().abs() + et * child.cos().abs();
                        assert!(error <= parent + 1e-12, "θ {theta}, α {alpha}: {error} > {parent}");
                    }
                }
            }
        }
    }

    #[test]
    fn passing_is_inherited_head_on_in_single_floats() {
        // Here the sine from 1 − cos² is rounding and nothing else.
        let mut random = Rng::new(3);
        let mut close = 0;
        for k in 0..400_000 {
            let mut vector = || DVec3::from([0; 3].map(|_: u8| 2.0 * random.unit() - 1.0));
            let (n, at, shake) = (vector().normalize(), vector(), 10f64.powi(-3 - k % 4));
            let m = (n + shake * vector()).normalize();
            let eye = (at + 2.0 * (n + shake * vector())).as_vec3();
            let (ep, et) = (up(0.001), up(0.001 * random.unit()));
            let (p, t) = inherited(ep as f64, et as f64, Some((m, n)), 0.03, 0.0);
            let node = |normal: DVec3, error: f32, tangential: f32| Node {
                position: at.as_vec3().to_array(),
                error,
                normal: normal.as_vec3().to_array(),
                tangential,
            };
            let (parent, child) = (node(n, up(p), up(t)), node(m, ep, et));
            // About where the child begins to pass.
            let v = (eye.as_dvec3() - at).normalize();
            let limit = ep as f64 * (1.0 - m.dot(v).powi(2)).max(0.0).sqrt() + et as f64 * m.dot(v).abs();
            let tau = (limit / 2.0 * (1.0 + 0.004 * (random.unit() - 0.5))) as f32;
            let test = Test { eye: eye.extend(1.0).to_array(), tau };
            let [above, below] = [parent, child].map(|node| test.passes(ErrorRule::Split, &node));
            assert!(!above || below, "{test:?} {parent:?} {child:?}");
            close += below as usize;
        }
        assert!((10_000..390_000).contains(&close), "{close}");
    }
}
