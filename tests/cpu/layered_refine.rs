//! Cuts of layered point clouds: what is drawn, what is left out, what is missing, and how large samples are.

use std::collections::BTreeSet;

use glam::Vec3;
use surfel::select::Sight;
use surfel::select::layered::{Cut, Refine, Role, Room, Rule, Wish, affordable, refine, refine_visible, wishes};
use surfel::structure::nodes::NONE;

use crate::layered_common::{Model, Random, any_sight, degenerate, meets, surface, to_eye, with_strays};

fn models() -> Vec<Model> {
    vec![
        Model::build(&surface(3000, 1), 32),
        Model::build(&with_strays(2000, 2), 16),
        Model::build(&surface(500, 3), 200),
        Model::build(&surface(60, 4), 1),
    ]
}

fn all(_: u32) -> f32 {
    1.0
}

fn cut(model: &Model, sight: &Sight, options: &Refine, presence: impl Fn(u32) -> f32) -> Cut {
    let mut cut = Cut::default();
    refine(&model.index, sight, options, presence, &mut cut);
    cut
}

fn numbers(cut: &Cut, role: Role) -> BTreeSet<u32> {
    cut.steps.iter().filter(|step| step.role == role).map(|step| step.node).collect()
}

/// By the definition, node by node, without a traversal: nodes of each role, missing ones, what is near.
#[derive(Default, PartialEq, Debug)]
struct Oracle {
    drawn: BTreeSet<u32>,
    cone: BTreeSet<u32>,
    frustum: BTreeSet<u32>,
    missing: BTreeSet<u32>,
    near: BTreeSet<u32>,
    soon: BTreeSet<u32>,
}

fn oracle(model: &Model, sight: &Sight, options: &Refine, there: &[bool]) -> Oracle {
    let nodes = &model.index.nodes;
    let spacing = |i: u32| match options.rule {
        Rule::Measured => nodes[i as usize].spacing,
        Rule::Published => nodes[i as usize].published,
    };
    let mut found = Oracle::default();
    for i in 0..nodes.len() as u32 {
        // From the root down to the node.
        let mut path = vec![i];
        while nodes[path[0] as usize].parent != NONE {
            path.insert(0, nodes[path[0] as usize].parent);
        }
        let out = |k: usize| {
            let it = &nodes[path[k] as usize];
            let above = spacing(path[k.max(1) - 1]);
            let reach = if k == 0 { above } else { 2.0 * above };
            sight.misses_ball(it.centre, it.ball, if k == 0 { 2.0 * reach } else { reach }.max(it.reach))
        };
        let turned = |k: usize| {
            let it = &nodes[path[k] as usize];
            options.back_faces_culled && sight.faces_away(it.centre, it.ball, it.axis, it.cone)
        };
        let pressure = |k: usize| {
            let it = &nodes[path[k] as usize];
            let d = (it.centre.as_dvec3() - sight.eye.truncate()).length() - it.ball as f64;
            let d = if sight.eye.w == 0.0 { 1.0 } else { d.max(0.0) };
            spacing(path[k]) as f64 / (sight.tau * d) / options.factor
        };
        let own = path.len() - 1;
        // Asked for: all above it are refined, there, and not outside the frustum.
        let above_there = (0..own).all(|k| there[path[k] as usize] && !out(k));
        let refined = (0..own).all(|k| pressure(k) > 1.0);
        let away = (0..=own).any(turned);
        if above_there && refined {
            match (out(own), away, there[i as usize]) {
                (true, ..) => found.frustum.insert(i),
                (_, true, _) => found.cone.insert(i),
                (_, _, true) => found.drawn.insert(i),
                _ => found.missing.insert(i),
            };
            continue;
        }
        let above_refined = above_there && own > 0 && (0..own - 1).all(|k| pressure(k) > 1.0);
        if above_refined && pressure(own - 1) > options.prefetch && !out(own) && !away {
            if there[i as usize] {
                found.near.insert(i)
            } else {
                found.soon.insert(i)
            };
        }
    }
    found
}

