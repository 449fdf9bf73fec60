//! Building: linear passes over temporary files until a part fits in memory, then all of its subtree there.
//!
//! Section 5 of the paper, with samples that keep apart instead of random ones. Every node draws K·M candidates, keeps M and
//! hands the rest to two children. What a node draws depends on the order of the input, on the seed and on the way to the
//! node, not on whether its part was in memory nor on the number of threads: the same bytes.

mod color;
mod estimate;
mod finish;
mod region;
mod select;
mod spool;
mod tree;
mod write;

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::AtomicU64;

use glam::{DVec3, Vec3};

use super::patch::{Content, Sample};
use super::{Index, MAX_SAMPLES};
use crate::error::{Error, Place, Result};
use crate::load::{Pieces, PointCloud, Report};
use crate::par;
use crate::structure::groups::Relax;
use crate::structure::octahedral;
use estimate::Facing;
use region::Region;
use spool::{Folder, Spool, Writer};
use tree::{Above, Maker};

/// Which candidates become samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Sampling {
    /// Those that keep apart, from each other and from the ancestors' samples: spacing is more even, and smaller.
    #[default]
    Elimination,
    /// Any, as published.
    Random,
}

impl Sampling {
    /// All, with the names that the command line has for them.
    pub const ALL: &[(&str, Sampling)] = &[("elimination", Sampling::Elimination), ("random", Sampling::Random)];
}

/// Where normals come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Normals {
    /// From the input; where no input has any, from the points' neighbours.
    #[default]
    Auto,
    /// From the input, or none at all.
    Input,
    /// From the points' neighbours, whatever the input has.
    Estimate,
}

impl Normals {
    /// All, with the names that the command line has for them.
    pub const ALL: &[(&str, Normals)] =
        &[("auto", Normals::Auto), ("input", Normals::Input), ("estimate", Normals::Estimate)];
}

/// Takes the name of the step, what of it is done and what there is to do.
pub type Told<'a> = &'a (dyn Fn(&str, u64, u64) + Sync);

/// How to build.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// M, samples a node; published 512 to 8192; 1 to [`MAX_SAMPLES`].
    pub samples: u32,
    /// K, candidates a sample; at least 2. Where points lie thinly there are few candidates, and what none of them stands for is a hole
    /// until a finer level comes: more candidates, fewer holes.
    pub candidates: u32,
    /// Which of them are kept.
    pub sampling: Sampling,
    /// Of the random numbers.
    pub seed: u64,
    /// How far a position may be moved, in local spacings: the radius that one in twenty of the patch's samples is below.
    /// ½ as published; more than 0. Of no meaning where `exact`.
    pub precision: f32,
    /// Keeps positions, radii and normals as they were read: floats to the bit, and integers of LAS as far as floats hold
    /// them, 2²³ steps from the origin.
    pub exact: bool,
    /// Normals, and radii with them where they are estimated.
    pub normals: Normals,
    /// Groups for [`Blend::Groups`](crate::technique::Blend::Groups), of all samples, so that no two that overlap in any whole level share
    /// one; where in a picture a coarse level meets a finer one, some may, as at the borders of parts of some ten thousand samples,
    /// which are coloured one after the other.
    pub groups: Option<Relax>,
    /// Bytes to work in, 16 MiB of them for buffers; 64 MiB and more are of use.
    pub memory: u64,
    /// Stands for the input in errors.
    pub name: &'a str,
    /// Told now and then, from any thread.
    pub progress: Option<Told<'a>>,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Options {
            samples: 4096,
            candidates: 16,
            sampling: Sampling::Elimination,
            seed: 1,
            precision: 0.125,
            exact: false,
            normals: Normals::Auto,
            groups: None,
            memory: 1 << 30,
            name: "the input",
            progress: None,
        }
    }
}

impl Options<'_> {
    fn report(&self, step: &str, done: u64, total: u64) {
        if let Some(progress) = self.progress {
            progress(step, done, total);
        }
    }
}

