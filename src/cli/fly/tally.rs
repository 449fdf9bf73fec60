//! What the frames of a lap add up to.

use serde_json::{Map, Value, json};

use surfel::measure::timing::quantile;
use surfel::stream::FetchStats;
use surfel::structure::layered::Index;

use super::laps::Frame;

/// Half, 90 and 99 of a hundred lie below; and the largest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Percentiles {
    pub p50: f64,
    pub p90: f64,
    pub p99: f64,
    pub max: f64,
}

impl Percentiles {
    /// Of values that are numbers; `None` where there is none.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Percentiles> {
        let mut sorted: Vec<f64> = values.into_iter().collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let at = |q| quantile(&sorted, q);
        (!sorted.is_empty()).then(|| Percentiles { p50: at(0.5), p90: at(0.9), p99: at(0.99), max: at(1.0) })
    }

    pub fn json(&self) -> Value {
        let Percentiles { p50, p90, p99, max } = self;
        json!({"p50": p50, "p90": p90, "p99": p99, "max": max})
    }
}

/// Counts of patches over all frames of a lap, by the names of the statistics. `visited` = `drawn` + `frustum` + `cone` + `missing` +
/// `occluded`; of the patches that wait for a test, `hidden` were found so.
pub const PATCHES: [&str; 11] =
    ["visited", "drawn", "frustum", "cone", "missing", "occluded", "tested", "hidden", "wished", "arrived", "refused"];

/// What fetching did in a lap, by the names of the statistics.
pub const FETCHED: [&str; 9] =
    ["requests", "bytes", "delivered", "coalesced", "retries", "corrupt", "given_up", "forgotten", "faults"];

fn patches(f: &Frame) -> [u64; PATCHES.len()] {
    let l = &f.layered;
    let c = &l.cut;
    [c.visited, c.drawn, c.frustum, c.cone, c.missing, c.occluded, l.tested, l.hidden, l.wished, l.arrived, l.refused]
        .map(u64::from)
}

fn counters(s: &FetchStats) -> [u64; FETCHED.len()] {
    [s.requests, s.bytes, s.delivered, s.coalesced, s.retries, s.corrupt, s.given_up, s.forgotten, s.all_faults()]
}

/// One lap.
pub struct Tally {
    pub frames: usize,
    /// Frames that lacked nothing.
    pub complete: usize,
    /// [ms]
    pub frame: Option<Percentiles>,
    pub prepare: Option<Percentiles>,
    /// Of the processor.
    pub prepare_cpu: Option<Percentiles>,
    pub gpu: Option<Percentiles>,
    /// Samples drawn.
    pub samples: Option<Percentiles>,
    /// On the threshold.
    pub factor: Option<Percentiles>,
    /// By [`PATCHES`].
    pub patches: [u64; PATCHES.len()],
    /// By [`FETCHED`].
    pub fetched: [u64; FETCHED.len()],
    pub evicted: u64,
    /// Bytes copied to the device.
    pub uploaded: u64,
    /// Most patches on the device.
    pub resident: u32,
    pub resident_share: f64,
    /// Of the model's samples: those of so many of the largest patches, so that it is no more.
    pub samples_share: f64,
    pub pipelines_built: u32,
}

impl Tally {
    /// Of each lap. Counters of fetching and of evictions are of all frames so far, and a lap has what it added.
    pub fn of_laps(laps: &[Vec<Frame>], index: &Index) -> Vec<Tally> {
        let mut sizes: Vec<u64> = index.nodes.iter().map(|n| u64::from(n.samples)).collect();
        sizes.sort_unstable_by(|a, b| b.cmp(a));
        let (mut counted, mut evicted) = ([0; FETCHED.len()], 0);
        let mut tally = |frames: &Vec<Frame>| {
            let of = |value: &dyn Fn(&Frame) -> f64| Percentiles::of(frames.iter().map(value));
            let mut sums = [0; PATCHES.len()];
            for frame in frames {
                sums.iter_mut().zip(patches(frame)).for_each(|(sum, n)| *sum += n);
            }
            let (before, evicted_before) = (counted, evicted);
            if let Some(last) = frames.last() {
                (counted, evicted) = (counters(&last.layered.fetched), last.layered.evicted);
            }
            let mut fetched = counted;
            fetched.iter_mut().zip(before).for_each(|(n, before)| *n -= before);
            let resident = frames.iter().map(|f| f.layered.resident).max().unwrap_or(0);
            let samples: u64 = sizes.iter().take(resident as usize).sum();
            Tally {
                frames: frames.len(),
                complete: frames.iter().filter(|f| f.is_complete()).count(),
                frame: of(&|f| f.times.frame),
                prepare: of(&|f| f.times.prepare),
                prepare_cpu: Percentiles::of(frames.iter().filter_map(|f| f.times.prepare_cpu)),
                gpu: Percentiles::of(frames.iter().filter_map(|f| f.gpu)),
                samples: of(&|f| f.layered.cut.samples as f64),
                factor: of(&|f| f.layered.factor),
                patches: sums,
                fetched,
                evicted: evicted - evicted_before,
                uploaded: frames.iter().map(|f| f.uploaded).sum(),
                resident,
                resident_share: resident as f64 / sizes.len().max(1) as f64,
                samples_share: samples as f64 / index.samples().max(1) as f64,
                pipelines_built: frames.iter().map(|f| f.pipelines_built).sum(),
            }
        };
        laps.iter().map(&mut tally).collect()
    }

    /// One of [`PATCHES`] or [`FETCHED`].
    pub fn count(&self, name: &str) -> u64 {
        let names = PATCHES.iter().zip(self.patches).chain(FETCHED.iter().zip(self.fetched));
        names.into_iter().find(|(n, _)| **n == name).map_or(0, |(_, value)| value)
    }

    /// Patches drawn that were there, over all that should have been drawn; `None` where there was none.
    pub fn hits(&self) -> Option<f64> {
        let [drawn, missing] = ["drawn", "missing"].map(|name| self.count(name));
        (drawn + missing > 0).then(|| drawn as f64 / (drawn + missing) as f64)
    }

    pub fn json(&self) -> Value {
        let named = |names: &[&str], values: &[u64]| -> Map<String, Value> {
            names.iter().zip(values).map(|(name, value)| ((*name).to_owned(), json!(value))).collect()
        };
        let some = |p: Option<Percentiles>| p.map(|p| p.json());
        json!({
            "frames": self.frames,
            "complete_frames": self.complete,
            "frame_ms": some(self.frame),
            "prepare_ms": some(self.prepare),
            "prepare_cpu_ms": some(self.prepare_cpu),
            "gpu_ms": some(self.gpu),
            "samples": some(self.samples),
            "factor": some(self.factor),
            "patches": named(&PATCHES, &self.patches),
            "hits": self.hits(),
            "fetched": named(&FETCHED, &self.fetched),
            "evicted": self.evicted,
            "uploaded_bytes": self.uploaded,
            "resident": {"patches": self.resident, "share": self.resident_share, "samples_share_at_most": self.samples_share},
            "pipelines_built": self.pipelines_built,
        })
    }
}