#[test]
fn cuts_are_what_testing_every_node_finds() {
    let mut random = Random(10);
    let mut sums = [0usize; 6];
    for (m, model) in models().iter().enumerate() {
        for view in 0..500 {
            let sight = any_sight(&mut random);
            let options = Refine {
                rule: [Rule::Measured, Rule::Published][random.below(2)],
                factor: [1.0, 1.7][random.below(2)],
                back_faces_culled: random.below(2) == 1,
                prefetch: [1.0, 0.2][random.below(2)],
                ..Refine::default()
            };
            // Some are not there; what is there has a parent that is, or the traversal must not find it.
            let share = [1.0, 0.9, 0.5][random.below(3)];
            let there: Vec<bool> = (0..model.len()).map(|i| i == 0 && view % 50 > 0 || random.unit() < share).collect();
            let cut = cut(model, &sight, &options, |i| there[i as usize] as u32 as f32);
            let expected = oracle(model, &sight, &options, &there);
            let soon = |sign: fn(&Wish) -> bool| -> BTreeSet<u32> {
                cut.wishes.iter().filter(|w| sign(w)).map(|w| w.node).collect()
            };
            let frustum: BTreeSet<u32> =
                expected.frustum.iter().copied().filter(|&i| there[i as usize] && i > 0).collect();
            let cone: BTreeSet<u32> = expected.cone.iter().copied().filter(|&i| there[i as usize]).collect();
            let name = format!("model {m}, view {view}, {options:?}");
            assert_eq!(numbers(&cut, Role::Drawn), expected.drawn, "{name}");
            assert_eq!(numbers(&cut, Role::Outside), frustum, "{name}");
            assert_eq!(numbers(&cut, Role::BackFacing), cone, "{name}");
            assert_eq!(soon(|w| w.priority > 0.0), expected.missing, "{name}");
            assert_eq!(soon(|w| w.priority < 0.0), expected.soon, "{name}");
            assert_eq!(cut.near.iter().copied().collect::<BTreeSet<_>>(), expected.near, "{name}");
            assert!(cut.steps.windows(2).all(|w| w[0].node < w[1].node), "{name}: in the index's order");
            let counts = cut.counts;
            let found = [
                expected.drawn.len(),
                expected.frustum.len(),
                expected.cone.len(),
                expected.missing.len(),
                expected.near.len(),
                expected.soon.len(),
            ];
            let counted = [counts.drawn, counts.frustum, counts.cone, counts.missing].map(|n| n as usize);
            assert_eq!(counted, found[..4], "{name}");
            assert_eq!(counts.visited as usize, found[..4].iter().sum::<usize>(), "{name}");
            let samples: u64 = expected.drawn.iter().map(|&i| model.index.nodes[i as usize].samples as u64).sum();
            assert_eq!(counts.samples, samples, "{name}");
            (0..6).for_each(|k| sums[k] += found[k]);
        }
    }
    assert!(sums.iter().all(|n| *n > 100), "what was met: {sums:?}");
}

#[test]
fn what_is_in_the_picture_is_drawn_down_to_the_threshold() {
    let mut random = Random(11);
    let (mut coarse, mut complete) = (0, 0);
    for model in &models() {
        for _ in 0..200 {
            let sight = any_sight(&mut random);
            let culled = random.below(2) == 1;
            let cut = cut(model, &sight, &Refine { back_faces_culled: culled, ..Refine::default() }, all);
            let drawn = numbers(&cut, Role::Drawn);
            for (node, samples) in model.samples.iter().enumerate() {
                for &(p, n) in samples {
                    let (v, distance) = to_eye(&sight, p);
                    if !meets(&sight, p, 0.0) || culled && v.dot(n.as_dvec3()) <= 0.0 {
                        continue;
                    }
                    if drawn.contains(&(node as u32)) {
                        complete += 1;
                        continue;
                    }
                    // The first that is not drawn on the way down has a parent that suffices here.
                    let mut above = 0;
                    while let Some(below) = model.below(above, p).filter(|below| drawn.contains(below)) {
                        above = below;
                    }
                    assert!(drawn.contains(&above));
                    let spacing = model.index.nodes[above as usize].spacing as f64;
                    assert!(spacing <= sight.tau * distance * (1.0 + 1e-9), "{spacing} at {distance}");
                    coarse += 1;
                }
            }
        }
    }
    assert!(coarse > 10_000 && complete > 10_000, "{coarse}, {complete}");
}