/// What was built.
#[derive(Debug, Clone)]
pub struct Built {
    /// As [`Index::read`] reads it from the file.
    pub index: Index,
    /// What was dropped, repaired and assumed.
    pub report: Report,
}

/// Builds a model of all points of the inputs, none left out and none twice.
///
/// Inputs share one world frame. The file appears under its name when it is whole and on the disk; until then there is what
/// was there before. Temporary files lie beside it and have no name. They take 24 B a point, twice that while a level is
/// dealt out; with estimated normals 52 B.
///
/// A sample without a radius gets one by its neighbours in the finest node at its place. Memory is [`Options::memory`] and 48 B a
/// thousand points for the index; what a reader must hold in full comes on top ([`Pieces`] says which).
///
/// # Errors
/// Those of the readers; [`Error::Io`] with the output's name where it or a temporary file cannot be written;
/// [`Error::Data`] for no points at all, and for more than [`MAX_SAMPLES`] at one place; [`Error::Unsupported`] for groups as
/// [`Groups::color`](crate::structure::groups::Groups::color) refuses them.
pub fn build(inputs: Vec<Pieces>, to: &Path, options: &Options) -> Result<Built> {
    let options =
        Options { samples: options.samples.clamp(1, MAX_SAMPLES), candidates: options.candidates.max(2), ..*options };
    options.groups.iter().try_for_each(Relax::check)?;
    let folder = Folder::new(to);
    let mut read = Read::new(&inputs);
    let samples = read.all(inputs, &folder, &options)?;
    let Read { origin, mut lattice, region, up, closed, scanner, mut report, normals, colors } = read;
    if samples.count() == 0 || !write::drawable(region.low, region.high) {
        let why = if samples.count() == 0 { "there is no point in the input" } else { "coordinates are beyond 10^30" };
        return Err(Error::data(options.name, Place::File, why));
    }
    if !options.exact {
        lattice = None;
    }
    let estimate = options.normals == Normals::Estimate || options.normals == Normals::Auto && !normals;
    let content = Content { normals: normals || estimate, colors, exact: options.exact, lattice, groups: None };
    let total = samples.count();
    let maker = Maker {
        options: &options,
        content,
        folder: folder.clone(),
        total,
        done: AtomicU64::new(0),
        held: Mutex::default(),
    };
    let samples = if estimate {
        let facing = Facing { up, scanner: scanner.map(|s| s - origin) };
        report.assume("normals and radii estimated from neighbours, and turned in each cell of the memory by itself");
        maker.estimated(samples, region, &facing)?
    } else {
        samples
    };
    let mut patches = folder.writer::<u8>()?;
    let root = maker.grow(samples, region, Above::root(options.seed), &mut patches)?;
    let patches = patches.finish()?;
    let mut index = Index {
        origin,
        nodes: write::numbered(*root),
        normals: content.normals,
        colors,
        closed: closed && content.normals && !estimate,
        up,
        exact: options.exact,
        lattice,
        groups: None,
        name: to.display().to_string(),
    };
    let colored = match &options.groups {
        Some(relax) => {
            Some(color::color(&index, &patches, &folder, relax, |done| options.report("groups", done, total))?)
        }
        None => None,
    };
    if let Some(colored) = &colored {
        index.groups = Some(colored.count);
        if colored.conflicts > 0 {
            report.assume(format!(
                "{} samples share a group with others that they overlap: too few groups",
                colored.conflicts
            ));
        }
    }
    write::write(&mut index, &patches, colored.as_ref(), to, &folder, |done, total| {
        options.report("write", done, total)
    })?;
    Ok(Built { index, report })
}

/// What the first pass over the inputs finds.
struct Read {
    origin: DVec3,
    lattice: Option<DVec3>,
    region: Region,
    up: Option<Vec3>,
    closed: bool,
    scanner: Option<DVec3>,
    report: Report,
    normals: bool,
    colors: bool,
}

