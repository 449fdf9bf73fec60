//! Cases drawn from seeds. `SURFEL_SEEDS=first..last` (the last left out) runs others, for hours if wanted:
//! `SURFEL_SEEDS=1000..9000 cargo test --release --test gpu seeded`.

use std::ops::Range;

use surfel::standalone::stress;

use crate::vulkan;

const SEEDS: Range<u64> = 0..40;

fn parse(text: &str) -> Option<Range<u64>> {
    let (first, last) = text.split_once("..")?;
    let range = first.trim().parse().ok()?..last.trim().parse().ok()?;
    (!range.is_empty()).then_some(range)
}

#[test]
fn seeds() {
    let seeds = match std::env::var("SURFEL_SEEDS") {
        Ok(text) => parse(&text).unwrap_or_else(|| panic!("SURFEL_SEEDS={text}: not as 100..200")),
        Err(_) => SEEDS,
    };
    let mut faults = Vec::new();
    let mut shown = 0;
    vulkan::draw([64, 64], true, |off| {
        for seed in seeds.clone() {
            let case = stress::random(seed);
            let outcome = stress::run(off, &case).unwrap_or_else(|e| panic!("SURFEL_SEEDS={seed}..{}: {e}", seed + 1));
            shown += (outcome.pixels > 100) as u64;
            faults.extend(
                outcome.faults.iter().map(|f| format!("SURFEL_SEEDS={seed}..{}: {}: {f}", seed + 1, case.name)),
            );
        }
    });
    assert!(faults.is_empty(), "{} faults:\n{}", faults.len(), faults.join("\n"));
    let all = seeds.end - seeds.start;
    assert!(all < 10 || shown > all / 3, "only {shown} of {all} pictures show more than 100 pixels");
}

#[test]
fn ranges_are_read_or_refused() {
    assert_eq!(parse("3..5"), Some(3..5));
    for wrong in ["", "3", "5..3", "3..3", "a..b", "..5"] {
        assert_eq!(parse(wrong), None, "{wrong}");
    }
}