#[test]
fn nothing_that_is_seen_is_left_out() {
    let mut random = Random(12);
    let (mut beside, mut away) = (0, 0);
    for model in &models() {
        // All below a node, itself included.
        let nodes = &model.index.nodes;
        let mut subtrees: Vec<Vec<(Vec3, Vec3)>> = model.samples.clone();
        for i in (1..nodes.len()).rev() {
            let own = subtrees[i].clone();
            subtrees[nodes[i].parent as usize].extend(own);
        }
        for _ in 0..300 {
            let sight = any_sight(&mut random);
            let cut = cut(model, &sight, &Refine { back_faces_culled: true, ..Refine::default() }, all);
            for step in &cut.steps {
                let node = &nodes[step.node as usize];
                let above = nodes.get(node.parent as usize).unwrap_or(node).spacing;
                for &(p, n) in &subtrees[step.node as usize] {
                    match step.role {
                        Role::Outside => assert!(!meets(&sight, p, above as f64 * sight.radius_scale)),
                        Role::BackFacing => assert!(to_eye(&sight, p).0.dot(n.as_dvec3()) < 0.0),
                        Role::Drawn | Role::Hidden => {}
                    }
                }
                beside += usize::from(step.role == Role::Outside);
                away += usize::from(step.role == Role::BackFacing);
            }
        }
    }
    assert!(beside > 3000 && away > 1000, "{beside}, {away}");
}

#[test]
fn nothing_below_what_is_hidden_is_refined_or_wished_for() {
    let mut random = Random(14);
    let mut hidden_steps = 0;
    for model in &models() {
        let nodes = &model.index.nodes;
        for _ in 0..100 {
            let sight = any_sight(&mut random);
            let options = Refine { back_faces_culled: true, prefetch: 0.7, ..Refine::default() };
            let hidden: Vec<bool> = nodes.iter().map(|_| random.below(5) == 0).collect();
            // Parents of what is there are there.
            let mut there = vec![true; nodes.len()];
            for i in 1..nodes.len() {
                there[i] = there[nodes[i].parent as usize] && random.below(6) > 0;
            }
            let presence = |node: u32| f32::from(there[node as usize]);
            let full = cut(model, &sight, &options, presence);
            let mut seen = Cut::default();
            refine_visible(&model.index, &sight, &options, presence, |n| hidden[n as usize], &mut seen);
            // A node is below something hidden where an ancestor is shown in the full cut, and hidden.
            let shown = numbers(&full, Role::Drawn);
            let above = |mut node: u32| {
                while nodes[node as usize].parent != NONE {
                    node = nodes[node as usize].parent;
                    if shown.contains(&node) && hidden[node as usize] {
                        return true;
                    }
                }
                false
            };
            let kept = |role| -> BTreeSet<u32> { numbers(&full, role).into_iter().filter(|n| !above(*n)).collect() };
            let (found, visible): (BTreeSet<u32>, BTreeSet<u32>) =
                kept(Role::Drawn).into_iter().partition(|n| hidden[*n as usize]);
            assert_eq!(numbers(&seen, Role::Hidden), found);
            assert_eq!(numbers(&seen, Role::Drawn), visible);
            assert_eq!(numbers(&seen, Role::BackFacing), kept(Role::BackFacing));
            assert_eq!(numbers(&seen, Role::Outside), kept(Role::Outside));
            let wishes = |cut: &Cut| -> BTreeSet<u32> { cut.wishes.iter().map(|w| w.node).collect() };
            assert_eq!(wishes(&seen), wishes(&full).into_iter().filter(|n| !above(*n)).collect());
            let counts = seen.counts;
            let sum = counts.drawn + counts.frustum + counts.cone + counts.missing + counts.occluded;
            assert_eq!((counts.visited, counts.occluded), (sum, found.len() as u32));
            hidden_steps += found.len();
        }
    }
    assert!(hidden_steps > 500, "{hidden_steps}");
}

