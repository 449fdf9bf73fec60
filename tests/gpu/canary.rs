//! Every planted fault is reported, and by the check that it was planted for.

use surfel::standalone::canary::ALL;
use surfel::standalone::{Layers, Options, Standalone};

/// GPU-assisted checks run apart: they replace the shaders, and the other canaries should see what tests see.
fn report(layers: Layers) {
    let options = Options { layers, ..Options::default() };
    let mut missed = Vec::new();
    for canary in ALL.iter().filter(|c| c.runs_with(layers) && c.needs.gpu_assisted == layers.gpu_assisted) {
        let messages = canary.run(&options).unwrap_or_else(|e| panic!("{}: {e}", canary.name));
        if !canary.is_reported(&messages) {
            let ids: Vec<_> = messages.iter().map(|m| format!("{}: {}", m.id, m.text)).collect();
            missed.push(format!("{} ({}); heard: {ids:#?}", canary.name, canary.expected));
        }
    }
    assert!(missed.is_empty(), "faults that the layers did not report: {}", missed.join("\n"));
}

#[test]
fn core_and_synchronization_faults_are_reported() {
    report(Layers::CORE_SYNC);
}

#[test]
fn faults_inside_shaders_are_reported() {
    report(Layers { core: true, sync: false, gpu_assisted: true });
}

#[test]
fn there_are_enough_of_each_kind() {
    let of = |wanted: fn(&Layers) -> bool| ALL.iter().filter(|c| wanted(&c.needs)).count();
    assert!(ALL.len() >= 12 && of(|l| l.gpu_assisted) >= 3 && of(|l| l.sync) >= 4, "{}", ALL.len());
    let names: std::collections::BTreeSet<_> = ALL.iter().map(|c| c.name).collect();
    assert_eq!(names.len(), ALL.len(), "names are unique");
}

/// A device on which nothing is planted says nothing, so a report is the fault's, and that of no other.
#[test]
fn silence_and_blindness_are_told_apart() {
    let options = Options { layers: Layers::CORE_SYNC, ..Options::default() };
    let standalone = Standalone::new(&options).expect("a device");
    let heard = standalone.close();
    assert!(heard.is_empty(), "{heard:?}");
    let only_core = Layers { core: true, ..Layers::default() };
    let seen = |layers| ALL.iter().filter(|c| c.runs_with(layers)).count();
    assert_eq!(seen(Layers::default()), 0, "without layers nothing can be heard");
    assert!(seen(only_core) < seen(Layers::CORE_SYNC) && seen(Layers::CORE_SYNC) < ALL.len());
    // What is reported is the fault that was planted, not any.
    let (first, second) = (&ALL[0], &ALL[1]);
    let messages = first.run(&options).expect("a device");
    assert!(first.is_reported(&messages) && !second.is_reported(&messages), "{messages:?}");
    assert!(!first.is_reported(&[]));
}
