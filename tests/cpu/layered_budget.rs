//! Thresholds for a number of samples, of patches, and for a time.

use std::collections::BTreeSet;

use surfel::select::Sight;
use surfel::select::layered::{Cut, Limit, Refine, TimeBudget, factor_for, factor_visible, refine_visible};

use crate::layered_common::{Model, Random, any_sight, degenerate, surface, with_strays};

/// Samples over all views, and patches of all together, those too that are hidden.
fn counts(model: &Model, sights: &[Sight], options: &Refine, hidden: impl Fn(usize, u32) -> bool) -> (u64, u64) {
    let (mut samples, mut patches) = (0, BTreeSet::new());
    for (view, sight) in sights.iter().enumerate() {
        let mut cut = Cut::default();
        refine_visible(&model.index, sight, options, |_| 1.0, |node| hidden(view, node), &mut cut);
        let shown: Vec<u32> = cut.steps.iter().filter(|step| step.role.is_shown()).map(|step| step.node).collect();
        samples += shown.iter().map(|node| u64::from(model.index.nodes[*node as usize].samples)).sum::<u64>();
        patches.extend(shown);
    }
    (samples, patches.len() as u64)
}

#[test]
fn the_factor_is_the_least_that_keeps_to_the_limit() {
    let mut random = Random(40);
    let (mut inner, mut least) = (0, 0);
    for model in [Model::build(&surface(3000, 1), 32), Model::build(&with_strays(1500, 2), 8)] {
        for _ in 0..400 {
            let sights: Vec<Sight> = (0..1 + random.below(3)).map(|_| any_sight(&mut random)).collect();
            let options = Refine { back_faces_culled: random.below(2) == 1, ..Refine::default() };
            let finest = [0.0, 1.0][random.below(2)];
            let most = 1 + random.below(2000) as u64;
            let limit = if random.below(2) == 1 { Limit::Samples(most) } else { Limit::Patches(most as u32 / 20) };
            // Half of the time nothing is hidden, else one node of five, others in each view.
            let salt = random.below(2) * (1 + random.below(1000));
            let hidden = |view: usize, node: u32| salt > 0 && (node as usize * 31 + view * 17 + salt).is_multiple_of(5);
            let factor = match salt {
                0 => factor_for(&model.index, &sights, &options, limit, finest),
                _ => factor_visible(&model.index, &sights, &options, hidden, limit, finest),
            };
            let count = |factor: f64| {
                let (samples, patches) = counts(&model, &sights, &Refine { factor, ..options }, hidden);
                match limit {
                    Limit::Samples(most) => (samples, most),
                    Limit::Patches(most) => (patches, most as u64),
                }
            };
            if factor == finest {
                let (there, most) = count(finest.max(f64::MIN_POSITIVE));
                // Hidden roots are not refined at any factor.
                assert!(there <= most || there == count(f64::INFINITY).0, "{there} of {most}");
                least += 1;
            } else if factor.is_finite() {
                let (there, most) = count(factor);
                let roots = count(f64::INFINITY).0;
                assert!(there <= most.max(roots), "{there} of {most}");
                // Any smaller one is too small.
                let (more, _) = count(factor * (1.0 - 1e-12));
                assert!(more > most, "{more} of {most} below {factor}");
                // And the search that the paper has comes to the same.
                let (mut low, mut high) = (factor / 8.0, factor * 8.0);
                for _ in 0..60 {
                    let middle = (low * high).sqrt();
                    if count(middle).0 <= most.max(roots) { high = middle } else { low = middle }
                }
                assert!((high / factor - 1.0).abs() < 1e-9 || there == roots, "{high}, {factor}");
                inner += 1;
            } else {
                assert_eq!(count(f64::INFINITY).0, count(factor).0);
            }
        }
    }
    assert!(inner > 200 && least > 50, "{inner}, {least}");
}

#[test]
fn degenerate_models_have_a_factor() {
    let mut random = Random(41);
    for (name, points) in degenerate() {
        let model = Model::build(&points, 20);
        for _ in 0..20 {
            let factor =
                factor_for(&model.index, &[any_sight(&mut random)], &Refine::default(), Limit::Samples(50), 1.0);
            assert!(factor >= 1.0, "{name}: {factor}");
        }
        assert_eq!(factor_for(&model.index, &[], &Refine::default(), Limit::Samples(0), 1.0), 1.0, "{name}");
    }
    assert_eq!(factor_for(&Default::default(), &[], &Refine::default(), Limit::Samples(0), 1.0), 1.0);
}

/// A device that takes `fixed` + n / `rate` seconds, give or take `noise`, and now and then ten times as long.
struct Device {
    fixed: f64,
    rate: f64,
    noise: f64,
    random: Random,
}

impl Device {
    fn exact(&self, samples: u64) -> f64 {
        self.fixed + samples as f64 / self.rate
    }

    fn takes(&mut self, samples: u64, frame: usize) -> f64 {
        let factor = 1.0 + self.noise * (2.0 * self.random.unit() - 1.0);
        // Two in a row of any nine.
        let hiccup = if frame % 9 < 2 { 10.0 } else { 1.0 };
        self.exact(samples) * factor * hiccup
    }
}

#[test]
fn frames_come_to_last_as_long_as_they_should() {
    let aim = 0.016;
    for (fixed, rate, noise) in [(0.0, 5e6, 0.0), (0.0, 5e6, 0.1), (0.004, 60e6, 0.05), (0.008, 1e9, 0.2)] {
        for first in [1, 100_000, 1_000_000_000] {
            let mut device = Device { fixed, rate, noise, random: Random(42) };
            let mut budget = TimeBudget::new(aim, first);
            let (mut drawn, mut since) = (VecDelay::new(2), 0);
            for frame in 0..700 {
                // Twice the speed from then on.
                if frame == 350 {
                    device.rate *= 2.0;
                    since = 0;
                }
                let samples = budget.samples();
                // What is measured now was drawn some frames ago.
                if let Some((n, seconds)) = drawn.push((samples, device.takes(samples, frame))) {
                    budget.measured(n, seconds);
                }
                since += 1;
                // From 1 sample up to 8 million is 23 doublings, and with a = T / 2 each takes the median's five frames and the
                // two of delay.
                if since > 250 {
                    let exact = device.exact(samples);
                    let (low, high) = (aim / (1.0 + noise), aim / (1.0 - noise));
                    assert!(low * 0.999 <= exact && exact <= high * 1.001, "frame {frame}: {exact} s of {aim}");
                }
            }
        }
    }
}

/// A queue of a fixed length.
struct VecDelay(Vec<(u64, f64)>, usize);

impl VecDelay {
    fn new(length: usize) -> VecDelay {
        VecDelay(Vec::new(), length)
    }

    fn push(&mut self, item: (u64, f64)) -> Option<(u64, f64)> {
        self.0.push(item);
        (self.0.len() > self.1).then(|| self.0.remove(0))
    }
}

#[test]
fn what_is_no_measurement_changes_nothing() {
    let mut budget = TimeBudget::new(0.01, 1000);
    for (samples, seconds) in [(0, 1.0), (10, 0.0), (10, f64::NAN), (10, f64::INFINITY), (10, -1.0)] {
        budget.measured(samples, seconds);
        assert_eq!(budget.samples(), 1000);
    }
    (0..20).for_each(|_| budget.measured(1, 1e3));
    assert_eq!(budget.samples(), 1, "at least one");
}