#[test]
fn larger_thresholds_draw_less_of_the_same() {
    let mut random = Random(13);
    for model in &models() {
        for _ in 0..200 {
            let sight = any_sight(&mut random);
            let mut last: Option<BTreeSet<u32>> = None;
            for factor in [0.2, 0.5, 1.0, 1.1, 3.0, 100.0] {
                let options = Refine { factor, back_faces_culled: true, ..Refine::default() };
                let drawn = numbers(&cut(model, &sight, &options, all), Role::Drawn);
                assert!(last.is_none_or(|last| drawn.is_subset(&last)));
                last = Some(drawn);
            }
        }
    }
}

/// By the definition: the deepest node of the cut, below the sample's own, whose region has the place.
fn radius(model: &Model, cut: &Cut, node: u32, p: Vec3) -> f32 {
    let in_cut: BTreeSet<u32> = cut.steps.iter().map(|step| step.node).collect();
    let mut deepest = node;
    while let Some(below) = model.below(deepest, p).filter(|below| in_cut.contains(below)) {
        deepest = below;
    }
    model.index.nodes[deepest as usize].spacing
}

#[test]
fn radii_are_those_of_the_deepest_node_and_do_not_change_at_borders() {
    let mut random = Random(14);
    let (mut seen, mut refined) = (0, 0);
    for model in &models() {
        for _ in 0..100 {
            let sight = any_sight(&mut random);
            let blind = Sight { planes: [glam::DVec4::W; 5], ..sight.clone() };
            let some = cut(model, &sight, &Refine { back_faces_culled: true, ..Refine::default() }, all);
            let every = cut(model, &blind, &Refine::default(), all);
            for step in some.drawn() {
                let (own, whole) = (some.step_of(step.node).unwrap(), every.step_of(step.node).unwrap());
                for &(p, _) in &model.samples[step.node as usize] {
                    let r = some.radius_of(own, p.to_array());
                    assert_eq!(r, radius(model, &some, step.node, p));
                    // Where the sample can be seen, nothing is culled that it could depend on.
                    if meets(&sight, p, r as f64 * sight.radius_scale) {
                        assert_eq!(r, every.radius_of(whole, p.to_array()), "node {}", step.node);
                        seen += 1;
                        refined += usize::from(r < model.index.nodes[step.node as usize].spacing);
                    }
                }
            }
        }
    }
    assert!(seen > 50_000 && refined > 10_000, "{seen}, {refined}");
}

#[test]
fn where_children_are_missing_their_parent_s_samples_stay_large() {
    let model = &models()[0];
    let sight = any_sight(&mut Random(3));
    let only_root =
        cut(model, &Sight { planes: [glam::DVec4::W; 5], ..sight }, &Refine::default(), |i| (i == 0) as u32 as f32);
    let spacing = model.index.nodes[0].spacing;
    assert!(model.samples[0].iter().all(|(p, _)| only_root.radius_of(0, p.to_array()) == spacing));
    assert_eq!(only_root.counts.drawn, 1);
    // A coordinate that is no number ends somewhere.
    only_root.radius_of(0, [f32::NAN; 3]);
}

#[test]
fn degenerate_models_and_views_come_to_an_end() {
    let mut random = Random(15);
    for (name, points) in degenerate() {
        let model = Model::build(&points, 20);
        for _ in 0..50 {
            let sight = any_sight(&mut random);
            let cut = cut(&model, &sight, &Refine { back_faces_culled: true, fade: 1.25, ..Refine::default() }, all);
            let whole: u64 = model.index.nodes.iter().map(|n| n.samples as u64).sum();
            assert!(cut.counts.samples <= whole, "{name}");
            assert!(cut.counts.drawn > 0 || cut.steps.iter().all(|s| s.role != Role::Drawn), "{name}");
        }
        let sight = Sight { eye: random.vector().extend(1.0), ..any_sight(&mut random) };
        for factor in [1.0, f64::INFINITY] {
            let options = Refine { factor, prefetch: 0.5, ..Refine::default() };
            let some = cut(&model, &sight, &options, |i| (i == 0) as u32 as f32);
            assert!(some.wishes.iter().all(|w| !w.priority.is_nan()), "{name}");
            assert!(factor == 1.0 || some.counts.visited == 1 && some.wishes.is_empty(), "{name}");
        }
        let broken = Sight { eye: glam::DVec4::NAN, tau: f64::NAN, planes: [glam::DVec4::NAN; 5], radius_scale: 1.0 };
        assert!(cut(&model, &broken, &Refine::default(), all).counts.visited >= 1, "{name}");
    }
    let none = Model { index: Default::default(), samples: Vec::new() };
    assert_eq!(cut(&none, &any_sight(&mut random), &Refine::default(), all).counts, Default::default());
}

