//! What became faster or slower since an earlier run.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use serde_json::Value;

use surfel::measure::baseline::{Change, Samples, Verdict, changes};

/// What of a report matters for a comparison.
#[derive(Debug, PartialEq)]
pub struct Run {
    /// What must be equal for times to be comparable.
    pub setting: Vec<(&'static str, String)>,
    /// Times by the case's name.
    pub cases: Vec<Samples>,
}

/// Reads a report.
pub fn read(path: &Path, parse: impl Fn(&Value) -> Option<Run>) -> Result<Run> {
    let name = || path.display().to_string();
    let text = std::fs::read_to_string(path).with_context(name)?;
    let value = serde_json::from_str(&text).with_context(name)?;
    parse(&value).with_context(|| format!("{}: not a report that this command wrote", path.display()))
}

/// These keys of a report, as text; `None` where one is not there.
pub fn setting(value: &Value, keys: &[&'static str]) -> Option<Vec<(&'static str, String)>> {
    let text = |key: &&'static str| match &value[*key] {
        Value::String(text) => Some((*key, text.clone())),
        Value::Number(number) => Some((*key, number.to_string())),
        _ => None,
    };
    keys.iter().map(text).collect()
}

/// A line a case, and what to think of them.
pub fn compared(path: &Path, before: &Run, now: &Run) -> String {
    let mut text = format!("\nagainst {}: time now / before, with its 95 % confidence interval\n", path.display());
    for ((key, old), (_, new)) in before.setting.iter().zip(&now.setting).filter(|(old, new)| old != new) {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "WARNING: another {key}: {old} before, {new} now. These times cannot be compared.");
    }
    let all = changes(&before.cases, &now.cases);
    for (name, change) in &all {
        let _ = match change {
            Change::New => writeln!(text, "{name:<70} new"),
            Change::Missing => writeln!(text, "{name:<70} MISSING: timed before, and not now"),
            Change::Both(None) => writeln!(text, "{name:<70} too few samples"),
            Change::Both(Some(r)) => {
                let verdict = match r.verdict() {
                    Verdict::Faster => "faster",
                    Verdict::Slower => "SLOWER",
                    Verdict::NoDifference => "no difference",
                };
                writeln!(text, "{name:<70} {:.3} ({:.3} to {:.3}) {verdict}", r.ratio, r.low, r.high)
            }
        };
    }
    let both = all.iter().filter(|(_, change)| matches!(change, Change::Both(Some(_)))).count();
    text +=
        &format!("{both} cases compared; of those that did not change, one in twenty is called different by chance,\n");
    text += "and more where the machine itself was slower or faster on the whole: that is in no interval\n";
    text
}
