//! Groups of splats without self-overlap: the colouring of the overlap graph (Zhang, Pajarola: Single-Pass Point Rendering
//! and Transparent Shading, 2006, section 4.1).
//!
//! Two splats overlap where |p_i − p_j| < r_i + r_j. The graph has an edge for each pair that must not share a group: with
//! the factor c, |p_i − p_j| < c (r_i + r_j), less what [`Relax`] allows. It is coloured largest first (Leighton 1979; the
//! paper's choice): by falling degree, of equals the first point first, each with the smallest colour that none of its
//! coloured neighbours has.
//!
//! Same input, same bytes, whatever the number of threads. Work and memory are in proportion to the number of points:
//! beside a splat at most [`MOST_CANDIDATES`] others are looked at, and those that have more are counted.

mod color;
mod file;
mod graph;

use crate::error::{Error, Result};
use crate::structure::Flat;

pub use graph::MOST_CANDIDATES;
use graph::{Graph, Splats};

/// When two splats that overlap may still share a group: the paper's three relaxations, and a limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relax {
    /// c in |p_i − p_j| < c (r_i + r_j), 0 to 1: 1 allows no overlap, 0 any.
    pub factor: f32,
    /// Splats of one plane and one colour may overlap: normals within 4° of each other (a step of 8-bit shading at most),
    /// each centre within 1/16 of the smaller radius of the other's plane, the same colour. Where coverage comes from the
    /// sum of weights, as here, what is lost is seen as holes: off by default.
    pub coplanar: bool,
    /// Splats whose normals point against each other (n_i · n_j < 0) may overlap: they belong to different sheets.
    pub opposing: bool,
    /// Most groups that are made, 1 to 256. Where they do not suffice, splats join the group that they conflict with least,
    /// and are counted.
    pub limit: u32,
}

impl Default for Relax {
    /// c = 0.6.
    fn default() -> Self {
        Relax { factor: 0.6, coplanar: false, opposing: true, limit: 64 }
    }
}

impl Relax {
    /// No relaxation: no two splats of a group overlap.
    pub const NONE: Relax = Relax { factor: 1.0, coplanar: false, opposing: false, limit: 256 };

    pub(super) fn check(&self) -> Result<()> {
        if !(0.0..=1.0).contains(&self.factor) {
            return Err(Error::Unsupported(format!("groups with c = {}: from 0 to 1", self.factor)));
        }
        if !(1..=256).contains(&self.limit) {
            return Err(Error::Unsupported(format!("at most {} groups: 1 to 256", self.limit)));
        }
        Ok(())
    }

    fn relaxes(&self) -> bool {
        self.factor < 1.0 || self.coplanar || self.opposing
    }
}

/// Which group each point of a cloud is in.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Groups {
    /// The group of every point, below `count`. What can never be drawn (no finite place, no radius) is in the first.
    pub of: Vec<u8>,
    /// K, at least 1.
    pub count: u32,
    /// Splats of one group may overlap: some that were allowed to do, some had to, or not all were looked at.
    pub overlapping: bool,
    /// Splats that share a group with a neighbour in the graph, since the limit was not enough.
    pub conflicts: u64,
    /// Splats beside which there are more than [`MOST_CANDIDATES`] others: overlap with some of them was not looked for.
    pub truncated: u64,
    /// Most neighbours of a splat in the graph.
    pub max_degree: u32,
    /// Neighbours of a splat on average.
    pub mean_degree: f64,
}

impl Groups {
    /// Groups of a cloud's splats, as they are stored.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a factor outside 0 to 1 or not a number, and for a limit outside 1 to 256.
    pub fn color(flat: &Flat, relax: &Relax) -> Result<Groups> {
        Groups::color_where(flat, relax, |_, _| true)
    }

    /// The same where some pairs are never drawn together: only splats that `together` says may be must not share a group.
    ///
    /// # Errors
    /// As [`Groups::color`].
    pub fn color_where(flat: &Flat, relax: &Relax, together: impl Fn(usize, usize) -> bool + Sync) -> Result<Groups> {
        relax.check()?;
        let splats = Splats::new(flat, relax, |i| flat.point(i as u32)[3], |_| true);
        let conflict =
            |a, b| together(splats.index(a) as usize, splats.index(b) as usize) && splats.conflict(a, b, relax);
        let graph = Graph::new(&splats, conflict);
        let mut coloring = color::Coloring::new(&[], flat.len(), relax.limit);
        coloring.color(&splats, &graph, |_| true);
        let truncated = graph.truncated;
        let overlapping = truncated > 0
            || coloring.conflicts > 0
            || (relax.relaxes() && {
                let all = Splats::new(flat, &Relax::NONE, |i| flat.point(i as u32)[3], |_| true);
                graph::any_pair(&all, |a, b| coloring.of(all.index(a)) == coloring.of(all.index(b)))
            });
        let edges = graph.edges() as f64;
        Ok(Groups {
            count: coloring.count(),
            overlapping,
            conflicts: coloring.conflicts,
            truncated,
            max_degree: graph.max_degree(),
            mean_degree: if splats.len() > 0 { 2.0 * edges / splats.len() as f64 } else { 0.0 },
            of: coloring.finish(),
        })
    }

