//! Sizes of the picture.

use std::sync::Arc;

use super::scenes::{both, outside, plain, soup, take};
use super::{Case, Take};
use crate::select::View;
use crate::style::Style;

const GROUP: &str = "viewports";

pub fn cases() -> Vec<Case> {
    let cloud = Arc::new(soup());
    let mut cases = Vec::new();
    for technique in both() {
        for (width, height) in [(1, 1), (3, 2), (1, 97), (159, 113), (33, 255), (16_384, 1), (1, 16_384)] {
            let mut view = outside();
            // Square pixels; a long side sees as much as the others, and footprints keep a size of pixels.
            let aspect = width as f64 / height as f64;
            let fov = if aspect > 4.0 { 2.0 * (0.42 / aspect * 1.4).atan() } else { 0.8 };
            view.projection = View::perspective(fov, aspect, 0.01);
            let style = Style { radius_scale: 1.0, ..plain() };
            let take = Take { style, view, ..take(&cloud, view, technique) };
            let least = (width * height / 4).min(1000) as usize;
            cases.push(Case::new(GROUP, format!("{width}x{height}"), take).size(width, height).covered(least));
        }
    }
    cases
}
