//! Layered point clouds whose patches come gradually: nothing jumps along a camera's path.

use std::collections::BTreeMap;

use glam::{DMat4, DVec3, DVec4, Vec3, dvec3};
use surfel::select::layered::{Cut, Refine, rank, refine, shown};
use surfel::select::{Sight, View};
use surfel::style::Style;

use crate::layered_common::{Model, Random, any_sight, surface};

const FADE: f64 = 1.25;

/// Without borders, so that what changes is refinement.
fn sight(eye: DVec3) -> Sight {
    let lens = View::perspective(1.0, 1.0, 1e-3);
    let view = View::look_at(eye, DVec3::ZERO, DVec3::Z, lens, Default::default());
    let style = Style { threshold: 40.0, ..Style::default() };
    Sight { planes: [DVec4::W; 5], ..Sight::new(&view, [400, 400], &DMat4::IDENTITY, DVec3::ZERO, &style) }
}

fn cut(model: &Model, sight: &Sight, fade: f64, presence: impl Fn(u32) -> f32) -> Cut {
    let mut cut = Cut::default();
    refine(&model.index, sight, &Refine { fade, ..Refine::default() }, presence, &mut cut);
    cut
}

/// By how much a child's share can change at most while the eye moves by `step`.
///
/// The share is (x − 1) / (k − 1) of its parent's ratio x = s / (τ d), within 1 < x < k. There |dx / dd| = x / d < k / d and d > s /
/// (τ k), so that it changes by less than k² τ / (s (k − 1)) a unit of the way. The least of it and the shares above is no steeper
/// than the steepest, which has the least spacing: this one.
fn most(model: &Model, tau: f64, node: u32, step: f64) -> f64 {
    let parent = &model.index.nodes[model.index.nodes[node as usize].parent as usize];
    (step * FADE * FADE * tau / (parent.spacing as f64 * (FADE - 1.0))).min(1.0)
}

fn limits(cut: &Cut) -> BTreeMap<u32, u32> {
    cut.steps.iter().map(|step| (step.node, step.limit)).collect()
}

#[test]
fn the_number_of_samples_changes_by_less_than_a_bound_a_step() {
    let model = Model::build(&surface(5000, 1), 128);
    let step = 1e-3;
    let along = |i: usize| sight(dvec3(5.0 - step * i as f64, 0.3, 0.2));
    let path = |fade: f64| -> Vec<Cut> { (0..3500).map(|i| cut(&model, &along(i), fade, |_| 1.0)).collect() };
    let (faded, at_once) = (path(FADE), path(1.0));
    let (mut jumps, mut partly) = (0, 0);
    for i in 1..faded.len() {
        let (before, after) = (limits(&faded[i - 1]), limits(&faded[i]));
        let mut bound = 0.0;
        for node in before.keys().chain(after.keys().filter(|n| !before.contains_key(n))) {
            if before.get(node) != after.get(node) {
                // Each of the two counts is so far off the share.
                let samples = model.index.nodes[*node as usize].samples as f64;
                bound += samples * most(&model, along(i).tau, *node, step) + 2.0 * (samples.log2() + 2.0);
            }
        }
        let samples = |cuts: &[Cut]| cuts[i].counts.samples.abs_diff(cuts[i - 1].counts.samples) as f64;
        assert!(samples(&faded) <= bound, "step {i}: {} > {bound}", samples(&faded));
        jumps += usize::from(samples(&at_once) > bound);
        partly += after.values().filter(|limit| **limit < u32::MAX).count();
        // Fading only leaves out.
        assert!(faded[i].counts.samples <= at_once[i].counts.samples);
        let nodes = |cut: &Cut| cut.steps.iter().map(|s| s.node).collect::<Vec<_>>();
        assert_eq!(nodes(&faded[i]), nodes(&at_once[i]));
    }
    assert!(jumps > 10 && partly > 500, "{jumps}, {partly}");
}

#[test]
fn radii_change_by_less_than_a_bound_a_step() {
    let model = Model::build(&surface(1500, 2), 32);
    let step = 1e-3;
    let along = |i: usize| sight(dvec3(5.0 - step * i as f64, 0.3, 0.2));
    let samples: Vec<Vec3> = model.samples[0].iter().map(|(p, _)| *p).collect();
    let coarsest = model.index.nodes[0].spacing as f64;
    let jumps = |fade: f64, check: bool| {
        let mut last: Option<Cut> = None;
        let mut jumps = 0;
        for i in 0..3500 {
            let sight = along(i);
            let cut = cut(&model, &sight, fade, |_| 1.0);
            for &p in &samples {
                let r = |cut: &Cut| cut.radius_of(0, p.to_array()) as f64;
                let change = last.as_ref().map_or(0.0, |last| (r(&cut) - r(last)).abs());
                if change == 0.0 {
                    continue;
                }
                // A radius moves at most from the root's spacing to 0 while one share on its path goes from 0 to 1.
                let (mut bound, mut node) = (1e-6 * coarsest, 0);
                while let Some(below) = model.below(node, p) {
                    bound += coarsest * most(&model, sight.tau, below, step);
                    node = below;
                }
                jumps += usize::from(change > bound);
                assert!(!check || change <= bound, "step {i}: {change} > {bound}");
            }
            last = Some(cut);
        }
        jumps
    };
    assert!(jumps(FADE, true) == 0 && jumps(1.0, false) > 5, "{}", jumps(1.0, false));
}

#[test]
fn what_arrived_a_moment_ago_is_drawn_in_part() {
    let model = Model::build(&surface(3000, 1), 32);
    let sight = sight(dvec3(1.5, 0.0, 0.0));
    let whole = cut(&model, &sight, 1.0, |_| 1.0);
    let child = model.index.nodes[0].children[0];
    for presence in [0.25, 0.5, 0.75] {
        let part = cut(&model, &sight, 1.0, |node| if node == child { presence } else { 1.0 });
        let step = &part.steps[part.step_of(child).unwrap()];
        let (above, own) = (model.index.nodes[0].spacing, model.index.nodes[child as usize].spacing);
        assert_eq!(step.radius, above + presence * (own - above));
        let samples = model.index.nodes[child as usize].samples;
        let counted = (0..samples).filter(|i| rank(child, *i) <= step.limit).count() as u32;
        assert_eq!(counted, shown(child, samples, step.limit));
        assert!(counted.abs_diff((presence * samples as f32) as u32) <= 1, "{counted} of {samples}");
        // Nothing below it is there in a larger share.
        assert!(part.counts.samples < whole.counts.samples);
        for step in &part.steps {
            let parent = part.step_of(model.index.nodes[step.node as usize].parent);
            assert!(parent.is_none_or(|parent| step.limit <= part.steps[parent].limit));
        }
    }
}

#[test]
fn shares_only_grow_towards_the_viewer() {
    let model = Model::build(&surface(3000, 1), 32);
    let mut random = Random(20);
    let mut some = 0;
    for _ in 0..300 {
        let sight = Sight { planes: [DVec4::W; 5], ..any_sight(&mut random) };
        let coarse = limits(&cut(&model, &sight, FADE, |_| 1.0));
        let fine = limits(&cut(&model, &Sight { tau: 0.9 * sight.tau, ..sight.clone() }, FADE, |_| 1.0));
        assert!(coarse.iter().all(|(node, limit)| fine[node] >= *limit));
        some += coarse.values().filter(|limit| **limit < u32::MAX).count();
    }
    assert!(some > 100, "{some}");
}
