//! Groups of layered point clouds: no two samples that overlap in a whole level share one, and what large models lose.

use std::collections::HashMap;
use std::path::PathBuf;

use glam::{DVec3, IVec3};
use surfel::load::Pieces;
use surfel::structure::Flat;
use surfel::structure::groups::{Groups, Relax};
use surfel::structure::layered::{Options, build, whole};

use crate::folder::Folder;
use crate::layered::{Model, scene, small};

/// Samples of a cut of whole levels, each with the radius that it is drawn with, and the numbers of all samples in a flat order.
fn level(model: &Model, deepest: u8) -> Vec<(u32, f32)> {
    let nodes = &model.index.nodes;
    let mut cut = Vec::new();
    let mut first = 0;
    for (node, patch) in nodes.iter().zip(&model.patches) {
        for (i, (p, own)) in patch.positions.iter().zip(&patch.radii).enumerate().filter(|_| node.level <= deepest) {
            // From its own node down, as it is drawn: rounding may have moved it across a cut further up.
            let mut at = node;
            while at.split < 3 && at.level < deepest {
                let side = (p[at.split as usize] >= at.plane) as usize;
                let Some(child) = nodes.get(at.children[side] as usize) else { break };
                at = child;
            }
            cut.push((first + i as u32, if at.split == 3 { *own } else { own.max(at.spacing) }));
        }
        first += patch.positions.len() as u32;
    }
    cut
}

#[test]
fn groups_do_not_overlap_in_any_level() {
    let relax = Relax { factor: 0.7, opposing: false, ..Relax::NONE };
    let model = Model::new("layered-groups", &scene("demo", 30_000), &Options { groups: Some(relax), ..small() });
    let flat = whole(&model.index, &model.access).expect("all");
    let groups = flat.groups.as_ref().expect("groups");
    let count = groups.of.iter().max().map(|g| u32::from(*g) + 1);
    assert_eq!((model.index.groups, Some(groups.count)), (count, count));
    let told: Vec<u8> = model.patches.iter().flat_map(|p| p.groups.iter().flatten().copied()).collect();
    assert!(told == groups.of && told.len() == flat.len());
    let levels = model.index.nodes.last().expect("nodes").level;
    assert!(levels > 5, "{levels}");
    for l in 0..=levels {
        let cut = level(&model, l);
        assert_eq!(groups.overlaps(&flat, &cut, 0.7).expect("a count"), 0, "level {l}");
        // Without its groups it would.
        let one = Groups { of: vec![0; flat.len()], ..groups.clone() };
        assert!(one.overlaps(&flat, &cut, 0.7).expect("a count") > 100, "level {l}");
    }
}

/// More than are coloured as one: what is lost lies at the borders of the parts, a sample beside finer ones that have theirs.
#[test]
fn groups_of_large_models_overlap_at_borders_alone() {
    let relax = Relax { factor: 0.7, opposing: false, ..Relax::NONE };
    let options = Options { groups: Some(relax), samples: 1024, ..Options::default() };
    let model = Model::new("layered-parts", &scene("terrain", 300_000), &options);
    let flat = whole(&model.index, &model.access).expect("all");
    let groups = flat.groups.as_ref().expect("groups");
    let of_node: Vec<u32> = (0..).zip(&model.patches).flat_map(|(n, p)| vec![n; p.positions.len()]).collect();
    let below: Vec<u64> = (0..model.index.nodes.len() as u32)
        .map(|n| model.below(n).iter().map(|i| u64::from(model.index.nodes[*i as usize].samples)).sum())
        .collect();
    let part = |sample: u32| {
        let path = model.path(of_node[sample as usize]);
        path.iter().copied().find(|n| below[*n as usize] <= 1 << 16).unwrap_or(path[path.len() - 1])
    };
    let cut = level(&model, u8::MAX);
    // In the order in which parts are coloured: the way down, a side a level.
    let way = |sample: u32| {
        let side = |n: u32| model.index.nodes[model.index.nodes[n as usize].parent as usize].children[1] == n;
        let path = model.path(part(sample));
        path[1..].iter().map(|n| side(*n)).collect::<Vec<bool>>()
    };
    let (mut within, mut across, mut lost) = (0, 0, 0);
    for (a, b) in pairs(&flat, &cut, 0.7) {
        let shared = groups.of[a as usize] == groups.of[b as usize];
        if part(a) == part(b) {
            assert!(!shared, "samples {a} and {b}, within a part");
            within += 1;
            continue;
        }
        across += 1;
        lost += u64::from(shared);
        let [a, b] = if way(a) < way(b) { [a, b] } else { [b, a] };
        let [first, then] = [a, b].map(|s| model.index.nodes[of_node[s as usize] as usize].level);
        assert!(!shared || then < first, "sample {b} of level {then} after {a} of level {first}");
    }
    println!("{within} pairs within parts, {across} across, {lost} of these lost");
    assert!(within > 100_000 && across > 1000 && lost > 0, "{within} pairs within parts, {across} across, {lost} lost");
    assert_eq!(groups.overlaps(&flat, &cut, 0.7).expect("a count"), lost);
}

/// All pairs of a cut nearer than c times the sum of their radii, found in a grid as wide as the widest two may be apart.
fn pairs(flat: &Flat, cut: &[(u32, f32)], c: f64) -> Vec<(u32, u32)> {
    let width = 2.0 * c * cut.iter().map(|s| s.1).fold(0.0, f32::max) as f64;
    let place = |s: u32| DVec3::from([0, 1, 2].map(|a| f64::from(flat.geometry[s as usize][a])));
    let cell = |s: u32| (place(s) / width).floor().as_ivec3();
    let mut cells: HashMap<IVec3, Vec<(u32, f32)>> = HashMap::new();
    let mut found = Vec::new();
    for &(a, r) in cut {
        for n in 0..27 {
            let beside = cell(a) + IVec3::new(n % 3, n / 3 % 3, n / 9) - 1;
            let near = |(b, other): &&(u32, f32)| place(a).distance(place(*b)) < c * (f64::from(r) + f64::from(*other));
            found.extend(cells.get(&beside).into_iter().flatten().filter(near).map(|(b, _)| (*b, a)));
        }
        cells.entry(cell(a)).or_default().push((a, r));
    }
    found
}

#[test]
fn groups_that_make_no_sense_are_refused() {
    let folder = Folder::new("layered-no-groups");
    let path = PathBuf::from(folder.path("m.lpc"));
    let options = Options { groups: Some(Relax { limit: 0, ..Relax::default() }), ..small() };
    let error = build(vec![Pieces::of(scene("sphere", 100))], &path, &options).expect_err("no groups").to_string();
    assert!(error.contains("1 to 256") && !path.exists(), "{error}");
    // Too few: all are drawn, and it is said how many share.
    let options = Options { groups: Some(Relax { limit: 2, ..Relax::NONE }), ..small() };
    let built = build(vec![Pieces::of(scene("sphere", 3000))], &path, &options).expect("a model");
    assert_eq!(built.index.groups, Some(2));
    assert!(built.report.assumed.iter().any(|line| line.contains("too few groups")), "{:?}", built.report.assumed);
}
