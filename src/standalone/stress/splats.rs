//! Radii, normals and places of single splats.

use std::sync::Arc;

use glam::{DMat4, Vec3};

use super::scenes::{ahead, blends, outside, plain, sheet, soup, splats, take};
use super::{Case, Take};
use crate::load::PointCloud;
use crate::style::{BackFaces, Style};

pub fn cases() -> Vec<Case> {
    [radii(), normals(), near_plane()].concat()
}

fn radii() -> Vec<Case> {
    const GROUP: &str = "radii";
    let with = |radii: &[f32]| {
        let mut cloud = soup();
        cloud.radii.as_mut().expect("radii")[..radii.len()].copy_from_slice(radii);
        Arc::new(cloud)
    };
    let clouds = [
        ("zero", with(&[0.0, -0.0])),
        ("negative", with(&[-1.0, -1e-30, f32::MIN])),
        ("NaN", with(&[f32::NAN, -f32::NAN])),
        ("infinite", with(&[f32::INFINITY, f32::NEG_INFINITY])),
        ("subnormal and near the largest", with(&[1e-40, 1e-38, 1e-20, 1e20, 1e29])),
        ("larger than the viewport", with(&[3.0, 30.0, 300.0])),
    ];
    let mut cases = Vec::new();
    for technique in blends() {
        for (name, cloud) in &clouds {
            cases.push(Case::new(GROUP, *name, take(cloud, outside(), technique)));
        }
        // 46 px a unit: footprints of 0.003 px about 1600 places, 2 × 2 pixels of low-pass each.
        let tiny = Style { radius_scale: 1e-3, ..plain() };
        let sheet = take(&Arc::new(sheet()), outside(), technique);
        cases.push(match technique.blend {
            // Hard discs keep the low-pass's pixel; their rims are ties where they meet pixel centres.
            crate::technique::Blend::Opaque => Case::new(GROUP, "0.01 px", Take { style: tiny, ..sheet }),
            _ => Case::new(GROUP, "0.01 px", Take { style: tiny, ..sheet }),
        });
    }
    cases
}

fn normals() -> Vec<Case> {
    const GROUP: &str = "normals";
    let mut cases = Vec::new();
    for technique in blends() {
        let unit = take(&Arc::new(sheet()), outside(), technique);
        // Powers of two: the direction keeps every bit, so nothing may change.
        for (name, length) in [
            ("of length 1e-3", 2f32.powi(-10)),
            ("of length 1e3", 2f32.powi(10)),
            ("of length 1e-30", 2f32.powi(-100)),
            ("of length 1e30", 2f32.powi(100)),
        ] {
            let mut cloud = sheet();
            cloud.normals.as_mut().expect("normals").iter_mut().for_each(|n| *n *= length);
            cases.push(Case::new(GROUP, name, take(&Arc::new(cloud), outside(), technique)).twin(unit.clone(), 0.0));
        }
        // What is no direction is no normal: the picture of a cloud without normals.
        for (name, normal) in [("zero", Vec3::ZERO), ("NaN", Vec3::NAN), ("infinite", Vec3::INFINITY)] {
            let with = |normals| take(&Arc::new(PointCloud { normals, ..sheet() }), outside(), technique);
            cases.push(Case::new(GROUP, name, with(Some(vec![normal; 1600]))).twin(with(None), 0.0));
        }
        // Disks about the optical axis and off it, turned away from edge-on by so much.
        for angle in [0.0, 1e-6, 1e-5, 1e-3, -1e-6, -1e-3] {
            let disk = |x: f32, y: f32| {
                let to = Vec3::new(x, y, -3.0);
                let across = to.cross(Vec3::new(0.3, 1.0, 0.2)).normalize();
                let normal = across + angle * to.normalize();
                (to.to_array(), normal.to_array(), 0.4)
            };
            let list: Vec<_> = (0..12).map(|i| disk(0.5 * (i % 4) as f32 - 0.7, 0.45 * (i / 4) as f32 - 0.4)).collect();
            let cloud = Arc::new(splats(&list));
            for (what, back_faces) in [("", BackFaces::Draw), (", away dropped", BackFaces::Cull)] {
                let style = Style { back_faces, ..plain() };
                let take = Take { style, ..take(&cloud, ahead(0.01), technique) };
                let least = if back_faces == BackFaces::Draw { 10 } else { 0 };
                // Depth changes by up to 19 units a pixel at 10⁻³ rad, and places are good to 1.8·10⁻⁵ px at 3 units.
                cases.push(
                    Case::new(GROUP, format!("edge-on by {angle:e} rad{what}"), take).covered(least).depth(1.2e-4),
                );
            }
        }
        let mut away = sheet();
        away.normals.as_mut().expect("normals").iter_mut().for_each(|n| *n = -*n);
        let away = Arc::new(away);
        cases.push(Case::new(GROUP, "facing away, drawn", take(&away, outside(), technique)));
        let culled =
            Take { style: Style { back_faces: BackFaces::Cull, ..plain() }, ..take(&away, outside(), technique) };
        cases.push(Case::new(GROUP, "facing away, dropped", culled).covered(0));
    }
    cases
}

