//! Every case of `surfel::standalone::stress`, one test a group.

use surfel::standalone::stress;

use crate::vulkan;

fn group(name: &str) {
    let cases: Vec<_> = stress::cases().into_iter().filter(|c| c.group == name).collect();
    assert!(!cases.is_empty(), "no group {name}");
    let mut faults = Vec::new();
    vulkan::draw([160, 112], true, |off| {
        for case in &cases {
            let outcome = stress::run(off, case).unwrap_or_else(|e| panic!("{name}, {}: {e}", case.name));
            println!(
                "{name}, {}: worst {:.1e} of {:.1e}, twin {:.1e}, {} pixels, {} ties, {} off",
                case.name,
                outcome.worst,
                outcome.bound,
                outcome.worst_twin.unwrap_or(0.0),
                outcome.pixels,
                outcome.ties,
                outcome.off_ties
            );
            faults.extend(outcome.faults.iter().map(|f| format!("{}: {f}", case.name)));
        }
    });
    assert!(faults.is_empty(), "{} faults in {name}:\n{}", faults.len(), faults.join("\n"));
}

#[test]
fn invariance() {
    group("invariance");
}

#[test]
fn viewers_and_lenses() {
    group("viewer and lens");
}

#[test]
fn radii() {
    group("radii");
}

#[test]
fn normals() {
    group("normals");
}

#[test]
fn near_plane() {
    group("near plane");
}

#[test]
fn heaps() {
    group("heaps");
}

#[test]
fn rims() {
    group("rims");
}

#[test]
fn tolerances() {
    group("tolerances");
}

#[test]
fn viewports() {
    group("viewports");
}
