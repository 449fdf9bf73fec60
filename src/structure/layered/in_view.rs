//! What one picture shows of a model, and no more of it: patches are fetched until its cut is complete.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use super::{Index, Patch};
use crate::error::{Error, Result};
use crate::select::Sight;
use crate::select::layered::{Counts, Cut, Refine, refine};
use crate::stream::{Access, Fault, FaultKind, FetchOptions, FetchStats, Fetcher, Want};
use crate::structure::groups::Groups;
use crate::structure::{Flat, flat};

/// Why a picture is given up that nothing comes for.
const SILENT: &str = "nothing came for too long";
/// Between two looks at what has come.
const PAUSE: Duration = Duration::from_millis(1);

/// How [`in_view`] fetches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patience {
    /// Threads that read and decode.
    pub threads: usize,
    /// How long nothing may come before the picture is taken as it is.
    pub silence: Duration,
}

impl Default for Patience {
    /// Four threads, half a minute.
    fn default() -> Self {
        Patience { threads: 4, silence: Duration::from_secs(30) }
    }
}

/// The samples of a cut.
#[derive(Debug)]
pub struct InView {
    /// Node by node, each with the radius that it has in this cut; where a node has no children the samples' own.
    pub flat: Flat,
    /// What was met.
    pub counts: Counts,
    /// What it took.
    pub fetched: FetchStats,
    /// Why patches are missing, if any is: what stands for them is coarser.
    pub fault: Option<Error>,
}

/// Fetches what this view draws of a model, level by level, and waits for it: for pictures and tools. Only these patches are read, and
/// memory is theirs.
///
/// What does not come, or not whole, is left out, and its parent's samples stand for it.
///
/// # Errors
/// [`Error::Stream`] where not even the coarsest patch comes; where it is no patch, [`Error::Data`]; [`Error::Io`] where the system
/// gives no thread.
pub fn in_view(
    index: &Arc<Index>,
    access: Arc<dyn Access>,
    sight: &Sight,
    options: &Refine,
    patience: Patience,
) -> Result<InView> {
    let decoder = Arc::clone(index);
    let decode = move |node: u32, bytes: Vec<u8>| Patch::decode(&decoder, node, &bytes);
    let fetch = FetchOptions { threads: patience.threads, ..FetchOptions::default() };
    let name = access.name().to_owned();
    let mut fetcher = Fetcher::with_options(access, fetch, decode)?;
    let mut patches: HashMap<u32, Patch> = HashMap::new();
    let mut lost: HashSet<u32> = HashSet::new();
    let mut cut = Cut::default();
    let mut last = Instant::now();
    let mut fault = None;
    loop {
        refine(index, sight, options, |node| f32::from(patches.contains_key(&node)), &mut cut);
        let wishes = cut.wishes.iter().filter(|w| w.priority > 0.0 && !lost.contains(&w.node));
        let wanted: Vec<Want> =
            wishes.map(|w| Want { key: w.node, at: w.at, bytes: w.bytes, priority: w.priority }).collect();
        if wanted.is_empty() {
            break;
        }
        fetcher.want(&wanted);
        let come = loop {
            let come = fetcher.take();
            if !come.is_empty() || last.elapsed() > patience.silence {
                break come;
            }
            thread::sleep(PAUSE);
        };
        if come.is_empty() {
            let silent = || Fault { kind: FaultKind::TimedOut, name, at: wanted[0].at, why: SILENT.into() };
            fault = Some(Error::Stream(fetcher.fault().unwrap_or_else(silent)));
            break;
        }
        last = Instant::now();
        for (node, patch) in come {
            match patch {
                Ok(patch) => drop(patches.insert(node, patch)),
                // Without the root there is no picture.
                Err(error) if node == 0 => return Err(error),
                Err(error) => {
                    lost.insert(node);
                    fault = Some(error);
                }
            }
        }
    }
    match fault {
        Some(fault) if patches.is_empty() => return Err(fault),
        _ => {}
    }
    let flat = gather(index, &cut, &patches);
    Ok(InView { flat, counts: cut.counts, fetched: fetcher.stats(), fault })
}

/// The drawn samples, one after the other.
fn gather(index: &Index, cut: &Cut, patches: &HashMap<u32, Patch>) -> Flat {
    let mut flat = Flat { origin: index.origin, closed: index.closed, ..Flat::default() };
    flat.normals = index.normals.then(Vec::new);
    flat.colors = index.colors.then(Vec::new);
    flat.groups = index.groups.map(|count| Groups { count, overlapping: true, ..Groups::default() });
    for step in cut.drawn() {
        let (Some(patch), Some(at)) = (patches.get(&step.node), cut.step_of(step.node)) else { continue };
        flat.geometry.extend(patch.positions.iter().zip(&patch.radii).map(|(p, own)| {
            let deepest = cut.deepest(at, *p);
            let finished = index.nodes[deepest.node as usize].split > 2;
            [p[0], p[1], p[2], if finished { *own } else { own.max(deepest.radius) }]
        }));
        flat.normals.iter_mut().for_each(|all| all.extend(patch.normals.iter().flatten()));
        flat.colors.iter_mut().for_each(|all| all.extend(patch.colors.iter().flatten()));
        flat.groups.iter_mut().for_each(|all| all.of.extend(patch.groups.iter().flatten()));
    }
    flat.blocks = flat::blocks(flat.geometry.len(), |i| flat.geometry[i]);
    flat
}
