//! What is drawn: small clouds and the view that most cases start from.

use std::sync::Arc;

use glam::{DMat4, DVec3, Vec3, dvec3};

use super::Take;
use crate::load::PointCloud;
use crate::select::{DepthConvention, View};
use crate::style::{BackFaces, Shading, Style};
use crate::technique::{Blend, Technique};

pub const ASPECT: f64 = 160.0 / 112.0;

/// Knuth's linear congruential generator: the upper 24 bits, 0 to 1.
pub fn random(state: &mut u64) -> f32 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 40) as f32 / (1u32 << 24) as f32
}

pub fn random_colors(n: usize) -> Vec<[u8; 3]> {
    let mut state = 11;
    (0..n).map(|_| [0; 3].map(|_: u8| (random(&mut state) * 255.0) as u8)).collect()
}

/// 300 disks of all sizes and directions in a cube of side 2, a tenth without a normal.
pub fn soup() -> PointCloud {
    let mut state = 9;
    let mut vector = || Vec3::from_array([0; 3].map(|_: u8| 2.0 * random(&mut state) - 1.0));
    let positions = (0..300).map(|_| vector()).collect();
    let normals = Some((0..300).map(|i| if i % 10 == 9 { Vec3::ZERO } else { vector() }).collect());
    let radii = Some((0..300).map(|_| 0.3 * random(&mut state)).collect());
    PointCloud { positions, normals, radii, colors: Some(random_colors(300)), ..PointCloud::default() }
}

/// A wavy sheet of 40 × 40 splats across the view in coloured patches, of side 2: one surface, soft everywhere.
pub fn sheet() -> PointCloud {
    let place = |i: usize| (i as f32 - 19.5) / 20.0;
    let height = |x: f32, y: f32| 0.1 * (3.0 * x).sin() * (2.0 * y).cos();
    let mut cloud = PointCloud { colors: Some(random_colors(1600)), ..PointCloud::default() };
    let (mut normals, mut radii) = (Vec::new(), Vec::new());
    for (x, y) in (0..1600).map(|i| (place(i % 40), place(i / 40))) {
        cloud.positions.push(Vec3::new(x, y, height(x, y)));
        let slope = |dx: f32, dy: f32| (height(x + dx, y + dy) - height(x - dx, y - dy)) / 2e-3;
        normals.push(Vec3::new(-slope(1e-3, 0.0), -slope(0.0, 1e-3), 1.0).normalize());
        radii.push(0.06);
    }
    (cloud.normals, cloud.radii) = (Some(normals), Some(radii));
    cloud
}

/// Splats one by one: centre, normal, radius.
pub fn splats(list: &[([f32; 3], [f32; 3], f32)]) -> PointCloud {
    PointCloud {
        positions: list.iter().map(|s| s.0.into()).collect(),
        normals: Some(list.iter().map(|s| s.1.into()).collect()),
        radii: Some(list.iter().map(|s| s.2).collect()),
        colors: Some(random_colors(list.len())),
        ..PointCloud::default()
    }
}

pub fn plain() -> Style {
    Style { shading: Shading::None, back_faces: BackFaces::Draw, ..Style::default() }
}

/// Those that need nothing but points.
pub fn blends() -> [Technique; 3] {
    [Blend::TwoPass, Blend::Fuzzy, Blend::Opaque].map(|blend| Technique { blend, ..Technique::TWO_PASS })
}

/// From (0.3, 0.5, 3) to the origin through a lens of 46°.
pub fn outside() -> View {
    look(dvec3(0.3, 0.5, 3.0), DVec3::ZERO, View::perspective(0.8, ASPECT, 0.01))
}

pub fn look(eye: DVec3, target: DVec3, lens: DMat4) -> View {
    View::look_at(eye, target, DVec3::Y, lens, DepthConvention::Reversed)
}

/// From the origin along −Z.
pub fn ahead(near: f64) -> View {
    View { view: DMat4::IDENTITY, projection: View::perspective(0.8, ASPECT, near), depth: DepthConvention::Reversed }
}

pub fn take(cloud: &Arc<PointCloud>, view: View, technique: Technique) -> Take {
    Take { cloud: Arc::clone(cloud), transform: DMat4::IDENTITY, view, style: plain(), technique }
}
