//! 3D Gaussian splats (Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering", 2023) as trained
//! and written by its many implementations: logarithms of scales, logits of opacities, quaternions with w first.
//!
//! A Gaussian becomes the disk that it nearly always is: across its shortest axis, of 1.5 times the geometric mean of
//! its two longer standard deviations. Ours falls to 1/16 at the rim; theirs is at e^(−1.125) = 0.32 there, so this
//! keeps the core and leaves the faint skirt, which only blurs where splats are blended as surfaces.

use glam::{Quat, Vec3};

use super::table::Table;
use crate::load::PointCloud;

pub(super) const NAMES: [&str; 11] =
    ["f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];

/// Splats that are fainter are dropped: they change no 8-bit value.
const INVISIBLE: f32 = 1.0 / 255.0;
/// Y_0^0, the constant spherical harmonic.
const HARMONIC: f64 = 0.282_094_791_773_878_14;
const RADIUS: f64 = 1.5;

pub(super) fn is_known(name: &str) -> bool {
    NAMES.contains(&name)
}

/// Fills `cloud` if the rows are Gaussians. What must go gets a NaN position, which is dropped later.
pub(super) fn read(rows: &Table, cloud: &mut PointCloud) -> bool {
    let Some(fields) = rows.fields(NAMES) else { return false };
    let [r, g, b, opacity, scale @ .., _, _, _, _] = fields;
    let [.., w, x, y, z] = fields;
    let scale: [_; 3] = scale;
    let channel = |v: f64| ((0.5 + HARMONIC * v) * 255.0).round().clamp(0.0, 255.0) as u8;
    let [red, green, blue] = [r, g, b].map(|f| rows.column(f, 0, channel));
    let opacity = rows.column(opacity, 0.0, |v| (1.0 / (1.0 + (-v).exp())) as f32);
    let sizes = scale.map(|f| rows.column(f, 0.0, f64::exp));
    let turns = [x, y, z, w].map(|f| rows.column(f, 0.0, |v| v as f32));
    let n = rows.rows();
    let (mut faint, mut sizeless, mut unturned) = (0, 0, 0);
    let (mut normals, mut radii) = (Vec::with_capacity(n), Vec::with_capacity(n));
    for i in 0..n {
        let mut axes = [0, 1, 2].map(|k| (sizes[k][i], k));
        // Stable, so that of equal axes the first is the normal, everywhere.
        axes.sort_by(|a, b| a.0.total_cmp(&b.0));
        let radius = ((axes[1].0 * axes[2].0).sqrt() * RADIUS) as f32;
        let turn = Quat::from_array([0, 1, 2, 3].map(|k| turns[k][i]));
        let square = turn.length_squared();
        let turned = square.is_finite() && square > 0.0;
        let normal = if turned { turn.normalize() * Vec3::AXES[axes[0].1] } else { Vec3::ZERO };
        normals.push(normal.normalize_or_zero());
        radii.push(radius);
        if !cloud.positions[i].is_finite() {
            continue;
        }
        let seen = opacity[i] >= INVISIBLE;
        let sized = radius.is_finite() && radius > 0.0;
        faint += u64::from(!seen);
        sizeless += u64::from(seen && !sized);
        unturned += u64::from(seen && sized && !turned);
        if !(seen && sized) {
            cloud.positions[i] = Vec3::NAN;
        }
    }
    cloud.colors = Some(red.into_iter().zip(green).zip(blue).map(|((r, g), b)| [r, g, b]).collect());
    cloud.normals = Some(normals);
    cloud.radii = Some(radii);
    cloud.opacity = Some(opacity);
    cloud.up = Some(Vec3::NEG_Y);
    let report = &mut cloud.report;
    report.drop("splats fainter than 1/255", faint);
    report.drop("splats without a finite size", sizeless);
    report.repair("splats without a rotation: they face the viewer", unturned);
    report.assume("Gaussian splats become disks across their shortest axis; either side may be the front");
    report.assume("a disk's radius is 1.5 times the geometric mean of the two longer standard deviations");
    report.assume("y points down, as in trained splat scenes");
    true
}
