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
    let options = Options { without: vec!["largePoints".into()], ..vulkan::options() };
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

#[test]
fn the_binary_writes_a_report_and_compares_it() {
    let folder = std::env::temp_dir().join(format!("surfel-raw-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let (old, new) = (path("old.json"), path("new.json"));
    let bench = |args: &[&str]| {
        let binary = env!("CARGO_BIN_EXE_surfel");
        let output = std::process::Command::new(binary).args(["bench", "raw"]).args(args).output().unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        (output.status.code(), text(output.stdout), text(output.stderr))
    };
    let (code, table, errors) = bench(&["--quick", "--out", &old]);
    assert_eq!((code, errors.as_str()), (Some(0), ""), "{table}");
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(&old).unwrap()).unwrap();
    assert_eq!((&report["points"], &report["rounds"]), (&20_000.into(), &5.into()));
    let listed = report["cases"].as_array().unwrap();
    assert_eq!(listed.len(), cases().len());
    for (case, value) in cases().iter().zip(listed) {
        assert_eq!(value["name"].as_str(), Some(case.to_string().as_str()));
        assert!(table.contains(&case.to_string()), "{table}");
        assert!(value["lacks"].is_string() != (value["gpu_ms"].as_array().map(Vec::len) == Some(5)), "{value}");
        if !value["gpu_ms"].is_null() {
            let mut ms: Vec<f64> = value["gpu_ms"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
            ms.sort_by(f64::total_cmp);
            let expected = value["points"].as_f64().unwrap() * 1e3 / ms[2];
            let median = value["points_per_s"]["median"].as_f64().unwrap();
            assert!((median / expected - 1.0).abs() < 1e-12, "{value}");
        }
    }

    // Another device, a case that is gone, and one that took a thousand times as long.
    let mut before = report.clone();
    before["device"] = "another".into();
    before["cases"][1]["name"] = "gone".into();
    for ms in before["cases"][0]["gpu_ms"].as_array_mut().unwrap() {
        *ms = (ms.as_f64().unwrap() * 1e3).into();
    }
    std::fs::write(&old, before.to_string()).unwrap();
    let (code, text, _) = bench(&["--quick", "--out", &new, "--baseline", &old, "-q"]);
    assert_eq!(code, Some(0));
    assert!(text.contains("WARNING: another device") && text.contains("gone") && text.contains("MISSING"), "{text}");
    let base = text.lines().find(|l| l.starts_with(&cases()[0].to_string())).unwrap();
    assert!(base.ends_with("faster"), "{base}");
    assert_eq!(bench(&["--quick", "--out", &old, "--baseline", &old]).0, Some(1), "the baseline is not overwritten");
    assert_eq!(bench(&["--size", "63x64"]).0, Some(2));
    std::fs::write(&old, "{}").unwrap();
    let (code, _, errors) = bench(&["--quick", "--baseline", &old]);
    assert!(code == Some(1) && errors.contains("old.json"), "{errors}");
    std::fs::remove_dir_all(folder).unwrap();
}
