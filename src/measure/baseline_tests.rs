use super::*;

#[test]
fn the_exact_distribution_of_seven_samples() {
    // The median of a resample of 1 … 7 is at most k with the probability that four or more of seven draws are: 1.0 % for
    // 1, 10.8 % for 2, 89.2 % for 5, 99.0 % for 6. So the 2.5 % quantile is 2, the 97.5 % quantile 6; each probability is
    // ten standard errors (0.15 % of 10,000 draws at 2.5 %) from its quantile.
    let r = ratio(&[2.0; 5], &[3.0, 1.0, 2.0, 7.0, 6.0, 5.0, 4.0]).unwrap();
    assert_eq!(r, Ratio { ratio: 2.0, low: 1.0, high: 3.0 });
    // The other way round: 2 by 6 and 2 by 2.
    let r = ratio(&[3.0, 1.0, 2.0, 7.0, 6.0, 5.0, 4.0], &[2.0; 5]).unwrap();
    assert_eq!(r, Ratio { ratio: 0.5, low: 2.0 / 6.0, high: 1.0 });
}

#[test]
fn constants_have_no_spread() {
    let r = ratio(&[4.0; 9], &[5.0; 6]).unwrap();
    assert_eq!((r, r.verdict()), (Ratio { ratio: 1.25, low: 1.25, high: 1.25 }, Verdict::Slower));
    assert_eq!(ratio(&[5.0; 6], &[4.0; 9]).unwrap().verdict(), Verdict::Faster);
    assert_eq!(ratio(&[5.0; 6], &[5.0; 9]).unwrap().verdict(), Verdict::NoDifference);
}

#[test]
fn scale_and_order_do_not_matter() {
    let old = [1.0, 1.1, 0.9, 1.3, 1.05, 0.97];
    let new = [1.2, 1.0, 1.15, 0.8, 1.3];
    let first = ratio(&old, &new).unwrap();
    assert_eq!(ratio(&old, &[1.3, 0.8, 1.15, 1.0, 1.2]), Some(first), "in another order");
    let twice = ratio(&old, &new.map(|v| 2.0 * v)).unwrap();
    assert_eq!([twice.ratio, twice.low, twice.high], [first.ratio, first.low, first.high].map(|v| 2.0 * v));
    assert!(first.low <= first.ratio && first.ratio <= first.high);
}

#[test]
fn too_little_says_nothing() {
    assert_eq!(ratio(&[1.0; 4], &[1.0; 9]), None);
    assert_eq!(ratio(&[1.0; 9], &[]), None);
    assert_eq!(ratio(&[1.0; 5], &[1.0, 1.0, 1.0, 1.0, 0.0]), None);
    assert_eq!(ratio(&[1.0, 1.0, f64::NAN, 1.0, 1.0], &[1.0; 5]), None);
    assert_eq!(ratio(&[1.0; 5], &[1.0, 1.0, f64::INFINITY, 1.0, 1.0]), None);
}

/// How many of 200 pairs of nine samples each, the second `factor` times the first, are called different.
fn called_different(factor: f64) -> u32 {
    let mut rng = Rng::new(7);
    let mut nine = |factor: f64| -> Vec<f64> {
        // As timings are: a floor, and a tail above it (exponential, mean 10 %).
        (0..9).map(|_| factor * (1.0 - 0.1 * (1.0 - rng.unit()).ln())).collect()
    };
    (0..200).filter(|_| ratio(&nine(1.0), &nine(factor)).unwrap().verdict() != Verdict::NoDifference).count() as u32
}

#[test]
fn what_did_not_change_is_seldom_called_different() {
    // Nominally 10 of 200, standard deviation 3.1; of nine samples the interval is rather wider.
    let different = called_different(1.0);
    assert!(different <= 25, "{different}");
}

#[test]
fn what_changed_is_called_different() {
    // The medians' standard error is 0.1 / √9 each, so 0.047 for the ratio: 1.5 is ten of them away.
    assert!(called_different(1.5) >= 198);
}

#[test]
fn cases_come_and_go() {
    let s = |name: &str, values: &[f64]| Samples { name: name.into(), values: values.to_vec() };
    let old = [s("a", &[2.0; 5]), s("gone", &[1.0; 5]), s("lacking", &[]), s("stopped", &[1.0; 5]), s("few", &[1.0])];
    let new = [s("new", &[1.0; 5]), s("a", &[1.0; 5]), s("lacking", &[1.0; 5]), s("stopped", &[]), s("few", &[1.0])];
    let half = Ratio { ratio: 0.5, low: 0.5, high: 0.5 };
    let expected = [
        ("new", Change::New),
        ("a", Change::Both(Some(half))),
        ("lacking", Change::New),
        ("few", Change::Both(None)),
        ("gone", Change::Missing),
        ("stopped", Change::Missing),
    ];
    assert_eq!(changes(&old, &new), expected.map(|(name, change)| (name.to_string(), change)));
}
