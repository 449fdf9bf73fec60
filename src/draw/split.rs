//! A projection in pairs of floats, for `glsl/shared/pixel.glsl`.
//!
//! A position x is taken from a point `about` and split in multiples of a step g and the rest, |x − about| ≤ 2¹⁰ g; each
//! row of the matrix likewise in multiples of a step of its own, 2¹⁰ of which hold its largest entry. Products of the
//! coarse halves are whole numbers of both steps below 2²⁰, and their sum with a constant below 2²³ one below 2²⁴: exact
//! in f32, in any order, fused or not. What is left is 2⁻¹¹ as large, so rounding it by 2⁻²⁴ leaves errors of 2⁻³⁵.

use glam::{DVec3, DVec4, Vec3};

/// The split rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Split {
    /// The point that positions are taken from, a whole number of steps.
    pub about: Vec3,
    /// Added and taken away again it rounds to whole steps.
    pub rounder: f32,
    /// Coarse rows.
    pub hi: [[f32; 4]; 3],
    /// What they leave.
    pub lo: [[f32; 4]; 3],
}

fn power_above(v: f64) -> f64 {
    // Subnormal steps would be flushed to 0.
    v.max(1e-30).log2().ceil().exp2()
}

/// Splits `rows`, to be multiplied with (x, 1), for positions x between `bounds` as seen from near `about`.
pub fn split(rows: [DVec4; 3], about: DVec3, bounds: [DVec3; 2]) -> Split {
    let farthest = bounds.iter().map(|b| (*b - about).abs().max_element()).fold(0.0, f64::max);
    let steps = rows.map(|row| power_above(row.truncate().abs().max_element()) / 1024.0);
    // The constants must be as few steps, and `about` a float.
    let constants = (0..3).map(|i| rows[i].dot(about.extend(1.0)).abs() / steps[i]);
    let constant = constants.zip(&rows).filter(|(_, row)| row.truncate() != DVec3::ZERO).map(|(c, _)| c);
    let constant = constant.fold(0.0, f64::max) / (1 << 22) as f64;
    let step = power_above((farthest / 1024.0).max(constant).max(about.abs().max_element() / (1 << 22) as f64));
    let about = (about / step).round() * step;
    let (mut hi, mut lo) = ([[0.0; 4]; 3], [[0.0; 4]; 3]);
    for i in 0..3 {
        let unit = steps[i];
        let constant = rows[i].dot(about.extend(1.0));
        let coarse =
            ((rows[i].truncate() / unit).round() * unit).extend((constant / (unit * step)).round() * unit * step);
        // A row without x: nothing to be exact with.
        let coarse = if rows[i].truncate() == DVec3::ZERO { DVec4::W * constant as f32 as f64 } else { coarse };
        hi[i] = coarse.as_vec4().to_array();
        lo[i] = (rows[i].truncate().extend(constant) - coarse).as_vec4().to_array();
    }
    Split { about: about.as_vec3(), rounder: (1.5 * (1 << 23) as f64 * step) as f32, hi, lo }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{dvec3, dvec4};

    /// The shader's arithmetic, operation by operation.
    fn pixel_of(s: &Split, x: Vec3) -> [f64; 2] {
        let from = x - s.about;
        let coarse = (from + s.rounder) - s.rounder;
        let fine = x - (s.about + coarse);
        let dot = |r: [f32; 4], v: Vec3, one: f32| ((r[0] * v.x + r[1] * v.y) + r[2] * v.z) + r[3] * one;
        let hi = s.hi.map(|r| dot(r, coarse, 1.0));
        for (row, got) in s.hi.iter().zip(hi) {
            let exact: f64 = (0..3).map(|k| row[k] as f64 * coarse[k] as f64).sum::<f64>() + row[3] as f64;
            assert_eq!(got as f64, exact, "{row:?} of {x}");
        }
        let lo: [f32; 3] = std::array::from_fn(|i| dot(s.hi[i], fine, 0.0) + dot(s.lo[i], from, 1.0));
        let w = hi[2] + lo[2];
        [0, 1].map(|i| {
            let whole = ((hi[i] + lo[i]) / w + 0.5).floor();
            let head = f32::from_bits(hi[2].to_bits() & 0xffff_e000);
            let left = ((hi[i] - whole * head) - whole * (hi[2] - head)) + (lo[i] - whole * lo[2]);
            whole as f64 + (left / w) as f64
        })
    }

    #[test]
    fn places_are_good_to_a_millionth_of_a_pixel() {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / (1u64 << 24) as f64 * 2.0 - 1.0
        };
        // Scale of the scene, distance of the eye and offset of the cloud's origin in its units, focal length [px].
        for (unit, eye, origin, focal) in [
            (1.0, 3.0, 0.0, 165.0),
            (1e-6, 3.0, 0.0, 1000.0),
            (1e6, 3.0, 0.0, 1000.0),
            (1.0, 115.0, 0.0, 8000.0),
            (1.0, 2.5, 1000.0, 1000.0),
            (1.0, 2.0, 0.0, 8000.0),
        ] {
            let turn = glam::DMat3::from_euler(glam::EulerRot::XYZ, 0.3, -0.7, 1.1);
            let offset = origin * unit * dvec3(0.8, -0.4, 0.1);
            let to_eye = |p: DVec3| turn * (p - offset) - dvec3(0.0, 0.0, eye * unit);
            let back = turn.transpose();
            let eye_row = |axis: DVec3| {
                let a = back * axis;
                a.extend(-a.dot(offset) - axis.z * eye * unit)
            };
            let (x, y, z) = (eye_row(DVec3::X), eye_row(DVec3::Y), eye_row(DVec3::Z));
            let rows = [focal * x, -focal * y, -z];
            let bounds = [offset - unit * DVec3::ONE, offset + unit * DVec3::ONE];
            let s = split(rows, offset + 0.1 * unit * back * DVec3::Z, bounds);
            for _ in 0..10_000 {
                let p = (offset + unit * dvec3(random(), random(), random())).as_vec3();
                let e = to_eye(p.as_dvec3());
                if e.z > -0.5 * unit || (e.x / e.z).abs() * focal > 8192.0 {
                    continue;
                }
                let h = p.as_dvec3().extend(1.0);
                let want = [rows[0].dot(h) / rows[2].dot(h), rows[1].dot(h) / rows[2].dot(h)];
                let got = pixel_of(&s, p);
                let error = (got[0] - want[0]).abs().max((got[1] - want[1]).abs());
                // 2⁻³⁵ of a pixel's coordinate and of focal · reach / depth, a dozen times.
                assert!(error < 3e-6, "{error} px at {want:?}, {p}");
            }
        }
    }

    #[test]
    fn a_row_without_positions_is_kept() {
        let rows = [dvec4(1.0, 2.0, 3.0, 4.0), dvec4(3.0, 2.0, 1.0, 0.0), DVec4::W];
        let s = split(rows, DVec3::ZERO, [DVec3::splat(-1.0), DVec3::ONE]);
        assert_eq!((s.hi[2], s.lo[2]), ([0.0, 0.0, 0.0, 1.0], [0.0; 4]));
    }
}
