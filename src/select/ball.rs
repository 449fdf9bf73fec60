//! A view of balls: how near, whether in the picture, and whether what is in them faces the viewer.

use glam::Vec3;

use super::Sight;

/// Share of the lengths at hand that rounding could take: a hundred times what it does in f64 from coordinates in f32.
const ROUNDING: f64 = 1e-6;

impl Sight {
    /// Least distance of the eye from a ball, what τ is multiplied by: 0 within it, and 1 without perspective.
    pub fn distance_to_ball(&self, centre: Vec3, radius: f32) -> f64 {
        if self.eye.w == 0.0 {
            return 1.0;
        }
        ((centre.as_dvec3() - self.eye.truncate()).length() - radius as f64).max(0.0)
    }

    /// Whether no splat with its centre in the ball and a radius of at most `reach` can be seen.
    pub fn misses_ball(&self, centre: Vec3, radius: f32, reach: f32) -> bool {
        let (p, least) = (centre.as_dvec3(), -(radius as f64) - reach as f64 * self.radius_scale);
        let least = least - ROUNDING * (p.length() - least);
        // A plane through nothing (a picture that a transform flattens) hides nothing.
        self.planes.iter().any(|plane| plane.truncate().dot(p) + plane.w < least)
    }

    /// Whether every normal within an angle of `axis`, whose cosine is `cone`, faces away from the eye, wherever in the ball it
    /// stands.
    ///
    /// With v the way from the centre to the eye, θ its angle to the axis and α the cone's: the normal most turned to the eye
    /// has n · v = |v| cos(θ − α), and moving its place within the ball adds at most the ball's radius. An eye within the ball
    /// is seen by some normal, since |v| is less than that. A cone of a right angle or more always has a normal that faces it.
    pub fn faces_away(&self, centre: Vec3, radius: f32, axis: Vec3, cone: f32) -> bool {
        if cone.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
            return false;
        }
        let (axis, cosine) = (axis.as_dvec3(), (cone as f64).min(1.0));
        let (v, add) = match self.eye.w == 0.0 {
            true => (self.eye.truncate(), 0.0),
            false => (self.eye.truncate() - centre.as_dvec3(), radius as f64),
        };
        let (along, length) = (v.dot(axis), v.length());
        let across = (length * length - along * along).max(0.0).sqrt();
        let most = along * cosine + across * (1.0 - cosine * cosine).sqrt();
        most + add < -ROUNDING * (length + add)
    }

    /// From 1 where the ball reaches the picture's middle to ½ at its border and beyond.
    ///
    /// Of two opposite planes, the share that the nearer's distance has of the mean of both: in a perspective view as well,
    /// since both grow alike with depth.
    pub fn centrality(&self, centre: Vec3, radius: f32) -> f64 {
        let p = centre.as_dvec3();
        let [left, right, top, bottom] = [0, 1, 2, 3].map(|i| self.planes[i].truncate().dot(p) + self.planes[i].w);
        let share = |a: f64, b: f64| {
            let mean = (0.5 * (a + b)).max(f64::MIN_POSITIVE);
            ((a.min(b) + radius as f64) / mean).clamp(0.0, 1.0)
        };
        0.5 + 0.5 * share(left, right).min(share(top, bottom))
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat4, DVec3};

    use super::*;
    use crate::rng::Rng;
    use crate::select::View;
    use crate::style::Style;

    fn vector(rng: &mut Rng) -> DVec3 {
        DVec3::new(rng.unit(), rng.unit(), rng.unit()) * 2.0 - 1.0
    }

    fn sight(rng: &mut Rng, perspective: bool) -> Sight {
        let lens = match perspective {
            true => View::perspective(1.0, 1.5, 0.1),
            false => View::orthographic(2.0, 1.5, 0.1, 10.0),
        };
        let eye = 2.0 * vector(rng);
        let view = View::look_at(eye, vector(rng), DVec3::Z, lens, Default::default());
        Sight::new(&view, [150, 100], &DMat4::from_scale(DVec3::splat(1.5)), DVec3::ZERO, &Style::default())
    }

    #[test]
    fn cones_face_away_exactly_when_their_worst_normal_does() {
        let mut rng = Rng::new(1);
        let mut away = 0;
        for i in 0..20_000 {
            let sight = sight(&mut rng, i % 2 == 0);
            let (centre, radius) = (vector(&mut rng).as_vec3(), (rng.unit() * 0.5) as f32);
            let (axis, cone) = (vector(&mut rng).normalize().as_vec3(), rng.unit() as f32);
            // The axis turned by the cone's angle to the eye, or the eye's direction itself, where the ball is nearest to it.
            let eye = sight.eye.truncate();
            let v = if sight.eye.w == 0.0 { eye } else { eye - centre.as_dvec3() };
            let (axis64, angle) = (axis.as_dvec3(), (cone as f64).acos());
            let across = (v - v.dot(axis64) * axis64).normalize_or_zero();
            let n = match v.angle_between(axis64) > angle {
                true => angle.cos() * axis64 + angle.sin() * across,
                false => v.normalize(),
            };
            let worst = n.dot(v) + if sight.eye.w == 0.0 { 0.0 } else { radius as f64 };
            let found = sight.faces_away(centre, radius, axis, cone);
            assert_eq!(found, worst < 0.0, "{worst}");
            away += usize::from(found);
            assert!(
                !sight.faces_away(centre, radius, axis, -cone) && !sight.faces_away(centre, radius, axis, f32::NAN)
            );
        }
        assert!(away > 1000, "{away}");
        // Within the ball, on its rim, and right before it.
        let inside = |x: f64| Sight { eye: DVec3::new(x, 0.0, 0.0).extend(1.0), ..sight(&mut Rng::new(2), true) };
        let faces_away = |x: f64| inside(x).faces_away(Vec3::ZERO, 1.0, Vec3::X, 1.0);
        assert!(!faces_away(-0.5) && !faces_away(-1.0) && faces_away(-1.001) && !faces_away(0.5) && !faces_away(3.0));
    }

    #[test]
    fn balls_are_as_near_as_their_nearest_point_and_missed_when_all_of_it_is() {
        let mut rng = Rng::new(3);
        let mut missed = 0;
        for i in 0..5000 {
            let sight = sight(&mut rng, i % 2 == 0);
            let (centre, radius) = (2.0 * vector(&mut rng).as_vec3(), rng.unit() as f32);
            let (nearest, reach) = (sight.distance_to_ball(centre, radius), (rng.unit() * 0.3) as f32);
            let misses = sight.misses_ball(centre, radius, reach);
            for _ in 0..20 {
                let p = centre.as_dvec3() + vector(&mut rng).normalize() * radius as f64;
                let away = if sight.eye.w == 0.0 { 1.0 } else { (p - sight.eye.truncate()).length() };
                assert!(nearest <= away * (1.0 + 1e-12));
                let seen = sight.planes.iter().all(|q| q.truncate().dot(p) + q.w > -(reach as f64));
                assert!(!(misses && seen));
            }
            let gap =
                sight.planes.iter().map(|q| q.truncate().dot(centre.as_dvec3()) + q.w).fold(f64::INFINITY, f64::min);
            assert_eq!(misses, gap < -(radius as f64 + reach as f64));
            missed += usize::from(misses);
        }
        assert!(missed > 500 && missed < 4500, "{missed}");
    }
}
