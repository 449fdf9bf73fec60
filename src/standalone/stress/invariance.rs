//! The same picture whatever the unit of length and wherever the scene stands, in any order, in either depth convention.

use std::sync::Arc;

use glam::{DMat4, DVec3, Vec3, dvec3};

use super::scenes::{ASPECT, ahead, blends, look, outside, plain, sheet, soup, take};
use super::{Case, TARGET, Take};
use crate::load::PointCloud;
use crate::select::{DepthConvention, View};
use crate::style::{Shading, Style};
use crate::technique::Blend;

const GROUP: &str = "invariance";

pub fn cases() -> Vec<Case> {
    [scaled(), moved(), permuted(), conventions()].concat()
}

/// By the instance's transform (every bit of the data stays) and in the data (each number is rounded anew).
fn scaled() -> Vec<Case> {
    let cloud = Arc::new(soup());
    let mut cases = Vec::new();
    for scale in [1e-6, 1e-3, 1e3, 1e6] {
        let far = dvec3(0.3, 0.5, 3.0);
        let view = look(scale * far, DVec3::ZERO, View::perspective(0.8, ASPECT, 0.01 * scale));
        for technique in blends() {
            let unscaled = take(&cloud, outside(), technique);
            let transform = DMat4::from_scale(DVec3::splat(scale));
            let placed = Take { transform, view, ..unscaled.clone() };
            cases.push(
                Case::new(GROUP, format!("placed at {scale:e} of its size"), placed).twin(unscaled.clone(), TARGET),
            );
            let by = |v: f32| (v as f64 * scale) as f32;
            let stored = PointCloud {
                positions: cloud.positions.iter().map(|p| (p.as_dvec3() * scale).as_vec3()).collect(),
                radii: cloud.radii.as_ref().map(|r| r.iter().map(|&r| by(r)).collect()),
                ..soup()
            };
            let stored = take(&Arc::new(stored), view, technique);
            cases.push(Case::new(GROUP, format!("stored at {scale:e} of its size"), stored).twin(unscaled, TARGET));
        }
    }
    cases
}

/// View and cloud by so many times the scene's extent, 2.
fn moved() -> Vec<Case> {
    let mut cases = Vec::new();
    for times in [1.0, 1e3, 1e6, 1e9] {
        let by = 2.0 * times * dvec3(1.0, -0.7, 0.3);
        let eye = dvec3(0.3, 0.5, 3.0);
        let at = |o: DVec3| {
            let lens = View::perspective(0.8, ASPECT, 0.01);
            // Subtracting far points would round the direction.
            View::facing(o + eye, eye.normalize(), DVec3::Y, lens, DepthConvention::Reversed)
        };
        let cloud = Arc::new(PointCloud { origin: by, ..soup() });
        for technique in blends() {
            let unmoved = take(&Arc::new(soup()), at(DVec3::ZERO), technique);
            let case = Case::new(GROUP, format!("moved by {times:e} extents"), take(&cloud, at(by), technique));
            cases.push(if times < 1e8 {
                case.twin(unmoved, TARGET)
            } else {
                // Eight roundings of f64, 2⁻⁵³ · 2.5·10⁹ each, 46 px a unit there: δ = 10⁻⁴ px.
                let why = "f64 itself: positions of 2.5e9 are rounded by 2.8e-7 units, eight times, at 46 px a unit";
                case.bound(6e-4, why).depth(4e-5).ties(20).twin(unmoved, 6e-4)
            });
        }
    }
    cases
}

fn permuted() -> Vec<Case> {
    blends()
        .into_iter()
        .filter(|t| t.blend != Blend::Fuzzy)
        .flat_map(|technique| {
            [("soup", soup()), ("sheet", sheet())].map(|(name, cloud)| {
                let turn = |v: &[Vec3]| v.iter().rev().copied().collect::<Vec<_>>();
                let mut back = cloud.clone();
                back.positions = turn(&cloud.positions);
                back.normals = cloud.normals.as_deref().map(turn);
                back.radii = cloud.radii.as_ref().map(|r| r.iter().rev().copied().collect());
                back.colors = cloud.colors.as_ref().map(|c| c.iter().rev().copied().collect());
                let back = take(&Arc::new(back), outside(), technique);
                // At most 60 terms meet in a pixel, and two sums of n terms in f32 differ by 2 n 2⁻²⁴, two such sums divided.
                Case::new(
                    GROUP,
                    format!("{name} back to front of the file"),
                    take(&Arc::new(cloud), outside(), technique),
                )
                .twin(back, 4.0 * 60.0 / (1 << 24) as f64)
            })
        })
        .collect()
}

/// Standard against reversed depth, left- against right-handed, mirrored twice.
fn conventions() -> Vec<Case> {
    let cloud = Arc::new(soup());
    let mut standard = outside();
    (standard.projection.z_axis.z, standard.projection.w_axis.z) = (-1.0, -0.01);
    standard.depth = DepthConvention::Standard;
    let mirror = DMat4::from_scale(dvec3(1.0, 1.0, -1.0));
    let mut left = outside();
    (left.view, left.projection) = (mirror * left.view, left.projection * mirror);
    let lit = Style { shading: Shading::HEADLIGHT, ..plain() };
    let mut cases = Vec::new();
    for technique in blends() {
        let right = take(&cloud, outside(), technique);
        for (name, view) in [("standard depth", standard), ("left-handed", left)] {
            // Internal depth, and so every decision, is the same: no bit changes.
            cases.push(Case::new(GROUP, name, take(&cloud, view, technique)).twin(right.clone(), 0.0));
        }
        // The mean normal moves as a colour does, by up to 2 across: three times the bound.
        let lit =
            Take { style: lit, view: ahead(0.01), transform: DMat4::from_translation(dvec3(0.0, 0.0, -3.0)), ..right };
        cases.push(
            Case::new(GROUP, "lit at the origin", lit).bound(3.0 * TARGET, "colour and mean normal: three times 1e-4"),
        );
    }
    cases
}
