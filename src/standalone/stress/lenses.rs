//! Where the viewer stands and what lens is used.

use std::sync::Arc;

use glam::{DVec3, Vec3, dvec3, dvec4};

use super::Case;
use super::scenes::{ASPECT, blends, look, sheet, soup, take};
use crate::load::PointCloud;
use crate::select::{DepthConvention, View};

const GROUP: &str = "viewer and lens";

pub fn cases() -> Vec<Case> {
    [surveyed(), ranges(), fields()].concat()
}

/// Two metres (seven feet) from a scene of two in the coordinates of a survey, Z up.
fn surveyed() -> Vec<Case> {
    let mut cases = Vec::new();
    for (name, origin) in [
        ("UTM", dvec3(5.0e5, 5.4e6, 312.0)),
        ("US feet", dvec3(2.0e6, 6.0e6, 1024.0)),
        ("both 6e6", dvec3(6.0e6, 6.0e6, 0.0)),
    ] {
        let lens = View::perspective(0.8, ASPECT, 0.01);
        let toward = |at: DVec3| {
            let back = dvec3(0.6, -0.75, 0.3).normalize();
            View::facing(at + 2.0 * back, back, DVec3::Z, lens, DepthConvention::Reversed)
        };
        // The cloud's own origin in the middle of what is seen, and at the corner of a tile of 1 km.
        let mut tile = soup();
        tile.positions.iter_mut().for_each(|p| *p += Vec3::new(812.0, 443.0, 21.0));
        for (where_from, cloud, at) in
            [("in the middle", soup(), origin), ("at a tile's corner", tile, origin + dvec3(812.0, 443.0, 21.0))]
        {
            let cloud = Arc::new(PointCloud { origin, ..cloud });
            for technique in blends() {
                let name = format!("{name} from 2 m, origin {where_from}");
                cases.push(Case::new(GROUP, name, take(&cloud, toward(at), technique)));
            }
        }
    }
    cases
}

/// far : near = 10⁶, finite, both conventions, with splats from the near plane to the far one.
fn ranges() -> Vec<Case> {
    let (near, far) = (1e-3, 1e3);
    let mut cloud = soup();
    let n = cloud.len() as f32;
    for (i, p) in cloud.positions.iter_mut().enumerate() {
        // Evenly spread over the octaves of depth, inside the pyramid.
        let z = 2e-3 * 4e5f32.powf(i as f32 / n);
        *p = Vec3::new(0.5 * z * p.x, 0.35 * z * p.y, -z);
        cloud.radii.as_mut().expect("radii")[i] *= 0.3 * z;
    }
    let cloud = Arc::new(cloud);
    let mut cases = Vec::new();
    for depth in [DepthConvention::Reversed, DepthConvention::Standard] {
        let mut projection = View::perspective(0.8, ASPECT, near);
        let (z, w) = match depth {
            DepthConvention::Standard => (-far / (far - near), -far * near / (far - near)),
            DepthConvention::Reversed => (near / (far - near), far * near / (far - near)),
        };
        (projection.z_axis.z, projection.w_axis.z) = (z, w);
        let view = View { view: glam::DMat4::IDENTITY, projection, depth };
        for technique in blends() {
            cases.push(Case::new(GROUP, format!("far : near = 1e6, {depth:?}"), take(&cloud, view, technique)));
        }
    }
    cases
}

fn fields() -> Vec<Case> {
    let (soup, sheet) = (Arc::new(soup()), Arc::new(sheet()));
    let from = dvec3(0.3, 0.5, 3.0);
    let back = from.normalize();
    let degree = View::perspective(1f64.to_radians(), ASPECT, 1.0);
    let wide = View::perspective(170f64.to_radians(), ASPECT, 0.001);
    let mut shifted = View::perspective(0.8, ASPECT, 0.01);
    (shifted.z_axis.x, shifted.z_axis.y) = (0.9, -0.7);
    let mut skewed = View::orthographic(2.5, ASPECT, 0.1, 10.0);
    skewed.z_axis += dvec4(0.1, 0.05, 0.0, 0.0);
    let views = [
        ("1 degree", look(115.0 * back, DVec3::ZERO, degree), 2e-5),
        ("170 degrees", look(0.2 * back, DVec3::ZERO, wide), 2e-5),
        ("off the axis", look(from, DVec3::ZERO, shifted), 2e-5),
        ("orthographic", look(from, DVec3::ZERO, View::orthographic(2.5, ASPECT, 0.1, 10.0)), 2e-5),
        ("oblique parallel", look(from, DVec3::ZERO, skewed), 2e-5),
    ];
    let mut cases = Vec::new();
    for (name, view, depth) in views {
        for technique in blends() {
            for (what, cloud) in [("soup", &soup), ("sheet", &sheet)] {
                let case =
                    Case::new(GROUP, format!("{name}, {what}"), take(cloud, view, technique)).depth(depth).covered(300);
                // 115 units away f32 resolves 1.4·10⁻⁵ units of depth, and neighbouring discs of the sheet cross at some
                // 0.05 rad: the nearer is open within 2.7·10⁻⁴ units, 0.015 px, to either side of one line every third
                // pixel.
                cases.push(if name == "1 degree" { case.ties(300) } else { case });
            }
        }
    }
    cases
}
