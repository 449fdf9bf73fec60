//! Cuts of sequential point trees: one entry a path, as a walk of the tree finds them, within the prefix.

use glam::{DVec3, DVec4, Vec3, Vec4};
use surfel::load::PointCloud;
use surfel::select::{DrawList, Sight};
use surfel::structure::nodes::{ErrorRule, NONE};
use surfel::structure::sequential::Options;
use surfel::structure::{Flat, Sequential};
use surfel::style::Interval;

use crate::groups::{random, soup};
use crate::sequential::{entries, sheet, with};

/// Entries from the root down, so that a parent comes before its children.
fn downward(tree: &Sequential) -> Vec<usize> {
    let mut order: Vec<usize> = (0..tree.flat.len()).collect();
    order.sort_by_key(|&i| tree.levels[i]);
    order
}

fn submitted(tree: &Sequential, sight: &Sight, interval: Interval) -> Vec<bool> {
    let mut list = DrawList::default();
    tree.select(sight, interval, false, 0, &mut list);
    let mut there = vec![false; tree.flat.len()];
    for s in &list.spans {
        there[s.first as usize..(s.first + s.count) as usize].fill(true);
    }
    there
}

/// Views of one tree: from within, at points, near, far; τ over six decades, up to τ_max and, now and then, beyond.
fn views(tree: &Sequential, count: usize, seed: u64, scale: f32) -> Vec<Sight> {
    let mut next = random(seed);
    let mut views = Vec::new();
    for k in 0..count {
        let mut vector = || Vec3::from_array([0; 3].map(|_: u8| 2.0 * next() - 1.0));
        let [x, y, z, r] = tree.flat.geometry[k * 31 % tree.flat.len()];
        let p = Vec3::new(x, y, z);
        let eye: Vec4 = match k % 8 {
            0 => vector().normalize().extend(0.0),
            1 => p.extend(1.0),
            2 => (p + r * vector()).extend(1.0),
            3 => (p + 0.01 * r * vector()).extend(1.0),
            4 => (30.0 * scale * vector()).extend(1.0),
            // Head-on and at a grazing angle.
            5 => (p + scale * (Vec3::Z + 1e-4 * vector())).extend(1.0),
            6 => (p + scale * (Vec3::X + 1e-4 * vector())).extend(1.0),
            _ => (1.5 * scale * vector()).extend(1.0),
        };
        let (small, large) = (next(), next());
        let tau = tree.nodes.tau_max as f64 * (-14.0 * small as f64).exp2();
        let tau = if k % 5 == 4 { tree.nodes.tau_max as f64 * (1.0 + 9.0 * large as f64) } else { tau };
        let tau = if k % 5 == 3 { tree.nodes.tau_max as f64 } else { tau };
        let tau = tau * if eye.w == 0.0 { scale as f64 } else { 1.0 };
        views.push(Sight { eye: eye.as_dvec4(), tau, planes: [DVec4::W; 5], radius_scale: 1.0 });
    }
    views
}

/// What a walk from the root draws.
fn walk(tree: &Sequential, order: &[usize], entry: &[usize], sight: &Sight) -> Vec<bool> {
    let (mut reached, mut drawn) = (vec![false; order.len()], vec![false; order.len()]);
    for &i in order {
        let [own, parent] = tree.nodes.links[i];
        reached[i] = parent == NONE || reached[entry[parent as usize]] && !drawn[entry[parent as usize]];
        let passes = own == NONE || sight.test().passes(tree.nodes.rule, &tree.nodes.nodes[own as usize]);
        drawn[i] = reached[i] && passes;
    }
    drawn
}

fn hold(tree: &Sequential, views: &[Sight], what: &str) {
    let (order, entry) = (downward(tree), entries(tree));
    let (mut inner, mut mixed) = (0, 0);
    for (v, sight) in views.iter().enumerate() {
        let monotone = sight.eye.w == 0.0 || sight.test().tau <= tree.nodes.tau_max;
        let (test, walked) = (sight.test(), walk(tree, &order, &entry, sight));
        let drawn: Vec<bool> = (0..order.len()).map(|i| test.selects(&tree.nodes, i)).collect();
        for interval in [Interval::Exact, Interval::Published] {
            let there = submitted(tree, sight, interval);
            let mut above = vec![0; order.len()];
            for &i in &order {
                let [own, parent] = tree.nodes.links[i];
                let [x, y, z, _] = tree.flat.geometry[i];
                let selected = match interval {
                    Interval::Exact => drawn[i],
                    Interval::Published => test.selects_published(&tree.nodes, i, Vec3::new(x, y, z)),
                };
                assert!(there[i] || !selected, "{what}, view {v}: entry {i} is drawn but not submitted, {interval}");
                above[i] = selected as u32 + if parent == NONE { 0 } else { above[entry[parent as usize]] };
                let exact = interval == Interval::Exact && monotone;
                if own == NONE {
                    assert!(above[i] > 0, "{what}, view {v}: a hole at {i}, {interval} {sight:?}");
                    assert!(!exact || above[i] == 1, "{what}, view {v}: {} times at {i} {sight:?}", above[i]);
                }
            }
        }
        assert!(!monotone || drawn == walked, "{what}, view {v}");
        inner += (0..order.len()).any(|i| drawn[i] && tree.nodes.links[i][0] != NONE) as usize;
        let depths = (0..order.len()).filter(|&i| drawn[i]).map(|i| tree.levels[i]);
        mixed += (depths.clone().max() > depths.min()) as usize;
    }
    assert!(
        inner > views.len() / 10 && mixed > views.len() / 20,
        "{what}: {inner} and {mixed} of {} views",
        views.len()
    );
}

