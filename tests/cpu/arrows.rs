//! Who may use whom: the arrows of docs/ARCHITECTURE.md.

use std::fs;
use std::path::{Path, PathBuf};

fn sources(folder: &Path, into: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder of the package") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            sources(&path, into);
        } else if path.extension().is_some_and(|e| e == "rs") {
            into.push(path);
        }
    }
}

/// Lines of the room's code that name one of `others`; comments do not count.
fn uses(room: &str, others: &[&str]) -> Vec<String> {
    let mut files = Vec::new();
    sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src").join(room), &mut files);
    assert!(!files.is_empty(), "no room {room}");
    let mut found = Vec::new();
    for file in files {
        let text = fs::read_to_string(&file).expect("a source file");
        for (line, code) in (1..).zip(text.lines().map(|l| l.split("//").next().unwrap_or_default())) {
            if others.iter().any(|o| code.contains(o)) {
                found.push(format!("{}:{line}: {}", file.display(), code.trim()));
            }
        }
    }
    found
}

fn never(room: &str, others: &[&str]) {
    let found = uses(room, others);
    assert!(found.is_empty(), "{room} uses what it must not:\n{}", found.join("\n"));
}

#[test]
fn the_reference_knows_nothing_of_the_device() {
    never("reference", &["crate::gpu", "crate::draw", "crate::composite", "ash::", "spirv"]);
}

#[test]
fn structures_and_selections_know_no_vulkan() {
    for room in ["structure", "select", "load", "measure", "stream"] {
        never(room, &["crate::gpu", "crate::draw", "crate::composite", "ash::", "vk::", "unsafe {"]);
    }
}

#[test]
fn streams_know_only_bytes() {
    never("stream", &["crate::load", "crate::structure", "crate::select", "crate::host", "crate::renderer"]);
}

#[test]
fn the_device_knows_no_points() {
    let rooms =
        ["load", "structure", "select", "draw", "composite", "reference", "measure", "host", "renderer", "style"];
    let names: Vec<String> = rooms.iter().map(|r| format!("crate::{r}")).collect();
    never("gpu", &names.iter().map(String::as_str).collect::<Vec<_>>());
}

#[test]
fn passes_and_tools_leave_unsafe_to_the_device() {
    for room in ["draw", "composite", "cli", "reference"] {
        never(room, &["unsafe {", "unsafe fn"]);
    }
}

#[test]
fn an_arrow_that_exists_is_seen() {
    assert!(!uses("draw", &["crate::gpu"]).is_empty());
}
