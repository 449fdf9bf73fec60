//! Farthest-first order (Gonzalez 1985; of images Eldar, Lindenbaum, Porat, Zeevi 1997): each next point is the one farthest from
//! all before it. Every start of that order is a Poisson-disk sample: with r the next point's distance, no two of it are nearer
//! to each other than r, and no point is farther from all of it than r.
//!
//! Points lie in a tree of boxes, eight to a box, with the greatest distance that is left in each. A new point visits the
//! boxes that are nearer to it than that. On a surface those hold some n / i points for the i-th, so that the work is n log n.

use glam::Vec3;

const WIDE: usize = 8;

/// Boxes, or points, which are boxes without size.
#[derive(Clone, Copy)]
struct Node {
    low: [[f32; WIDE]; 3],
    high: [[f32; WIDE]; 3],
    /// Squared distance to the nearest point chosen, the greatest in the box; less than 0 where there is none.
    left: [f32; WIDE],
}

impl Node {
    const EMPTY: Node =
        Node { low: [[f32::INFINITY; WIDE]; 3], high: [[f32::NEG_INFINITY; WIDE]; 3], left: [-1.0; WIDE] };

    fn hold(&mut self, at: usize, low: Vec3, high: Vec3, left: f32) {
        for axis in 0..3 {
            self.low[axis][at] = low[axis];
            self.high[axis][at] = high[axis];
        }
        self.left[at] = left;
    }

    fn bounds(&self) -> [Vec3; 2] {
        let least = |values: &[f32; WIDE]| values.iter().copied().fold(f32::INFINITY, f32::min);
        let most = |values: &[f32; WIDE]| values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        [Vec3::from_array(self.low.each_ref().map(least)), Vec3::from_array(self.high.each_ref().map(most))]
    }

    /// Squared distances. Rounding is monotonic: never more than that of a point within.
    fn distances(&self, q: [f32; 3]) -> [f32; WIDE] {
        let mut sum = [0.0; WIDE];
        for ((low, high), q) in self.low.iter().zip(&self.high).zip(q) {
            for ((sum, low), high) in sum.iter_mut().zip(low).zip(high) {
                // As comparisons, which compile to one instruction each: no number here is none.
                let (below, above) = (low - q, q - high);
                let away = if below > above { below } else { above };
                let away = if away > 0.0 { away } else { 0.0 };
                *sum += away * away;
            }
        }
        sum
    }

    /// Where the farthest is; of equals the first.
    fn farthest(&self) -> (usize, f32) {
        let mut best = (0, self.left[0]);
        for (at, &left) in self.left.iter().enumerate().skip(1) {
            if left > best.1 {
                best = (at, left);
            }
        }
        best
    }
}

/// Points, and how far each is from those chosen.
struct Tree {
    /// Nodes of points first, the root last.
    levels: Vec<Vec<Node>>,
}

impl Tree {
    /// Of at least one point.
    fn new(points: &[Vec3]) -> Tree {
        let mut boxes: Vec<[Vec3; 2]> = points.iter().map(|p| [*p, *p]).collect();
        let mut levels = Vec::new();
        while levels.is_empty() || boxes.len() > 1 {
            let nodes: Vec<Node> = boxes
                .chunks(WIDE)
                .map(|children| {
                    let mut node = Node::EMPTY;
                    let held = children.iter().enumerate();
                    held.for_each(|(at, [low, high])| node.hold(at, *low, *high, f32::INFINITY));
                    node
                })
                .collect();
            boxes = nodes.iter().map(Node::bounds).collect();
            levels.push(nodes);
        }
        Tree { levels }
    }

    /// The point that is farthest from those chosen, and its squared distance.
    fn farthest(&self) -> (usize, f32) {
        let mut index = 0;
        let mut left = -1.0;
        for nodes in self.levels.iter().rev() {
            let (at, most) = nodes[index].farthest();
            index = WIDE * index + at;
            left = most;
        }
        (index, left)
    }

    /// A chosen point. Returns the greatest squared distance left below a node.
    fn choose(&mut self, level: usize, index: usize, q: [f32; 3]) -> f32 {
        let node = &mut self.levels[level][index];
        let near = node.distances(q);
        if level == 0 {
            for (left, near) in node.left.iter_mut().zip(near) {
                *left = if near < *left { near } else { *left };
            }
            return node.farthest().1;
        }
        let left = node.left;
        for at in 0..WIDE {
            if near[at] < left[at] {
                let below = self.choose(level - 1, WIDE * index + at, q);
                self.levels[level][index].left[at] = below;
            }
        }
        self.levels[level][index].farthest().1
    }
}

/// Calls `chosen(index, squared distance to the nearest before it)` in farthest-first order, for the first point with infinity,
/// and ends before points that lie where others do. Neighbours in `points` should be neighbours in space.
pub(super) fn farthest_first(points: &[Vec3], mut chosen: impl FnMut(usize, f32)) {
    if points.is_empty() {
        return;
    }
    let mut tree = Tree::new(points);
    let root = tree.levels.len() - 1;
    loop {
        let (index, left) = tree.farthest();
        if left <= 0.0 {
            return;
        }
        chosen(index, left);
        tree.choose(root, 0, points[index].to_array());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As defined: all distances, anew for each.
    fn slowly(points: &[Vec3]) -> Vec<(usize, f32)> {
        let mut left = vec![f32::INFINITY; points.len()];
        let mut order = Vec::new();
        loop {
            let farthest =
                left.iter().enumerate().fold((0, -1.0), |best, (i, l)| if *l > best.1 { (i, *l) } else { best });
            if farthest.1 <= 0.0 {
                return order;
            }
            order.push(farthest);
            for (left, p) in left.iter_mut().zip(points) {
                let d = *p - points[farthest.0];
                *left = left.min(d.x * d.x + d.y * d.y + d.z * d.z);
            }
        }
    }

    #[test]
    fn the_order_is_the_one_defined() {
        let mut state = 1u64;
        let mut unit = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f32 / (1u64 << 31) as f32
        };
        for n in [0, 1, 2, 7, 8, 9, 64, 65, 700] {
            // In no order of space at all, some of them twice, and on a grid, where many are equally far.
            let mut points: Vec<Vec3> = (0..n).map(|_| Vec3::new(unit(), 3.0 * unit(), 0.1 * unit())).collect();
            points.extend_from_within(..n / 3);
            points.extend((0..n / 2).map(|i| Vec3::new((i % 10) as f32, (i / 10) as f32, 0.0)));
            let mut order = Vec::new();
            farthest_first(&points, |i, d| order.push((i, d)));
            assert_eq!(order, slowly(&points), "{n}");
        }
    }
}
