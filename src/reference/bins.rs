//! Which splats may touch which tile.

use rayon::prelude::*;

use super::Counts;
use super::splat::{Fate, Setup};

/// Side of a tile \[px\]: a footprint of 4 px falls into 1.3 tiles on average, and a tile's state stays in the L2 cache.
pub const TILE: u32 = 32;

/// Numbers of the splats that may touch each tile, in draw order: 4 B each, and 20 B a splat while they are made.
pub struct Bins {
    /// First entry of each tile, and the end.
    starts: Vec<usize>,
    splats: Vec<u32>,
    pub counts: Counts,
}

impl Bins {
    pub fn new(setup: &Setup) -> Bins {
        let camera = &setup.camera;
        let (columns, rows) = (camera.width.div_ceil(TILE), camera.height.div_ceil(TILE));
        // Range of tiles and fate of every splat; an empty range has equal ends.
        let ranges: Vec<([u32; 4], u8)> = (0..setup.len())
            .into_par_iter()
            .with_min_len(1024)
            .map(|number| {
                let (bound, fate) = match setup.item(number) {
                    Fate::Invalid => (None, 0),
                    Fate::Away(ghost) => (ghost.filter(|_| setup.margin > 0.0).map(|g| g.1), 1),
                    Fate::Outside => (None, 2),
                    Fate::Drawn(_, bound) => (Some(bound), 3),
                    Fate::Face(_, bound) => (Some(bound), 4),
                    Fate::NoFace => (None, 4),
                };
                let tiles = bound.map_or([0; 4], |bound| {
                    let [x0, y0, x1, y1] = bound.pixels(camera);
                    if x0 >= x1 || y0 >= y1 {
                        return [0; 4];
                    }
                    [x0 / TILE, y0 / TILE, x1.div_ceil(TILE), y1.div_ceil(TILE)]
                });
                (tiles, fate)
            })
            .collect();

        let mut fates = [0u64; 5];
        let mut starts = vec![0usize; columns as usize * rows as usize + 1];
        let each = |[x0, y0, x1, y1]: [u32; 4]| {
            (y0..y1).flat_map(move |y| (x0..x1).map(move |x| y as usize * columns as usize + x as usize))
        };
        for &(range, fate) in &ranges {
            fates[fate as usize] += 1;
            each(range).for_each(|tile| starts[tile + 1] += 1);
        }
        for tile in 1..starts.len() {
            starts[tile] += starts[tile - 1];
        }
        let mut next = starts.clone();
        let mut splats = vec![0; starts[starts.len() - 1]];
        for (number, &(range, _)) in ranges.iter().enumerate() {
            for tile in each(range) {
                splats[next[tile]] = number as u32;
                next[tile] += 1;
            }
        }
        let counts = Counts {
            submitted: setup.len() as u64 - fates[4],
            culled_invalid: fates[0],
            culled_cone: fates[1],
            culled_frustum: fates[2],
            drawn: fates[3],
        };
        Bins { starts, splats, counts }
    }

    /// Those of one tile; tiles count along rows.
    pub fn tile(&self, tile: usize) -> &[u32] {
        &self.splats[self.starts[tile]..self.starts[tile + 1]]
    }
}
