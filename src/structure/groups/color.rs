//! Greedy colouring, largest first (Leighton: A Graph Coloring Algorithm for Large Scheduling Problems, 1979).

use super::graph::{Graph, Splats};

const NONE: u16 = u16::MAX;

/// Colours of a cloud's points so far.
pub struct Coloring {
    of: Vec<u16>,
    limit: u16,
    /// Points that share a colour with a neighbour.
    pub conflicts: u64,
}

impl Coloring {
    /// Nothing is coloured but the first points, which have their colours. `limit` is 1 to 256.
    pub fn new(known: &[u8], points: usize, limit: u32) -> Coloring {
        let mut of: Vec<u16> = known.iter().map(|color| u16::from(*color)).collect();
        of.resize(points, NONE);
        Coloring { of, limit: limit as u16, conflicts: 0 }
    }

    /// Colours those splats that `is_new`; the others keep theirs.
    pub fn color(&mut self, splats: &Splats, graph: &Graph, is_new: impl Fn(usize) -> bool) {
        let mut new: Vec<(u32, u32, u32)> = (0..splats.len() as u32)
            .filter(|&rank| is_new(splats.index(rank) as usize))
            .map(|rank| (u32::MAX - graph.degree(rank), splats.index(rank), rank))
            .collect();
        new.sort_unstable();
        // By rank: neighbours are near each other in memory.
        let mut colors: Vec<u16> = (0..splats.len() as u32).map(|r| self.of[splats.index(r) as usize]).collect();
        for &(_, _, rank) in &new {
            let mut used = [0u64; 4];
            for &other in graph.neighbours(rank) {
                let color = colors[other as usize];
                if color != NONE {
                    used[color as usize / 64] |= 1 << (color % 64);
                }
            }
            let free = used.iter().zip(0u16..).find(|(word, _)| **word != u64::MAX);
            let free = free.map_or(256, |(word, at)| 64 * at + word.trailing_ones() as u16);
            colors[rank as usize] = if free < self.limit { free } else { self.least(graph.neighbours(rank), &colors) };
        }
        for &(_, index, rank) in &new {
            self.of[index as usize] = colors[rank as usize];
        }
    }

    /// The colour that the fewest neighbours have, of equals the first.
    fn least(&mut self, neighbours: &[u32], colors: &[u16]) -> u16 {
        self.conflicts += 1;
        let mut count = [0u32; 256];
        for &other in neighbours {
            if let Some(n) = count.get_mut(colors[other as usize] as usize) {
                *n += 1;
            }
        }
        (0..self.limit).min_by_key(|c| count[*c as usize]).unwrap_or(0)
    }

    pub fn of(&self, point: u32) -> u16 {
        self.of[point as usize]
    }

    /// Colours in use, at least 1.
    pub fn count(&self) -> u32 {
        self.of.iter().filter(|c| **c != NONE).max().map_or(1, |c| *c as u32 + 1)
    }

    /// What took no part gets the first.
    pub fn finish(self) -> Vec<u8> {
        self.of.into_iter().map(|c| if c == NONE { 0 } else { c as u8 }).collect()
    }
}
