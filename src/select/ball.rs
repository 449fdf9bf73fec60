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
        // A plane through nothing (a picture that a transform flattens) hides nothing.
        self.planes.iter().any(|plane| plane.truncate().dot(p) + plane.w < least - ROUNDING * (p.length() - least))
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