impl Read {
    fn new(inputs: &[Pieces]) -> Read {
        // The input's origin that is nearest to the middle of all: an origin of integers stays one.
        let middle = inputs.iter().map(|i| i.origin()).sum::<DVec3>() / inputs.len().max(1) as f64;
        let origins = inputs.iter().map(|i| i.origin());
        let nearest = origins.min_by(|a, b| a.distance(middle).total_cmp(&b.distance(middle)));
        let first = inputs.first();
        let all = |same: &dyn Fn(&Pieces) -> bool| inputs.iter().all(same);
        let lattice = first.and_then(Pieces::lattice).filter(|l| all(&|i| i.lattice() == Some(*l)));
        let up = first.and_then(Pieces::up).filter(|u| all(&|i| i.up() == Some(*u)));
        let scanner = first.and_then(Pieces::viewpoint).filter(|v| all(&|i| i.viewpoint() == Some(*v)));
        Read {
            origin: nearest.unwrap_or_default(),
            lattice,
            region: Region::EMPTY,
            up,
            closed: !inputs.is_empty() && all(&Pieces::closed),
            scanner,
            report: Report::default(),
            normals: false,
            colors: false,
        }
    }

    /// All points in one temporary file, in the order of the inputs.
    fn all(
        &mut self,
        inputs: Vec<Pieces>,
        folder: &std::sync::Arc<Folder>,
        options: &Options,
    ) -> Result<Spool<Sample>> {
        let mut out = folder.writer::<Sample>()?;
        let total: u64 = inputs.iter().map(Pieces::points).sum();
        let mut far = 0;
        let mut seen = 0;
        for mut input in inputs {
            let mut ready = input.piece()?;
            while let Some(piece) = ready.take() {
                seen += piece.len() as u64;
                let (next, kept) = rayon::join(|| input.piece(), || self.keep(&piece, &mut out));
                far += piece.len() as u64 - kept?;
                ready = next?;
                options.report("read", seen, total);
            }
            let said = input.report();
            self.report.points_in_file += said.points_in_file;
            said.dropped.iter().for_each(|(why, n)| self.report.drop(why, *n));
            said.repaired.iter().for_each(|(why, n)| self.report.repair(why, *n));
            said.assumed.iter().for_each(|line| self.report.assume(line));
        }
        self.report.drop("coordinates too far from the rest for 32-bit floats", far);
        out.finish()
    }

    /// Writes the samples of a piece; how many there are.
    fn keep(&mut self, piece: &PointCloud, out: &mut Writer<Sample>) -> Result<u64> {
        let mut samples = self.samples(piece);
        samples.retain(|s| s.position.iter().all(|v| v.is_finite()));
        samples.iter().for_each(|s| self.region.add(s.position));
        out.push(&samples)?;
        Ok(samples.len() as u64)
    }

    fn samples(&mut self, piece: &PointCloud) -> Vec<Sample> {
        const BLOCK: usize = 1 << 12;
        // What a point without a colour gets beside points that have one.
        const GREY: u32 = u32::from_le_bytes([190, 190, 190, 255]);
        self.normals |= piece.normals.is_some();
        self.colors |= piece.colors.is_some();
        let shift = piece.origin - self.origin;
        let mut out =
            vec![Sample { position: [0.0; 3], radius: 0.0, normal: octahedral::NONE, color: GREY }; piece.len()];
        par::fill(&mut out, BLOCK, |first, out| {
            for (i, s) in (first..).zip(out) {
                let p = piece.positions[i];
                s.position = if shift == DVec3::ZERO { p } else { (p.as_dvec3() + shift).as_vec3() }.into();
                if let Some(normals) = &piece.normals {
                    s.normal = octahedral::encode(normals[i]);
                }
                if let Some(radii) = &piece.radii {
                    s.radius = radii[i].clamp(f32::MIN_POSITIVE, f32::MAX);
                }
                if let Some(colors) = &piece.colors {
                    let [r, g, b] = colors[i];
                    s.color = u32::from_le_bytes([r, g, b, 255]);
                }
            }
        });
        out
    }
}
