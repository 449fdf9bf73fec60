//! What a render says afterwards: a table for people, JSON for programs.

use std::fmt::Write as _;

use serde_json::{Value, json};

use surfel::standalone::DeviceInfo;
use surfel::stats::{Culled, Skip};
use surfel::technique::{Blend, Structure, Technique};

use super::frames::Account;
use super::memory;

/// Everything that is reported.
pub struct Report {
    /// What ran it.
    pub device: DeviceInfo,
    /// \[px\]
    pub size: [u32; 2],
    /// How.
    pub technique: Technique,
    /// Points in the files.
    pub points_input: u64,
    /// The frames.
    pub account: Account,
    /// Stages that the command line left out, beside the renderer's own.
    pub skipped: Vec<(&'static str, &'static str)>,
    /// Messages of the validation layers.
    pub validation_messages: usize,
    /// Level of detail in the picture's centre \[px\], and how many times as much it may be in a corner.
    pub threshold: [f64; 2],
    /// What was chosen, dropped, repaired.
    pub assumed: Vec<String>,
}

impl Report {
    /// The statistics. Their keys are part of the interface.
    pub fn json(&self) -> Value {
        let Account { stats, passes, gpu, frame, prepare } = &self.account;
        let own = self.skipped.iter().map(|(stage, reason)| json!({"stage": stage, "reason": reason}));
        let skipped: Vec<Value> =
            stats.skipped.iter().map(|s| json!({"stage": s.stage, "reason": s.reason})).chain(own).collect();
        json!({
            "device": self.device.name,
            "driver": self.device.driver,
            "width": self.size[0],
            "height": self.size[1],
            "structure": self.technique.structure.name(),
            "blend": self.technique.blend.name(),
            "blend_drawn": stats.blend.name(),
            "ordered_access": stats.ordered.map(|o| o.name()),
            "layers": stats.layers,
            "layer_bytes": stats.layer_bytes,
            "sums": stats.sums.name(),
            "threshold": {"pixels": self.threshold[0], "worst_off_axis": self.threshold[1]},
            "points_input": self.points_input,
            "triangles_submitted": stats.triangles_submitted,
            "points_submitted": stats.points_submitted,
            "points_drawn": stats.points_drawn,
            "culled": stats.culled.map(|c| culled(&c).into_iter().map(|(k, v)| (k.to_owned(), json!(v))).collect::<Value>()),
            "draw_calls": stats.draw_calls,
            "passes": passes.iter().map(|(name, ms)| json!({"name": name, "gpu_ms": ms})).collect::<Vec<_>>(),
            "skipped": skipped,
            "gpu_ms_median": gpu,
            "frame_ms_median": frame,
            "prepare_ms_median": prepare,
            "device_bytes": stats.device_bytes,
            "peak_rss_bytes": memory::peak_rss(),
            "validation_messages": self.validation_messages,
            "assumed": self.assumed,
        })
    }

    /// The table.
    pub fn table(&self) -> String {
        let mut text = String::new();
        let mut row = |name: &str, value: String| {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "  {name:<18} {value}");
        };
        let Account { stats, passes, gpu, frame, prepare } = &self.account;
        row("device", format!("{} ({})", self.device.name, self.device.driver));
        let Technique { structure, primitive, blend, .. } = self.technique;
        row("picture", format!("{} x {}, {structure}, {blend}, {primitive}", self.size[0], self.size[1]));
        if stats.blend != blend {
            row("drawn as", format!("{}: {}", stats.blend, why(&stats.skipped, blend)));
        }
        if let Some(access) = stats.ordered {
            row("ordered by", access.to_string());
        }
        if stats.layers > 0 {
            row("layers", format!("{}, {}", stats.layers, memory::human(stats.layer_bytes)));
        }
        if structure != Structure::Flat {
            let [px, corner] = self.threshold;
            row("threshold", format!("{px} px in the centre, at most {:.2} px in a corner", px * corner));
        }
        let drawn = stats.points_drawn.map_or("?".into(), grouped);
        row("points", format!("{} in the input, {drawn} drawn", grouped(self.points_input)));
        if stats.triangles_submitted > 0 {
            row("triangles", format!("{} submitted", grouped(stats.triangles_submitted)));
        }
        let parts = stats.culled.map(|c| culled(&c)).unwrap_or_default();
        let parts: Vec<String> =
            parts.iter().filter(|(_, n)| *n > 0).map(|(name, n)| format!("{} {name}", grouped(*n))).collect();
        if !parts.is_empty() {
            row("culled", parts.join(", "));
        }
        for (i, line) in self.assumed.iter().enumerate() {
            row(if i == 0 { "assumed" } else { "" }, line.clone());
        }
        let ms = |v: Option<f64>| v.map_or("not measured".into(), |v| format!("{v:10.3} ms"));
        for (name, time) in passes {
            row(name, ms(Some(*time)));
        }
        row("device, all passes", ms(*gpu));
        row("frame, median", ms(*frame));
        row("of it prepare", ms(*prepare));
        row("device memory", memory::human(stats.device_bytes));
        if let Some(bytes) = memory::peak_rss() {
            row("peak memory", memory::human(bytes));
        }
        text
    }
}

/// Why a blend was not drawn.
fn why(skipped: &[Skip], blend: Blend) -> &'static str {
    skipped.iter().find(|s| s.stage == blend.name()).map_or("", |s| s.reason)
}

fn culled(c: &Culled) -> [(&'static str, u64); 5] {
    let Culled { interval, frustum, cone, occluded, invalid } = *c;
    [("interval", interval), ("frustum", frustum), ("cone", cone), ("occluded", occluded), ("invalid", invalid)]
}

/// Thousands apart: `1 234 567`.
pub fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(' ');
        }
        out.push(digit);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_legible() {
        assert_eq!([0, 999, 1000, 1234567].map(grouped), ["0", "999", "1 000", "1 234 567"]);
    }
}
