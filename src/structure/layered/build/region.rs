//! Boxes of points, and how they are cut in two.

use glam::Vec3;

/// Box round points, relative to the model's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Region {
    pub low: Vec3,
    pub high: Vec3,
}

/// Where a region is cut: coordinates below `plane` along `axis` go to the first child.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cut {
    pub axis: usize,
    pub plane: f32,
}

impl Cut {
    pub fn side(&self, p: [f32; 3]) -> usize {
        (p[self.axis] >= self.plane) as usize
    }
}

impl Region {
    /// Round nothing.
    pub const EMPTY: Region = Region { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };

    pub fn add(&mut self, p: [f32; 3]) {
        self.low = self.low.min(p.into());
        self.high = self.high.max(p.into());
    }

    /// Centre, which has no overflow.
    pub fn centre(&self) -> Vec3 {
        (0.5 * self.low.as_dvec3() + 0.5 * self.high.as_dvec3()).as_vec3()
    }

    /// Longest side \[world units\].
    pub fn extent(&self) -> f32 {
        (self.high.as_dvec3() - self.low.as_dvec3()).max_element().clamp(0.0, f32::MAX as f64) as f32
    }

    /// Coordinates in which the region's longest side is 1, about its centre: no square of a distance overflows or vanishes.
    pub fn unit(&self, p: [f32; 3]) -> Vec3 {
        let side = self.extent().max(f32::MIN_POSITIVE) as f64;
        ((Vec3::from(p).as_dvec3() - self.centre().as_dvec3()) / side).as_vec3()
    }

    /// The longest axis at its midpoint; `None` where all points are at one place. Neither side is without points.
    pub fn cut(&self) -> Option<Cut> {
        let side = self.high.as_dvec3() - self.low.as_dvec3();
        let axis = side.max_position();
        let (low, high) = (self.low[axis], self.high[axis]);
        let middle = self.centre()[axis];
        // Between two neighbouring floats the midpoint is rounded to one of them.
        let plane = if middle > low { middle } else { high };
        (high > low).then_some(Cut { axis, plane })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cut_has_points_on_both_sides() {
        for (low, high) in [(1.0f32, 1.0f32.next_up()), (-1.0, 3.0), (-1e30, 1e30), (0.0, f32::from_bits(1))] {
            let region = Region { low: Vec3::splat(low), high: Vec3::new(low, high, low) };
            let cut = region.cut().expect("two places");
            assert_eq!((cut.axis, cut.side([low; 3]), cut.side([high; 3])), (1, 0, 1), "{low} {high}");
            // Half, and half more where the centre is rounded by half the distance of two neighbouring floats.
            assert!(region.unit([low, high, low]).abs().max_element() <= 1.0);
        }
        assert_eq!(Region { low: Vec3::ONE, high: Vec3::ONE }.cut(), None);
    }
}
