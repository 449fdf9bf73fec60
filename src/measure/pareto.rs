//! Which of several ways are worth taking: nothing else is both cheaper and better.

/// Indices of the points (cost, error) that no other point beats, by growing cost. A point is beaten by one that is no
/// worse in both and better in one; of equal points the first stays. Points that are not finite are left out.
pub fn pareto(points: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> =
        (0..points.len()).filter(|&i| points[i].0.is_finite() && points[i].1.is_finite()).collect();
    order.sort_by(|&a, &b| {
        let (a, b) = (points[a], points[b]);
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    let mut best = f64::INFINITY;
    order.retain(|&i| {
        let keep = points[i].1 < best;
        best = best.min(points[i].1);
        keep
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_nothing_beats() {
        let points = [
            (3.0, 1.0),
            (1.0, 5.0),
            (2.0, 5.0),
            (2.0, 2.0),
            (2.0, 2.0),
            (4.0, 1.0),
            (f64::NAN, 0.0),
            (0.5, f64::INFINITY),
        ];
        assert_eq!(pareto(&points), [1, 3, 0]);
        assert_eq!(pareto(&[]), [] as [usize; 0]);
        // Equal cost: the better one alone.
        assert_eq!(pareto(&[(1.0, 2.0), (1.0, 1.0)]), [1]);
    }

    #[test]
    fn every_other_point_is_beaten_by_one_of_the_front() {
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 56) as f64
        };
        let points: Vec<(f64, f64)> = (0..200).map(|_| (next(), next())).collect();
        let front = pareto(&points);
        for (i, p) in points.iter().enumerate() {
            let beaten = |q: &(f64, f64)| q.0 <= p.0 && q.1 <= p.1 && q != p;
            assert!(front.contains(&i) || front.iter().any(|&j| beaten(&points[j]) || points[j] == *p));
            assert!(!front.contains(&i) || !points.iter().any(beaten), "{p:?} is beaten");
        }
    }
}
