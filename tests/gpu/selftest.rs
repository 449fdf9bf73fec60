//! The self-test of the shipped binary passes here, with the checks of this run.

use surfel::standalone::Layers;
use surfel::standalone::selftest::{self, Options};
use surfel::technique::PRESETS;

use crate::vulkan;

#[test]
fn the_self_test_passes() {
    let layers = vulkan::layers();
    let mut heard = 0;
    let report = selftest::run(&Options { layers, device: None }, |_| heard += 1).expect("a device");
    let failed: Vec<_> = report.cases.iter().filter(|c| !c.passed()).collect();
    assert!(report.passed(), "{}: {failed:#?}", report.device);
    assert_eq!(heard, report.cases.len(), "progress is told of every case");
    let techniques = report.cases.iter().filter(|c| c.group == "techniques").count();
    assert_eq!(techniques % PRESETS.len(), 0);
    assert!(techniques >= 4 * PRESETS.len(), "{techniques}");
    let canaries = report.cases.len() - techniques;
    assert!(canaries >= 12 || layers == Layers::default(), "{canaries} canaries");
    let names: std::collections::BTreeSet<_> = report.cases.iter().map(|c| (c.group, &c.name)).collect();
    assert_eq!(names.len(), report.cases.len(), "names are unique");
}

#[test]
fn a_device_that_is_not_there_is_an_error() {
    let options = Options { layers: Layers::default(), device: Some("no such device".into()) };
    let refused = selftest::run(&options, |case| panic!("{case:?} ran"));
    assert!(refused.is_err_and(|e| e.to_string().contains("no device of that name")));
}
