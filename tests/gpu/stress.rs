//! Every case of `surfel::standalone::stress`, one test a group.

use surfel::readback::Picture;
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

/// The first case, its picture as the device draws it, and what is said after `change`.
fn faults(change: impl FnOnce(&mut Picture)) -> String {
    let case = stress::cases().into_iter().find(|c| c.name == "lit at the origin, two-pass").expect("the case");
    let mut said = String::new();
    vulkan::draw([160, 112], true, |off| {
        let mut picture = stress::draw(off, &case).expect("a frame");
        let expected = stress::reference(&case).expect("a picture");
        assert!(stress::judge(&case, &picture, &expected).passed());
        change(&mut picture);
        said = stress::judge(&case, &picture, &expected).faults.join("\n");
    });
    said
}

#[test]
fn a_wrong_picture_is_noticed() {
    assert!(faults(|p| p.rgba.rotate_right(1)).contains("off by"), "shifted");
    assert!(faults(|p| p.rgba.iter_mut().for_each(|c| c.swap(0, 2))).contains("off by"), "channels swapped");
    assert!(faults(|p| p.rgba.fill([0.0; 4])).contains("off by"), "blank");
    assert!(faults(|p| p.rgba[9000][1] = f32::NAN).contains("off by inf"), "not a number");
    assert!(faults(|p| p.depth.as_mut().expect("depth").fill(0.0)).contains("depth off by"), "no depth");
    assert!(faults(|p| p.depth = None).contains("no depth"), "no depth at all");
    assert!(faults(|p| p.rgba.iter_mut().flatten().for_each(|v| *v *= 1.0 + 5e-4)).contains("off by"), "5e-4 brighter");
}

#[test]
fn a_wrong_account_and_a_wrong_twin_are_noticed() {
    let mut case = stress::cases().into_iter().find(|c| c.twin.is_some()).expect("a case with a twin");
    let twin = case.twin.as_mut().expect("a twin");
    twin.take.style.radius_scale = 1.02;
    case.covered = usize::MAX;
    vulkan::draw([160, 112], true, |off| {
        let said = stress::run(off, &case).expect("a frame").faults.join("\n");
        assert!(said.contains("off its twin") && said.contains("show anything"), "{said}");
    });
}

#[test]
fn names_are_unique_and_the_suite_is_whole() {
    let mut names: Vec<_> = stress::cases().into_iter().map(|c| (c.group, c.name)).collect();
    let all = names.len();
    names.sort();
    names.dedup();
    assert_eq!(names.len(), all);
    let groups: std::collections::BTreeSet<_> = names.iter().map(|(g, _)| *g).collect();
    assert_eq!(groups.len(), 9, "every group has its test above");
    assert!(all >= 179, "{all} cases: none is lost");
}

#[test]
fn half_sums_fail_where_thousands_meet() {
    use surfel::style::SumPrecision::{Half, Single};
    vulkan::draw([160, 112], true, |off| {
        let mut worst = |n, sums| {
            let outcome = stress::run(off, &stress::heap_on_a_pixel(n, sums)).expect("a frame");
            println!("{n} splats on a pixel, {sums:?}: off by {:.1e}", outcome.worst);
            outcome.worst
        };
        for n in [1, 3, 10, 30, 100, 300, 1000, 3000, 10_000, 30_000, 100_000] {
            let (single, half) = (worst(n, Single), worst(n, Half));
            // The default stays within 1/255 of the full range throughout; half does not.
            assert!(single < 1.0 / 255.0, "{n}: {single}");
            assert!(n < 10_000 || half > 1.0 / 255.0, "{n}: {half}: half would do");
        }
    });
}
