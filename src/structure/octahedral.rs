//! Unit vectors in 32 bits: the octahedral map (Meyer et al. 2010) with 16 bits an axis, worst error 6.5·10⁻⁵ rad.

use glam::{DVec3, Vec3};

/// The code of "no normal": the splat faces the viewer. No unit vector maps to it, since components stop at −32767.
pub const NONE: u32 = 0x8000_8000;

/// Packs a vector of any non-zero finite length; everything else becomes [`NONE`].
pub fn encode(n: Vec3) -> u32 {
    // In f64, so that 10⁻³⁰ and 10³⁰ are as good as 1.
    let n = n.as_dvec3();
    let l1 = n.x.abs() + n.y.abs() + n.z.abs();
    if !(l1 > 0.0 && l1.is_finite()) {
        return NONE;
    }
    let n = n / l1;
    let (x, y) = if n.z >= 0.0 { (n.x, n.y) } else { ((1.0 - n.y.abs()) * sign(n.x), (1.0 - n.x.abs()) * sign(n.y)) };
    let quantise = |v: f64| (v.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16 as u32;
    quantise(x) | quantise(y) << 16
}

/// The unit vector of a code; `None` for [`NONE`].
pub fn decode(code: u32) -> Option<DVec3> {
    if code == NONE {
        return None;
    }
    let component = |bits: u32| (bits as u16 as i16 as f64 / 32767.0).max(-1.0);
    let (x, y) = (component(code), component(code >> 16));
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    let v = DVec3::new(x - fold * sign(x), y - fold * sign(y), z);
    Some(v.normalize())
}

/// 8 bits of each coordinate of a code, worst error 0.0168 rad.
pub fn narrow(code: u32) -> u16 {
    if code == NONE {
        return NARROW_NONE;
    }
    let component = |bits: u32| {
        let v = (bits as u16 as i16).max(-32767) as f64;
        (v * 127.0 / 32767.0).round() as i8 as u8 as u16
    };
    component(code) | component(code >> 16) << 8
}

/// The code of eight bits each: whole numbers, so that everyone gets the same.
pub fn widen(code: u16) -> u32 {
    if code == NARROW_NONE {
        return NONE;
    }
    let component = |bits: u16| {
        let v = bits as u8 as i8 as i32;
        // 127 becomes 32767.
        (v.signum() * (v.abs() * 258 + (v.abs() >> 6))) as i16 as u16 as u32
    };
    component(code) | component(code >> 8) << 16
}

/// [`NONE`] in 16 bits.
const NARROW_NONE: u16 = 0x8080;

fn sign(v: f64) -> f64 {
    if v >= 0.0 { 1.0 } else { -1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trip_stays_within_the_quantisation_error() {
        // Half a step δ = 1/65534 in each of two coordinates moves the point on the octahedron by at most √6 δ (dx = dy),
        // and projection to the sphere stretches by at most √3 (at a face's centre): √18 δ = 6.5·10⁻⁵.
        let mut worst = 0.0f64;
        let mut state = 1u32;
        let mut next = || {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        };
        for _ in 0..100_000 {
            let v = Vec3::new(next(), next(), next());
            if v.length() < 1e-3 {
                continue;
            }
            let back = decode(encode(v)).unwrap();
            worst = worst.max(back.cross(v.as_dvec3().normalize()).length());
        }
        assert!(worst < 6.5e-5, "{worst}");
        assert!(worst > 1e-6, "suspiciously exact: {worst}");
    }

    #[test]
    fn half_the_bits_keep_a_hundredth_of_a_turn() {
        // As above with δ = 1/254, and codes that stand for up to half a step of 16 bits more: √18 (1/254 + 1/65534).
        let bound = 18f64.sqrt() * (1.0 / 254.0 + 1.0 / 65534.0);
        let mut worst = 0.0f64;
        for x in (-32767..=32767i32).step_by(137) {
            for y in (-32767..=32767i32).step_by(139) {
                let code = x as u16 as u32 | (y as u16 as u32) << 16;
                let (exact, narrow) = (decode(code).unwrap(), decode(widen(narrow(code))).unwrap());
                worst = worst.max(exact.angle_between(narrow));
            }
        }
        assert!(worst < bound && worst > 0.5 * bound, "{worst} {bound}");
        assert_eq!((widen(narrow(NONE)), narrow(NONE)), (NONE, 0x8080));
        for q in -127..=127i8 {
            let code = u16::from_le_bytes([q as u8, (q / 2) as u8]);
            assert_eq!(narrow(widen(code)), code);
        }
        for v in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
            assert_eq!(widen(narrow(encode(v))), encode(v), "axes are exact");
        }
    }

    #[test]
    fn axes_and_oddities() {
        for v in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
            assert!((decode(encode(v)).unwrap() - v.as_dvec3()).length() < 1e-9, "{v}");
        }
        assert_eq!(encode(Vec3::ZERO), NONE);
        assert_eq!(encode(Vec3::NAN), NONE);
        assert_eq!(encode(Vec3::splat(f32::INFINITY)), NONE);
        assert_ne!(encode(Vec3::splat(1e-30)), NONE);
    }
}
