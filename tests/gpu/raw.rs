//! The ceilings of `surfel bench raw`: every case runs, draws what is predicted, and keeps the layers silent.

use surfel::standalone::raw::{Case, Color, Measured, Passes, Setup, Untimed, cases, measure};
use surfel::standalone::{Options, bare};

use crate::vulkan;

const SETUP: Setup = Setup { points: 20_000, extent: [97, 81], rounds: 2 };

fn all(options: &Options, setup: &Setup) -> Vec<Measured> {
    let mut results = Vec::new();
    vulkan::run_with(options, |standalone| {
        let mut last = (0, 0);
        results = measure(&standalone, &cases(), setup, |done, all| {
            assert_eq!(done, last.0 + 1, "no step is left out");
            last = (done, all);
        })
        .expect("a device with timestamps");
        assert_eq!(last.0, last.1, "all is done at the end");
        standalone
    });
    results
}

#[test]
fn every_case_draws_what_is_predicted_and_has_rates() {
    let results = all(&vulkan::options(), &SETUP);
    assert_eq!(results.iter().map(|m| m.case).collect::<Vec<_>>(), cases());
    for m in &results {
        let case = m.case;
        let points = SETUP.points.min((SETUP.points * 16).div_ceil(case.size * case.size)) as u64;
        let passes = if case.passes == Passes::TwoPass { 2 } else { 1 };
        assert_eq!((m.points, m.fragments), (points, points * (case.size as u64).pow(2) * passes), "{case}");
        match &m.times {
            Ok(times) => {
                assert_eq!(times.len(), 2, "{case}");
                let rates = [m.points_per_second(), m.fragments_per_second()].concat();
                assert!(rates.len() == 4 && rates.iter().all(|r| r.is_finite() && *r > 0.0), "{case}: {rates:?}");
            }
            Err(Untimed::Lacking(what)) => assert!(!what.is_empty(), "{case}"),
            Err(Untimed::Wrong(how)) => panic!("{case}: {how}"),
        }
        let adds = case.blend && matches!(case.color, Color::Rgba32f | Color::R32f) && m.times.is_ok();
        assert_eq!(m.counted.is_some(), adds, "{case}");
        match (m.counted, case.passes) {
            (Some(counted), Passes::Color) => assert_eq!(counted, m.fragments, "{case}"),
            // Half of all points lie behind: in the second pass some are hidden and some stay.
            (Some(counted), _) => assert!(counted > 0 && counted < m.fragments / 2, "{case}: {counted}"),
            (None, _) => {}
        }
    }
    // What every device has: points of one pixel, quads, all formats.
    let timed = |of: &dyn Fn(&Case) -> bool| results.iter().any(|m| of(&m.case) && m.times.is_ok());
    assert!(timed(&|c| c.size == 1) && timed(&|c| c.axis == "primitive" && c.size == 64));
    assert!(timed(&|c| c.passes == Passes::TwoPass && c.attachments == 2));
}

#[test]
fn without_large_points_large_points_are_left_out() {
    let options = Options { without_large_points: true, ..vulkan::options() };
    let results = all(&options, &Setup { points: 100, extent: [64, 64], rounds: 1 });
    for m in results {
        let lacks = matches!(&m.times, Err(Untimed::Lacking(what)) if what == "largePoints");
        assert_eq!(lacks, m.case.to_string().contains("point") && m.case.size > 1, "{}", m.case);
    }
}

#[test]
fn what_is_refused_leaves_nothing_alive() {
    vulkan::run(|standalone| {
        let huge = surfel::ash::vk::Extent2D { width: 1 << 30, height: 1 };
        let refused = bare::measure(&standalone, &[[0.0; 4]], glam::Mat4::IDENTITY, 1.0, huge, 1);
        assert!(matches!(refused, Err(surfel::Error::Unsupported(_))), "{refused:?}");
        let size = Setup { extent: [65_535, 64], points: 10, rounds: 1 };
        // Wider than this device's pictures, or else it is measured; nothing stays alive either way.
        let _ = measure(&standalone, &cases()[..1], &size, |_, _| {});
        standalone
    });
}