/// Near plane at 1; the picture is 0.85 high there.
fn near_plane() -> Vec<Case> {
    const GROUP: &str = "near plane";
    let tilted = [0.3, 0.2, 1.0];
    let step = f32::EPSILON;
    let lists: Vec<(&str, Vec<_>, usize)> = vec![
        ("centres behind it", vec![([0.0, 0.0, -0.5], tilted, 0.2), ([0.0, 0.0, 1.0], tilted, 0.3)], 0),
        (
            "a rim reaches through",
            vec![([0.0, 0.0, -0.9], [1.0, 0.3, 0.3], 0.5), ([0.2, 0.2, -0.8], [0.2, 1.0, 0.3], 0.4)],
            400,
        ),
        ("centre on it", vec![([0.0, 0.0, -1.0], tilted, 0.2), ([0.2, 0.1, -1.0], [0.0, 0.0, 1.0], 0.2)], 500),
        (
            "centres one bit to either side",
            vec![([-0.2, 0.0, -1.0 - step], tilted, 0.2), ([0.2, 0.1, -1.0 + 0.5 * step], tilted, 0.2)],
            500,
        ),
        ("just before it", vec![([0.0, 0.0, -1.000_01], tilted, 0.3), ([0.2, 0.1, -1.001], [1.0, 1.0, 0.2], 0.2)], 500),
        (
            "across w = 0",
            vec![([0.0, -0.3, -0.5], [0.1, 1.0, 0.1], 3.0), ([0.4, 0.0, 0.5], [-1.0, 0.2, 0.1], 4.0)],
            500,
        ),
        (
            "through the eye",
            vec![([0.0, 0.0, -2.0], [0.0, 1.0, 1e-3], 5.0), ([0.5, 0.5, -3.0], [0.3, 0.1, 1.0], 0.5)],
            200,
        ),
        (
            "seen from 1e-3 above",
            vec![([0.0, -1e-3, -2.0], [0.0, 1.0, 0.0], 5.0), ([0.5, 0.5, -3.0], [0.3, 0.1, 1.0], 0.5)],
            200,
        ),
    ];
    let mut cases = Vec::new();
    for technique in blends() {
        for (name, list, covered) in &lists {
            let take = take(&Arc::new(splats(list)), ahead(1.0), technique);
            cases.push(Case::new(GROUP, *name, take).covered(*covered));
        }
        // The same in another place and unit.
        let placed = Take {
            transform: DMat4::from_scale(glam::DVec3::splat(1e4)),
            view: ahead(1e4),
            ..take(&Arc::new(splats(&lists[5].1)), ahead(1.0), technique)
        };
        cases.push(Case::new(GROUP, "across w = 0 at 1e4 of its size", placed).covered(500));
    }
    cases
}