    /// Groups that survive level of detail: for every level l the points of all levels up to l, each with the radius
    /// `radius[l]` \[world units\], share no group where they overlap (with c, as in [`Relax`]).
    ///
    /// Coarse to fine: a level's points get colours that their neighbours of this and coarser levels leave, and keep them.
    /// Neighbours at the coarser levels only grow fewer as radii shrink, so what was free stays free.
    /// [`Groups::overlaps`] counts what cuts of mixed levels lose.
    ///
    /// # Errors
    /// As [`Groups::color`], and where `level` has not an entry a point, a level has no radius, or radii grow.
    pub fn color_levels(flat: &Flat, level: &[u8], radius: &[f32], relax: &Relax) -> Result<Groups> {
        relax.check()?;
        if level.len() != flat.len() || level.iter().any(|&l| l as usize >= radius.len()) {
            return Err(Error::Unsupported("levels: one for each point, each with a radius".into()));
        }
        let falling = radius.windows(2).all(|w| w[1] <= w[0]) && radius.iter().all(|r| *r > 0.0 && r.is_finite());
        if !falling {
            return Err(Error::Unsupported("radii of levels: finite, more than 0, never growing".into()));
        }
        let steps = (0..=u8::MAX).take(radius.len());
        Ok(Groups::by_level(flat, level, steps, relax, &[], |l| vec![radius[l as usize]; flat.len()]))
    }

    /// Level by level, beside points that have their groups: the first, `known`. The points of a level get theirs in its step, where
    /// all points up to that level are, each with the radius that `radii` has for that step.
    ///
    /// `relax` was checked, and every list has an entry a point.
    pub(super) fn by_level(
        flat: &Flat,
        level: &[u8],
        steps: impl Iterator<Item = u8>,
        relax: &Relax,
        known: &[u8],
        mut radii: impl FnMut(u8) -> Vec<f32>,
    ) -> Groups {
        let mut coloring = color::Coloring::new(known, flat.len(), relax.limit);
        let mut groups = Groups::default();
        for l in steps {
            let radii = radii(l);
            let splats = Splats::new(flat, relax, |i| radii[i], |i| level[i] <= l);
            let graph = Graph::new(&splats, |a, b| splats.conflict(a, b, relax));
            coloring.color(&splats, &graph, |i| i >= known.len() && level[i] == l);
            groups.truncated += graph.truncated;
            groups.max_degree = graph.max_degree();
            groups.mean_degree = 2.0 * graph.edges() as f64 / splats.len().max(1) as f64;
        }
        groups.conflicts = coloring.conflicts;
        groups.overlapping = groups.truncated > 0 || groups.conflicts > 0 || relax.relaxes();
        groups.count = coloring.count();
        groups.of = coloring.finish();
        groups
    }

    /// Pairs of these points, each with a radius \[world units\], that share a group although |p_i − p_j| < c (r_i + r_j):
    /// what a cut of several levels loses.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a factor outside 0 to 1, and where `cut` names a point that is not there.
    pub fn overlaps(&self, flat: &Flat, cut: &[(u32, f32)], factor: f32) -> Result<u64> {
        let relax = Relax { factor, ..Relax::NONE };
        relax.check()?;
        if let Some((i, _)) = cut.iter().find(|(i, _)| *i as usize >= flat.len().min(self.of.len())) {
            return Err(Error::Unsupported(format!("a cut with point {i}: there are {}", flat.len())));
        }
        let mut of = vec![f32::NAN; flat.len()];
        cut.iter().for_each(|&(i, r)| of[i as usize] = r);
        let splats = Splats::new(flat, &relax, |i| of[i], |i| !of[i].is_nan());
        let same = |a: u32, b: u32| self.of[splats.index(a) as usize] == self.of[splats.index(b) as usize];
        Ok(Graph::new(&splats, same).edges())
    }
}
