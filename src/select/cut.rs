//! What of a cloud a view submits.

use super::{DrawList, Sight, Span};
use crate::structure::Cloud;
use crate::structure::flat::Block;
use crate::style::Style;

/// Adds the spans of one instance to `list`: no work a point, what is tested point by point is left to others.
/// `back_faces_culled`: what faces away is not drawn anyway.
pub fn cut(cloud: &Cloud, sight: &Sight, style: &Style, back_faces_culled: bool, instance: u32, list: &mut DrawList) {
    match cloud {
        Cloud::Flat(flat) => {
            let all = Block::around(&flat.blocks);
            if !sight.misses(all.min, all.max, all.radius) {
                list.push(Span { instance, first: 0, count: flat.len() as u32, least: 0.0 });
            }
        }
    }
    let _ = (style, back_faces_culled);
}
