//! What of a cloud a view submits, and what of that is drawn.

use glam::DMat4;

use super::{DrawList, Sight, Span, View};
use crate::structure::Cloud;
use crate::structure::flat::Block;
use crate::style::{Interval, Style};

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
        Cloud::Octree(octree) => octree.select(sight, instance, list),
        Cloud::Sequential(tree) => tree.select(sight, style.interval, back_faces_culled, instance, list),
        Cloud::Hybrid(hybrid) => {
            hybrid.triangles.select(sight, instance, list);
            hybrid.tree.select(sight, style.interval, back_faces_culled, instance, list);
        }
        // Its patches come and go: `select::layered`.
        Cloud::Layered(_) => {}
    }
}

/// What a frame of these instances draws: the cut, and in it the points that pass where a structure is tested point by
/// point. For the reference; the device finds the same.
pub fn drawn(instances: &[(&Cloud, DMat4)], view: &View, extent: [u32; 2], style: &Style) -> DrawList {
    let mut list = DrawList::default();
    for (instance, (cloud, transform)) in (0..).zip(instances) {
        let sight = Sight::new(view, extent, transform, cloud.flat().origin, style);
        let mut submitted = DrawList::default();
        cut(cloud, &sight, style, false, instance, &mut submitted);
        submitted.triangles.iter().for_each(|span| list.push_triangles(*span));
        let Some(nodes) = cloud.nodes() else {
            submitted.spans.into_iter().for_each(|span| list.push(span));
            continue;
        };
        let test = sight.test();
        for span in submitted.spans {
            for first in span.first..span.first + span.count {
                let i = first as usize;
                let selected = match style.interval {
                    Interval::Exact => test.selects(nodes, i),
                    Interval::Published => test.selects_published(nodes, i, cloud.flat().position(first)),
                };
                if selected {
                    list.push(Span { first, count: 1, ..span });
                }
            }
        }
    }
    list
}
