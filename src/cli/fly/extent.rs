//! What a model's index says about its shape: where cameras may fly, before any patch is read.

use glam::DVec3;

use surfel::structure::layered::Index;

use super::super::camera;

/// A leaf's ball, in the world.
#[derive(Debug, Clone, Copy)]
pub struct Leaf {
    pub centre: DVec3,
    pub ball: f64,
    spacing: f64,
    samples: u64,
}

/// A model as a box that stands upright.
#[derive(Debug)]
pub struct Extent {
    /// Middle of the box [world].
    pub centre: DVec3,
    /// Half its sides along `axes`, each more than 0.
    pub half: [f64; 3],
    /// Unit vectors: along the longer horizontal side, across it, up.
    pub axes: [DVec3; 3],
    /// Spacing where half of the samples lie at less.
    pub spacing: f64,
    pub leaves: Vec<Leaf>,
}

/// The value below which a share `q` of the weight lies, of at least one.
fn weighted(mut values: Vec<(f64, u64)>, q: f64) -> f64 {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let all: u64 = values.iter().map(|v| v.1).sum();
    let mut below = 0;
    let found = values.iter().find(|v| {
        below += v.1;
        below as f64 >= q * all as f64
    });
    found.or(values.last()).map_or(0.0, |v| v.0)
}

impl Extent {
    /// The box leaves out what lies beyond the 1 and 99 percentiles along its axes, so that far outliers do not matter; leaves count
    /// by their samples. `None` for a model without nodes.
    pub fn of(index: &Index, up: DVec3) -> Option<Extent> {
        let leaves: Vec<Leaf> = index
            .nodes
            .iter()
            .filter(|node| node.children().next().is_none())
            .map(|node| Leaf {
                centre: index.origin + node.centre.as_dvec3(),
                ball: node.ball as f64,
                spacing: node.spacing as f64,
                samples: node.samples.max(1) as u64,
            })
            .collect();
        let root = index.nodes.first()?;
        let ahead = camera::forward(up);
        let side = |axis: DVec3| {
            let ends =
                |sign: f64| leaves.iter().map(move |l| (l.centre.dot(axis) + sign * l.ball, l.samples)).collect();
            [weighted(ends(-1.0), 0.01), weighted(ends(1.0), 0.99)]
        };
        let mut axes = [ahead, up.cross(ahead), up];
        let mut sides = axes.map(side);
        if sides[1][1] - sides[1][0] > sides[0][1] - sides[0][0] {
            axes.swap(0, 1);
            sides.swap(0, 1);
        }
        // Points all in one place have no size; any will do.
        let least = 1e-9 * root.spacing.max(f32::MIN_POSITIVE) as f64;
        let spacing = weighted(leaves.iter().map(|l| (l.spacing, l.samples)).collect(), 0.5);
        Some(Extent {
            centre: (0..3).map(|i| axes[i] * (0.5 * (sides[i][0] + sides[i][1]))).sum(),
            half: sides.map(|[low, high]| (0.5 * (high - low)).max(least)),
            axes,
            spacing,
            leaves,
        })
    }

    /// Half the box's diagonal.
    pub fn radius(&self) -> f64 {
        DVec3::from(self.half).length()
    }

    /// The lowest tenth of the samples lie below this height, of those in leaves no farther than `reach` from a vertical line through
    /// `place`; where there are none, of the nearest leaf.
    pub fn ground(&self, place: DVec3, reach: f64) -> f64 {
        let up = self.axes[2];
        let aside = |l: &Leaf| {
            let off = l.centre - place;
            (off - up * off.dot(up)).length()
        };
        let near: Vec<(f64, u64)> =
            self.leaves.iter().filter(|l| aside(l) <= reach).map(|l| (l.centre.dot(up), l.samples)).collect();
        if near.is_empty() {
            let nearest = self.leaves.iter().min_by(|a, b| aside(a).total_cmp(&aside(b)));
            return nearest.map_or(0.0, |l| l.centre.dot(up));
        }
        weighted(near, 0.1)
    }

    /// The leaf that is farthest along the unit vector `out`, four times as much counted as how far it lies aside of a line through
    /// the middle: on the surface, and about where that line meets it.
    pub fn surface(&self, out: DVec3) -> Leaf {
        let value = |l: &&Leaf| {
            let off = l.centre - self.centre;
            let along = off.dot(out);
            along - 4.0 * (off - out * along).length()
        };
        // Of equal ones the last, as `max_by` has it: the order of leaves is the file's.
        *self.leaves.iter().max_by(|a, b| value(a).total_cmp(&value(b))).expect("an index with a root has a leaf")
    }
}