/// Splats of which many share their place.
fn heaps() -> Flat {
    let mut flat = soup(300, 0.1, 3.0, 21);
    for i in 100..300 {
        let [x, y, z, _] = flat.geometry[i % 7];
        [flat.geometry[i][0], flat.geometry[i][1], flat.geometry[i][2]] = [x, y, z];
    }
    flat
}

fn many(rule: ErrorRule) {
    let torus = surfel::load::synthetic::scene("torus", 400, 1).expect("a torus");
    let clouds = [
        soup(200, 0.1, 3.0, 1),
        sheet(250, 0.02, 2),
        sheet(250, 0.0, 3),
        sheet(250, 0.2, 4),
        heaps(),
        Flat::new(&torus),
    ];
    for (k, flat) in clouds.iter().enumerate() {
        for tau_max in [1.0 / 32.0, 0.5] {
            let tree = Sequential::build(flat, &Options { tau_max, ..with(rule) });
            hold(&tree, &views(&tree, 3000, k as u64, 1.0), &format!("{rule}, cloud {k}"));
        }
        let colored = Sequential::build(flat, &Options { rule, clusters: true, ..Options::default() });
        hold(&colored, &views(&colored, 800, 9 + k as u64, 1.0), &format!("{rule}, clusters, cloud {k}"));
        let placed = Sequential::build(flat, &Options { blocks: 30, ..with(rule) });
        assert!(placed.lists.len() > 4 || flat.len() < 30, "{} lists", placed.lists.len());
        hold(&placed, &views(&placed, 800, 19 + k as u64, 1.0), &format!("{rule}, blocks, cloud {k}"));
    }
}

#[test]
fn one_entry_a_path_geometric() {
    many(ErrorRule::Geometric);
}

#[test]
fn one_entry_a_path_split() {
    many(ErrorRule::Split);
}

#[test]
fn one_entry_a_path_diameter() {
    many(ErrorRule::Diameter);
}

#[test]
fn one_entry_a_path_cell() {
    many(ErrorRule::Cell);
}

#[test]
fn one_entry_a_path_at_any_scale() {
    for (_, rule) in ErrorRule::ALL {
        for scale in [1e-6, 1e7] {
            let mut flat = soup(200, 0.1, 3.0, 5);
            flat.geometry.iter_mut().flatten().for_each(|v| *v *= scale);
            let tree = Sequential::build(&flat, &with(*rule));
            hold(&tree, &views(&tree, 1000, 3, scale), &format!("{rule}, {scale}"));
        }
    }
}

#[test]
fn one_entry_a_path_where_errors_are_at_the_limit() {
    // τ within a few steps of what lets a node pass: where rounding decides.
    for (_, rule) in ErrorRule::ALL {
        for (k, flat) in [soup(150, 0.1, 3.0, 31), sheet(200, 0.01, 32), heaps()].iter().enumerate() {
            let tree = Sequential::build(flat, &with(*rule));
            let mut sights = views(&tree, 4000, 17, 1.0);
            for (v, sight) in sights.iter_mut().enumerate() {
                let node = &tree.nodes.nodes[v * 13 % tree.nodes.nodes.len()];
                let between = Vec3::from(node.position).as_dvec3() * sight.eye.w - sight.eye.truncate();
                let (r, n) = (between.length(), Vec3::from(node.normal).as_dvec3());
                let cosine = n.dot(between / r).abs().min(1.0);
                let split = *rule == ErrorRule::Split;
                let sine = if split { (1.0 - cosine * cosine).sqrt() } else { 1.0 };
                let error = node.error as f64 * sine + node.tangential as f64 * cosine;
                let limit = error / r * (1.0 + (v as f64 % 9.0 - 4.0) * 5e-8);
                if limit > 0.0 && limit < tree.nodes.tau_max as f64 {
                    sight.tau = limit;
                }
            }
            hold(&tree, &sights, &format!("{rule}, cloud {k}"));
        }
    }
}

#[test]
fn a_prefix_is_short_from_afar() {
    let flat = Flat::new(&PointCloud { ..surfel::load::synthetic::scene("torus", 20_000, 1).expect("a torus") });
    let tree = Sequential::build(&flat, &Options::default());
    let sight = Sight { eye: DVec3::splat(100.0).extend(1.0), tau: 0.001, planes: [DVec4::W; 5], radius_scale: 1.0 };
    let there = submitted(&tree, &sight, Interval::Exact);
    let drawn = (0..tree.flat.len()).filter(|&i| sight.test().selects(&tree.nodes, i)).count();
    let there = there.iter().filter(|t| **t).count();
    assert!(drawn < tree.flat.len() / 4 && there < 2 * drawn && drawn > 100, "{drawn} of {there}");
    // And outside the picture there is none.
    let beside = Sight { planes: [DVec3::X.extend(-1e3); 5], ..sight };
    assert!(!submitted(&tree, &beside, Interval::Exact).contains(&true));
}
