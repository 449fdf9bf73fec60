//! The three viewpoints of the comparison of unprocessed scans: how many times as fast as all points, beside what was published.

use std::fmt::Write as _;

use surfel::measure::published::{self, VIEWPOINTS};
use surfel::technique::Structure;

use super::record::{Combination, Record};

/// The same but for what structures alone have.
fn plain(c: &Combination) -> Combination {
    Combination {
        structure: "flat".into(),
        threshold: None,
        selection: None,
        interval: None,
        storage: String::new(),
        view: [0, 0],
        ..c.clone()
    }
}

/// Of the fastest order of storage.
fn flat<'a>(records: &'a [Record], of: &Record) -> Option<(&'a Record, f64)> {
    let wanted = plain(&of.combination);
    records
        .iter()
        .filter(|r| r.combination.structure == "flat" && plain(&r.combination) == wanted)
        .filter_map(|r| Some((r, r.time()?.median)))
        .min_by(|a, b| a.1.total_cmp(&b.1))
}

/// A line for each structure from each of the viewpoints; empty where none was measured beside the flat structure.
pub fn table(records: &[Record]) -> String {
    let mut text = String::new();
    for record in records.iter().filter(|r| r.combination.structure != "flat") {
        let c = &record.combination;
        let Some(viewpoint) = VIEWPOINTS.iter().position(|name| Some(*name) == c.view_name.as_deref()) else {
            continue;
        };
        let (Some((all, ms)), Some(time)) = (flat(records, record), record.time()) else { continue };
        let structure = Structure::ALL.iter().find(|(name, _)| *name == c.structure).map(|(_, s)| *s);
        let published = structure.and_then(|s| published::speedup(s, viewpoint));
        // Writing to a string cannot fail.
        if text.is_empty() {
            let _ = writeln!(
                text,
                "{:<58} {:>9} {:>10} {:>10} {:>9} {:>9}",
                "viewpoints", "ms", "x flat", "published", "of points", "overdraw"
            );
        }
        let _ = writeln!(
            text,
            "  {:<56} {:>9.2} {:>10.2} {:>10} {:>8.1}% {:>9}",
            format!("{}, {} {} px, {}", c.way(), c.input, c.size[0], VIEWPOINTS[viewpoint]),
            time.median,
            ms / time.median,
            published.map_or("-".into(), |p| format!("{p:.1}")),
            100.0 * record.points_drawn as f64 / all.points_drawn.max(1) as f64,
            overdraw(records, record).map_or("-".into(), |share| format!("{:.2}%", 100.0 * share)),
        );
    }
    text
}

/// What the published test draws more than the exact one, as a share of the latter; `None` for other records.
fn overdraw(records: &[Record], published: &Record) -> Option<f64> {
    let of = |interval: &str| Combination { interval: Some(interval.into()), ..published.combination.clone() };
    if published.combination != of("published") {
        return None;
    }
    let exact = records.iter().find(|r| r.combination == of("exact"))?;
    Some(published.points_drawn as f64 / exact.points_drawn.max(1) as f64 - 1.0)
}

#[cfg(test)]
mod tests {
    use super::super::record::tests::record;
    use super::*;

    #[test]
    fn structures_are_held_against_all_points_of_the_same_view() {
        let at = |structure: &str, interval: Option<&str>, view: &str, ms: f64, drawn: u64| {
            let mut r = record("flat.opaque.point", ms, 0.1);
            (r.combination.structure, r.combination.view_name) = (structure.into(), Some(view.into()));
            r.combination.interval = interval.map(str::to_owned);
            r.combination.threshold = (structure != "flat").then_some(1.0);
            r.points_drawn = drawn;
            r
        };
        let records = [
            at("flat", None, "distance", 10.0, 100),
            at("flat", None, "centre", 30.0, 100),
            at("espt", None, "distance", 2.0, 10),
            at("sequential", Some("exact"), "distance", 4.0, 40),
            at("sequential", Some("published"), "distance", 4.0, 42),
            at("mospt", None, "somewhere", 1.0, 5),
        ];
        let text = table(&records);
        let lines: Vec<Vec<&str>> = text.lines().map(|l| l.split_whitespace().collect()).collect();
        assert_eq!(lines.len(), 4, "{text}");
        let tail = |line: usize| lines[line][lines[line].len() - 5..].to_vec();
        // 378 to 15 frames a second were published.
        assert_eq!(tail(1), ["2.00", "5.00", "25.2", "10.0%", "-"]);
        assert_eq!(tail(2), ["4.00", "2.50", "-", "40.0%", "-"]);
        assert_eq!(tail(3), ["4.00", "2.50", "-", "42.0%", "5.00%"]);
        assert_eq!(table(&records[2..]), "");
    }
}
