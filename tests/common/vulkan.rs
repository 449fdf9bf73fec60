//! A device with the layers on for every GPU test, and a guard that fails the test on any message.
//!
//! `SURFEL_LAYERS` (default `core,sync`) says which checks run, `SURFEL_ROBUSTNESS=1` enables robustness2, and
//! `SURFEL_HASHES` names a file that collects a hash of every picture, so that two passes can be compared.

use std::io::Write as _;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

use surfel::ash::vk;
use surfel::readback::Picture;
use surfel::standalone::{Layers, Message, Offscreen, Options, Standalone};

/// The checks that this run is to make.
pub fn layers() -> Layers {
    match std::env::var("SURFEL_LAYERS") {
        Ok(list) => Layers::parse(&list).unwrap_or_else(|e| panic!("SURFEL_LAYERS: {e}")),
        Err(_) => Layers::CORE_SYNC,
    }
}

/// What the environment asks for.
pub fn options() -> Options {
    let robustness = std::env::var_os("SURFEL_ROBUSTNESS").is_some_and(|v| v == "1");
    Options { layers: layers(), robustness, ..Options::default() }
}

/// Opens a device, and makes sure that the wanted checks are really on.
///
/// # Panics
/// Without a device, or with a check missing: neither is a reason to pass.
pub fn open(options: &Options) -> Standalone {
    let standalone = Standalone::new(options)
        .unwrap_or_else(|e| panic!("GPU tests need a Vulkan device, and none could be opened: {e}"));
    let lacking = standalone.lacking(options.layers);
    assert!(lacking.is_empty(), "checks that are not on: {lacking:?}; the layer says: {}", standalone.enables());
    standalone
}

/// Runs a test on a device of its own and fails on any message, up to those about what was left alive at the end. The
/// test has to give the device back, so nobody can forget to look.
pub fn run(test: impl FnOnce(Standalone) -> Standalone) {
    run_with(&options(), test);
}

/// The same with other options.
pub fn run_with(options: &Options, test: impl FnOnce(Standalone) -> Standalone) {
    silent(test(open(options)).close());
}

/// The same with a target to draw to. A test that panics is reported as it panicked, not by what it left alive.
pub fn draw(extent: [u32; 2], depth: bool, test: impl FnOnce(&mut Offscreen)) {
    draw_with(&options(), extent, depth, test);
}

/// The same with other options.
pub fn draw_with(options: &Options, [width, height]: [u32; 2], depth: bool, test: impl FnOnce(&mut Offscreen)) {
    run_with(options, |standalone| {
        let mut offscreen = Offscreen::new(standalone, vk::Extent2D { width, height }, depth).expect("a target");
        let done = catch_unwind(AssertUnwindSafe(|| test(&mut offscreen)));
        let standalone = offscreen.destroy();
        if let Err(panic) = done {
            let messages = standalone.messages();
            eprintln!("the test panicked; messages of the layers until then: {messages:#?}");
            drop(standalone);
            resume_unwind(panic);
        }
        standalone
    });
}

/// # Panics
/// If the layers said anything.
pub fn silent(messages: Vec<Message>) {
    let texts: Vec<_> = messages.iter().map(|m| format!("{}: {}", m.id, m.text)).collect();
    assert!(texts.is_empty(), "{} validation messages:\n{}", texts.len(), texts.join("\n"));
}

/// FNV-1a over size, colours and depths, bit by bit.
pub fn digest(picture: &Picture) -> u64 {
    let words = [picture.width, picture.height].into_iter();
    let colors = picture.rgba.iter().flatten().map(|v| v.to_bits());
    let depths = picture.depth.iter().flatten().map(|v| v.to_bits());
    let bytes = words.chain(colors).chain(depths).flat_map(u32::to_le_bytes);
    bytes.fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ b as u64).wrapping_mul(0x0100_0000_01b3))
}

/// Appends the picture's hash to the file that `SURFEL_HASHES` names, if it does. Names are unique in a run.
pub fn hash(name: &str, picture: &Picture) {
    if let Some(file) = std::env::var_os("SURFEL_HASHES") {
        // One write a line: lines of tests that run at once do not mix.
        let line = format!("{name} {:016x}\n", digest(picture));
        let written = std::fs::OpenOptions::new()
            .create(true)
            .append(true)
            .open(&file)
            .and_then(|mut f| f.write_all(line.as_bytes()));
        written.unwrap_or_else(|e| panic!("SURFEL_HASHES {}: {e}", file.display()));
    }
}
