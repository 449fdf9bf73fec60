//! What a fly-through says afterwards: a table for people, JSON for programs.

use std::fmt::Write as _;
use std::sync::Arc;

use serde_json::{Value, json};

use surfel::measure::Summary;
use surfel::standalone::DeviceInfo;
use surfel::structure::layered::Index;
use surfel::technique::Technique;

use super::super::memory::{human, peak_rss};
use super::super::report::grouped;
use super::laps::Frame;
use super::tally::{PATCHES, Percentiles, Tally};

/// Everything that is reported.
pub struct Report {
    pub device: DeviceInfo,
    /// \[px\]
    pub size: [u32; 2],
    pub technique: Technique,
    /// Level of detail in the picture's centre \[px\], and how many times as much it may be in a corner.
    pub threshold: [f64; 2],
    pub index: Arc<Index>,
    /// As it was asked for.
    pub path: String,
    /// At least one, each with at least one frame.
    pub laps: Vec<Vec<Frame>>,
    pub validation_messages: usize,
}

impl Report {
    fn all(&self) -> impl Iterator<Item = &Frame> {
        self.laps.iter().flatten()
    }

    /// Number and time of the first frame that shows anything, and of the first that shows everything.
    fn firsts(&self) -> [Option<(usize, f64)>; 2] {
        let shows = |f: &Frame| f.layered.cut.drawn > 0;
        let first = |test: &dyn Fn(&Frame) -> bool| {
            self.all().enumerate().find(|(_, frame)| test(frame)).map(|(number, frame)| (number, frame.at))
        };
        [first(&shows), first(&|f| shows(f) && f.is_complete())]
    }

    /// What `prepare` takes of the processor on the first lap over what it takes in the same view on the last, where nothing is left to
    /// come; by the clock where the system does not tell.
    fn ratio(&self) -> Option<Summary> {
        let [first, .., last] = self.laps.as_slice() else { return None };
        let time = |f: &Frame| f.times.prepare_cpu.unwrap_or(f.times.prepare);
        Summary::of(&first.iter().zip(last).map(|(a, b)| time(a) / time(b)).collect::<Vec<_>>())
    }

    fn device_bytes(&self) -> u64 {
        self.all().map(|f| f.device_bytes).max().unwrap_or(0)
    }

    /// The latest fault that any frame told of.
    pub fn fault(&self) -> Option<&str> {
        self.all().filter_map(|f| f.layered.fault.as_deref()).last()
    }

    /// Whether there ever was a picture.
    pub fn shows_anything(&self) -> bool {
        self.firsts()[0].is_some()
    }

    /// The statistics. Their keys are part of the interface.
    pub fn json(&self) -> Value {
        let [picture, complete] = self.firsts().map(|first| first.map(|(frame, ms)| json!({"frame": frame, "ms": ms})));
        let last = self.all().last();
        json!({
            "device": self.device.name,
            "driver": self.device.driver,
            "model": self.index.name,
            "samples": self.index.samples(),
            "nodes": self.index.nodes.len(),
            "width": self.size[0],
            "height": self.size[1],
            "blend": self.technique.blend.name(),
            "blend_drawn": last.map(|f| f.blend.name()),
            "threshold": {"pixels": self.threshold[0], "worst_off_axis": self.threshold[1]},
            "path": self.path,
            "first_picture": picture,
            "first_complete": complete,
            "prepare_ratio": self.ratio().map(|r| json!({"lower": r.lower, "median": r.median, "upper": r.upper})),
            "slots": last.map(|f| f.layered.slots),
            "device_bytes": self.device_bytes(),
            "peak_rss_bytes": peak_rss(),
            "fault": self.fault(),
            "validation_messages": self.validation_messages,
            "laps": Tally::of_laps(&self.laps, &self.index).iter().map(Tally::json).collect::<Vec<_>>(),
        })
    }

    /// The table: what is of all laps, then a column for each.
    pub fn table(&self) -> String {
        let mut text = String::new();
        let mut row = |name: &str, value: String| {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "  {name:<18} {value}");
        };
        row("device", format!("{} ({})", self.device.name, self.device.driver));
        let (samples, patches) = (grouped(self.index.samples()), grouped(self.index.nodes.len() as u64));
        row("model", format!("{samples} samples in {patches} patches"));
        let drawn = self.all().last().map_or(self.technique.blend, |f| f.blend);
        row("picture", format!("{} x {}, {drawn}, {}", self.size[0], self.size[1], self.technique.primitive));
        let [px, corner] = self.threshold;
        row("threshold", format!("{px} px in the centre, at most {:.2} px in a corner", px * corner));
        row("path", self.path.clone());
        let told =
            |first: Option<(usize, f64)>| first.map_or("none".into(), |(i, ms)| format!("{ms:.0} ms, frame {i}"));
        let [picture, complete] = self.firsts();
        row("first picture", told(picture));
        row("first complete", told(complete));
        if let Some(r) = self.ratio() {
            let text = format!("{:.2} times that of the last lap ({:.2} to {:.2})", r.median, r.lower, r.upper);
            row("prepare, lap 1", text);
        }
        row("device memory", human(self.device_bytes()));
        if let Some(bytes) = peak_rss() {
            row("peak memory", human(bytes));
        }
        if let Some(fault) = self.fault() {
            row("latest fault", fault.to_owned());
        }
        let laps = Tally::of_laps(&self.laps, &self.index);
        let mut columns = |name: &str, of: &dyn Fn(&Tally) -> String| {
            let values: Vec<String> = laps.iter().map(|lap| format!("{:>26}", of(lap))).collect();
            let _ = writeln!(text, "  {name:<26}{}", values.concat());
        };
        let ms = |p: Option<Percentiles>| match p {
            Some(Percentiles { p50, p90, p99, max }) if max < 100.0 => {
                format!("{p50:.2} {p90:.2} {p99:.2} {max:.2}")
            }
            Some(Percentiles { p50, p90, p99, max }) => format!("{p50:.0} {p90:.0} {p99:.0} {max:.0}"),
            None => "not measured".into(),
        };
        columns("", &|lap| format!("{} frames", grouped(lap.frames as u64)));
        columns("frame [ms] 50 90 99 max", &|lap| ms(lap.frame));
        columns("prepare [ms]", &|lap| ms(lap.prepare));
        columns("of the processor [ms]", &|lap| ms(lap.prepare_cpu));
        columns("device [ms]", &|lap| ms(lap.gpu));
        let millions = |p: Percentiles| format!("{:.2} {:.2}", 1e-6 * p.p50, 1e-6 * p.max);
        columns("samples [M] 50 max", &|lap| lap.samples.map_or_else(String::new, millions));
        columns("complete frames", &|lap| grouped(lap.complete as u64));
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        columns("patches there of wanted", &|lap| lap.hits().map_or_else(|| "none wanted".into(), percent));
        for name in PATCHES {
            columns(&format!("{name} a frame"), &|lap| format!("{:.1}", lap.count(name) as f64 / lap.frames as f64));
        }
        columns("fetched", &|lap| {
            format!("{}, {} requests", human(lap.count("bytes")), grouped(lap.count("requests")))
        });
        columns("uploaded", &|lap| human(lap.uploaded));
        columns("faults", &|lap| grouped(lap.count("faults")));
        columns("evicted", &|lap| grouped(lap.evicted));
        columns("resident patches", &|lap| {
            format!("{}, {}", grouped(lap.resident as u64), percent(lap.resident_share))
        });
        columns("resident samples", &|lap| format!("at most {}", percent(lap.samples_share)));
        text
    }
}