#[test]
fn wishes_come_in_the_order_of_their_priorities() {
    let mut random = Random(16);
    let model = &models()[0];
    let mut wished = 0;
    for _ in 0..200 {
        let there: Vec<bool> = (0..model.len()).map(|i| i == 0 || random.unit() < 0.6).collect();
        let options = Refine { prefetch: 0.5, ..Refine::default() };
        let sights: Vec<Sight> = (0..3).map(|_| any_sight(&mut random)).collect();
        let cuts: Vec<Cut> =
            sights.iter().map(|s| cut(model, s, &options, |i| there[i as usize] as u32 as f32)).collect();
        let ordered = wishes(&cuts);
        // The naive way: each time the best of all that is left.
        let mut left: Vec<Wish> = cuts.iter().flat_map(|c| c.wishes.clone()).collect();
        let mut naive: Vec<Wish> = Vec::new();
        while let Some(best) = left
            .iter()
            .copied()
            .reduce(|a, b| if b.priority > a.priority || b.priority == a.priority && b.node < a.node { b } else { a })
        {
            left.retain(|w| w.node != best.node);
            naive.push(best);
        }
        assert_eq!(ordered, naive);
        assert_eq!(wishes(cuts.iter().rev()), ordered, "whatever the order of views");
        for wish in &ordered {
            let node = &model.index.nodes[wish.node as usize];
            assert_eq!((wish.at, wish.bytes), (node.at, node.bytes));
            // By the definition: the largest of all views' pressures, weighted by at most 1 and at least ½ (2 below 0).
            let parent = &model.index.nodes[node.parent as usize];
            let most =
                sights.iter().map(|s| parent.spacing as f64 / (s.tau * s.distance_to_ball(parent.centre, parent.ball)));
            let most = most.fold(0.0, f64::max) - 1.0;
            assert!(wish.priority as f64 <= most.max(0.0) * 1.000001, "{wish:?}, {most}");
        }
        let (bytes, room) = (random.below(3000) as u64, Room { wanted: random.below(40) as u32, prefetch: 3 });
        let mut expected = 0;
        let mut sum = 0;
        for wish in &ordered {
            sum += wish.bytes as u64;
            let places = if wish.priority > 0.0 { room.wanted } else { room.prefetch };
            if sum > bytes && expected > 0 || expected >= places as usize {
                break;
            }
            expected += 1;
        }
        assert_eq!(affordable(&ordered, bytes, room), expected);
        wished += ordered.len();
    }
    assert!(wished > 1000, "{wished}");
}

#[test]
fn what_is_coarser_and_nearer_to_the_middle_comes_first() {
    let lens = surfel::select::View::perspective(1.0, 1.0, 0.01);
    let view = surfel::select::View { view: glam::DMat4::IDENTITY, projection: lens, depth: Default::default() };
    let sight = Sight::new(&view, [100, 100], &glam::DMat4::IDENTITY, glam::DVec3::ZERO, &Default::default());
    let at = |x: f32, y: f32| sight.centrality(Vec3::new(x, y, -10.0), 0.0);
    // The border is at 10 tan ½ = 5.46, a pixel of low-pass beyond.
    assert!((at(0.0, 0.0) - 1.0).abs() < 1e-12 && (at(5.57, 0.0) - 0.5).abs() < 1e-3 && at(50.0, 0.0) == 0.5);
    assert!(at(1.0, 0.0) > at(2.0, 0.0) && at(0.0, 3.0) < at(2.9, 0.0) && (at(2.0, 0.0) - at(-2.0, 0.0)).abs() < 1e-12);
    assert_eq!(sight.centrality(Vec3::new(3.0, 0.0, -10.0), 4.0), 1.0, "a ball that has the middle");
    assert_eq!(sight.centrality(Vec3::new(0.0, 0.0, 10.0), 1.0), 0.5, "behind the eye");
}
