//! Normals by principal component analysis of the neighbours (Hoppe et al., *Surface Reconstruction from Unorganized
//! Points*, SIGGRAPH 1992): the direction in which a point and its neighbours spread least.
//!
//! The eigenvectors are closed-form (D. Eberly, *A Robust Eigensolver for 3×3 Symmetric Matrices*, 2014): the one whose
//! eigenvalue is best separated first, the others inside its orthogonal complement, so that nothing cancels when two
//! eigenvalues meet. All in f64: it costs about 0.1 µs a point, and coordinates up to 1e19 do not overflow.

use glam::{DVec3, Vec3};

/// A symmetric 3×3 matrix: xx, xy, xz, yy, yz, zz.
type Symmetric = [f64; 6];

/// The unit normal of a point at the origin with neighbours at these `offsets`, sign arbitrary; zero where they
/// give no plane: fewer than two, all on one line, or thinner than the f32 steps of coordinates of size `magnitude`.
pub(super) fn plane_normal(offsets: &[Vec3], magnitude: f32) -> Vec3 {
    if offsets.len() < 2 {
        return Vec3::ZERO;
    }
    let mut sum = DVec3::ZERO;
    let mut c: Symmetric = [0.0; 6];
    for o in offsets {
        let o = o.as_dvec3();
        sum += o;
        for (c, product) in c.iter_mut().zip([o.x * o.x, o.x * o.y, o.x * o.z, o.y * o.y, o.y * o.z, o.z * o.z]) {
            *c += product;
        }
    }
    // The point itself is one more sample, at offset zero.
    let m = sum / (offsets.len() + 1) as f64;
    for (c, product) in c.iter_mut().zip([sum.x * m.x, sum.x * m.y, sum.x * m.z, sum.y * m.y, sum.y * m.z, sum.z * m.z])
    {
        *c -= product;
    }
    // A line is thinner than a thousandth of its length, or than its coordinates' rounding (half a step: 2⁻²⁵ of the
    // magnitude in the worst case 2⁻²⁴; twice that, squared and summed over the samples).
    let step = f64::from(magnitude) * 2f64.powi(-23);
    let noise = step * step * (offsets.len() + 1) as f64;
    match least_spread(&c) {
        Some((n, [_, middle, most])) if middle > 1e-6 * most + noise => n.as_vec3().normalize_or_zero(),
        _ => Vec3::ZERO,
    }
}

/// The unit eigenvector of the smallest eigenvalue, and all eigenvalues, ascending; nothing for a zero matrix.
fn least_spread(a: &Symmetric) -> Option<(DVec3, [f64; 3])> {
    let scale = a.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    if scale.is_nan() || scale < f64::MIN_POSITIVE {
        return None;
    }
    let a = a.map(|x| x / scale);
    let [xx, xy, xz, yy, yz, zz] = a;
    let q = (xx + yy + zz) / 3.0;
    let (dx, dy, dz) = (xx - q, yy - q, zz - q);
    let p = ((dx * dx + dy * dy + dz * dz + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0).sqrt();
    if p < 1e-12 {
        // Spread evenly in all directions: any direction is right.
        return Some((DVec3::Z, [q * scale; 3]));
    }
    let determinant = dx * (dy * dz - yz * yz) - xy * (xy * dz - yz * xz) + xz * (xy * yz - dy * xz);
    let half = (determinant / (2.0 * p * p * p)).clamp(-1.0, 1.0);
    let angle = half.acos() / 3.0;
    let most = 2.0 * angle.cos();
    let least = 2.0 * (angle + std::f64::consts::TAU / 3.0).cos();
    let values = [least, -(least + most), most].map(|b| q + p * b);
    let normal = if half >= 0.0 {
        let along = null_vector(&a, values[2]);
        let across = in_complement(&a, along, values[1]);
        along.cross(across)
    } else {
        null_vector(&a, values[0])
    };
    Some((normal, values.map(|v| v * scale)))
}

/// The eigenvector of a simple eigenvalue: the longest cross product of two rows of A − λ.
fn null_vector(&[xx, xy, xz, yy, yz, zz]: &Symmetric, value: f64) -> DVec3 {
    let r0 = DVec3::new(xx - value, xy, xz);
    let r1 = DVec3::new(xy, yy - value, yz);
    let r2 = DVec3::new(xz, yz, zz - value);
    let candidates = [r0.cross(r1), r0.cross(r2), r1.cross(r2)];
    let mut best = candidates[0];
    for c in &candidates[1..] {
        if c.length_squared() > best.length_squared() {
            best = *c;
        }
    }
    best.normalize_or_zero()
}

/// The eigenvector of `value` that is orthogonal to the eigenvector `n`.
fn in_complement(&[xx, xy, xz, yy, yz, zz]: &Symmetric, n: DVec3, value: f64) -> DVec3 {
    let (u, v) = n.any_orthonormal_pair();
    let times = |w: DVec3| {
        DVec3::new(xx * w.x + xy * w.y + xz * w.z, xy * w.x + yy * w.y + yz * w.z, xz * w.x + yz * w.y + zz * w.z)
    };
    let (au, av) = (times(u), times(v));
    let (m00, m01, m11) = (u.dot(au) - value, u.dot(av), v.dot(av) - value);
    // The longer row of a singular 2×2 matrix, turned by a right angle, spans its null space.
    let (x, y) = if m00.abs() >= m11.abs() { (m01, -m00) } else { (m11, -m01) };
    if x == 0.0 && y == 0.0 { u } else { (u * x + v * y).normalize_or(u) }
}
