//! Sizes of the picture.

use std::sync::Arc;

use glam::Vec3;

use super::scenes::{ahead, blends, outside, random, random_colors, soup, take};
use super::{Case, Take};
use crate::load::PointCloud;
use crate::select::View;

const GROUP: &str = "viewports";

pub fn cases() -> Vec<Case> {
    let cloud = Arc::new(soup());
    let mut cases = Vec::new();
    for technique in blends() {
        for (width, height) in [(1, 1), (3, 2), (1, 97), (159, 113), (33, 255), (16_384, 1), (1, 16_384)] {
            let mut view = outside();
            // Square pixels; wide pictures see as much across as the others.
            let aspect = width as f64 / height as f64;
            let fov = if aspect > 4.0 { 2.0 * (0.6 / aspect).atan() } else { 0.8 };
            view.projection = View::perspective(fov, aspect, 0.01);
            let least = (width * height / 4).min(1000) as usize;
            let case = Case::new(GROUP, format!("{width}x{height}"), take(&cloud, view, technique));
            cases.push(case.size(width, height).covered(least));
        }
        // The smallest footprints, each alone in the picture, far from its middle: nothing forgives a displacement.
        for (width, height) in [(1920u32, 1080u32), (16_384, 16)] {
            let mut view = ahead(0.01);
            let half_height = 0.5;
            let aspect = width as f64 / height as f64;
            view.projection = View::perspective(2.0 * (half_height / aspect).atan(), aspect, 0.01);
            let take =
                Take { view, ..take(&Arc::new(dots(0.95 * half_height as f32, aspect as f32)), view, technique) };
            cases.push(Case::new(GROUP, format!("{width}x{height}, dots"), take).size(width, height).ties(20));
        }
    }
    cases
}

/// 4000 splats of 10⁻⁵ at linear depths of 2 to 4, up to `side` · depth from the middle, and 1 / `aspect` of that upwards.
fn dots(side: f32, aspect: f32) -> PointCloud {
    let mut state = 21;
    let mut place = || {
        let [x, y] = [side, side / aspect].map(|s| s * (2.0 * random(&mut state) - 1.0));
        let z = 2.0 + 2.0 * random(&mut state);
        Vec3::new(x * z, y * z, -z)
    };
    PointCloud {
        positions: (0..4000).map(|_| place()).collect(),
        radii: Some(vec![1e-5; 4000]),
        colors: Some(random_colors(4000)),
        ..PointCloud::default()
    }
}
