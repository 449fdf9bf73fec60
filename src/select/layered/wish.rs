//! What is fetched, and in which order.

use super::{Cut, Room};

/// A patch that a view lacks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wish {
    /// Number in the index.
    pub node: u32,
    /// Where its patch lies in the file.
    pub at: u64,
    /// Bytes of its patch in the file.
    pub bytes: u32,
    /// By how many thresholds its parent is too coarse on the screen, times 1 in the picture's middle to ½ at its border: more
    /// than 0. For what is fetched ahead by how many it is too fine, over that share, negative: 0 at most. ∞ where the eye is
    /// within the parent's ball, and for the root. Never NaN.
    pub priority: f32,
}

/// Wishes of all views of a model in the order in which they are fetched: the highest priority that any view has for a patch, ties
/// by number, which is coarse to fine and then along the curve. The same for any order of cuts.
pub fn wishes<'a>(cuts: impl IntoIterator<Item = &'a Cut>) -> Vec<Wish> {
    let mut all: Vec<Wish> = cuts.into_iter().flat_map(|cut| &cut.wishes).copied().collect();
    all.sort_unstable_by(|a, b| a.node.cmp(&b.node).then(b.priority.total_cmp(&a.priority)));
    all.dedup_by_key(|wish| wish.node);
    all.sort_unstable_by(|a, b| b.priority.total_cmp(&a.priority).then(a.node.cmp(&b.node)));
    all
}

/// How many wishes from the first on are fetched in a frame: as many as `bytes` and the cache's room allow, so that nothing is
/// fetched that could not stay. The first is always within the bytes, however large; none is left out for a later one that
/// would fit.
pub fn affordable(wishes: &[Wish], bytes: u64, room: Room) -> usize {
    let mut sum = 0;
    let fits = |(i, wish): &(usize, &Wish)| {
        sum += wish.bytes as u64;
        let places = if wish.priority > 0.0 { room.wanted } else { room.prefetch };
        (sum <= bytes || *i == 0) && *i < places as usize
    };
    wishes.iter().enumerate().take_while(fits).count()
}
