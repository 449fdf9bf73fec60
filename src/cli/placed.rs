//! What framing needs of clouds that are drawn in many places: a sample stands for millions of points.

use anyhow::{Result, bail};
use glam::{DMat4, DVec3};

use surfel::load::{Bounds, PointCloud};

use super::input::Ball;
use super::scene_file::Placed;

/// Points that the robust box is taken from, and splats that frame a picture.
const BOUNDED_BY: u64 = 1 << 20;
const FRAMED_BY: u64 = 30_000;

/// Every cloud once, where it is.
pub fn as_read(clouds: usize) -> Vec<Placed> {
    (0..clouds).map(|cloud| Placed { cloud, transform: DMat4::IDENTITY }).collect()
}

/// Whether anything is drawn elsewhere than where it is, or not once.
pub fn moved(instances: &[Placed], clouds: usize) -> bool {
    instances.len() != clouds
        || instances.iter().enumerate().any(|(i, p)| p.cloud != i || p.transform != DMat4::IDENTITY)
}

/// All points of all instances.
fn points(clouds: &[PointCloud], instances: &[Placed]) -> u64 {
    instances.iter().map(|p| clouds[p.cloud].len() as u64).sum()
}

/// Refuses what draw lists and counters of 32 bits cannot hold.
pub fn countable(clouds: &[PointCloud], instances: &[Placed]) -> Result<()> {
    match points(clouds, instances) {
        n if n > u32::MAX as u64 => bail!("{n} points in all instances: at most {} are handled", u32::MAX),
        _ => Ok(()),
    }
}

/// Calls `take` with about `wanted` points, one from each of as many runs of equal length through all instances; with all
/// where there are no more. The place in a run follows the golden ratio: a fixed one could be the same point of each cloud.
fn sample(clouds: &[PointCloud], instances: &[Placed], wanted: u64, mut take: impl FnMut(&Placed, usize)) {
    let step = points(clouds, instances).div_ceil(wanted).max(1);
    let place = |run: u64| run * step + ((run as f64 * 0.618_033_988_749_894_9).fract() * step as f64) as u64;
    let (mut run, mut before) = (0, 0);
    for instance in instances {
        let after = before + clouds[instance.cloud].len() as u64;
        while place(run) < after {
            take(instance, (place(run) - before) as usize);
            run += 1;
        }
        before = after;
    }
}

/// Bounds of all instances; there is a point. The exact box holds every point, and more where boxes are turned.
pub fn bounds(clouds: &[PointCloud], instances: &[Placed]) -> Bounds {
    let boxes: Vec<Option<Bounds>> = clouds.iter().map(Bounds::of).collect();
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in instances {
        let Some(b) = &boxes[p.cloud] else { continue };
        for i in 0..8 {
            let corner = DVec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), b.max, b.min);
            let corner = p.transform.transform_point3(corner);
            (min, max) = (min.min(corner), max.max(corner));
        }
    }
    let mut axes = [const { Vec::new() }; 3];
    sample(clouds, instances, BOUNDED_BY, |p, i| {
        let point = p.transform.transform_point3(clouds[p.cloud].world(i));
        axes.iter_mut().zip(point.to_array()).for_each(|(axis, v)| axis.push(v));
    });
    // As `Bounds::of` has it: the 0.1 and 99.9 percentiles.
    let mut ends = |low: bool| {
        DVec3::from_array(axes.each_mut().map(|axis| {
            let last = axis.len() - 1;
            let skip = last / 1000;
            *axis.select_nth_unstable_by(if low { skip } else { last - skip }, f64::total_cmp).1
        }))
    };
    let (robust_min, robust_max) = (ends(true), ends(false));
    let half = 0.5 * (robust_max - robust_min);
    Bounds { min, max, robust_min, robust_max, center: robust_min + half, radius: half.length() }
}

/// Some ten thousand splats inside the robust box.
pub fn balls(clouds: &[PointCloud], instances: &[Placed], bounds: &Bounds) -> Vec<Ball> {
    let mut balls = Vec::new();
    sample(clouds, instances, FRAMED_BY, |p, i| {
        let cloud = &clouds[p.cloud];
        let point = p.transform.transform_point3(cloud.world(i));
        if point.cmpge(bounds.robust_min).all() && point.cmple(bounds.robust_max).all() {
            let scale = p.transform.x_axis.truncate().length();
            balls.push((point, cloud.radii.as_ref().map_or(0.0, |r| r[i] as f64 * scale)));
        }
    });
    balls
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn at(place: DVec3, scale: f64) -> Placed {
        Placed { cloud: 0, transform: DMat4::from_translation(place) * DMat4::from_scale(DVec3::splat(scale)) }
    }

    #[test]
    fn bounds_and_balls_are_of_what_is_drawn() {
        let positions: Vec<Vec3> = (0..11).map(|i| Vec3::new(i as f32, 0.0, 1.0)).collect();
        let cloud = PointCloud { radii: Some(vec![0.5; 11]), positions, ..Default::default() };
        let clouds = [cloud];
        assert!(!moved(&[at(DVec3::ZERO, 1.0)], 1) && moved(&[at(DVec3::X, 1.0)], 1));
        assert!(moved(&[at(DVec3::ZERO, 1.0); 2], 1));
        let instances = [at(DVec3::ZERO, 1.0), at(DVec3::new(100.0, 5.0, 0.0), 2.0)];
        let b = bounds(&clouds, &instances);
        assert_eq!((b.min, b.max), (DVec3::new(0.0, 0.0, 1.0), DVec3::new(120.0, 5.0, 2.0)));
        assert_eq!((b.robust_min, b.robust_max), (b.min, b.max));
        let balls = balls(&clouds, &instances, &b);
        assert_eq!((balls.len(), balls[0].1, balls[21]), (22, 0.5, (DVec3::new(120.0, 5.0, 2.0), 1.0)));
    }

    #[test]
    fn many_instances_are_sampled_evenly() {
        let positions: Vec<Vec3> = (0..1000).map(|i| Vec3::splat(i as f32)).collect();
        let clouds = [PointCloud { positions, ..Default::default() }];
        let instances: Vec<Placed> = (0..10_000).map(|i| at(DVec3::X * (1e4 * i as f64), 1.0)).collect();
        assert!(countable(&clouds, &instances).is_ok());
        let b = bounds(&clouds, &instances);
        // All places in a cloud are met, and all places of clouds.
        assert!(b.robust_max.y > 995.0 && b.robust_min.y < 5.0, "{b:?}");
        assert!((b.radius - 0.998 * 5e7).abs() < 1e6, "{b:?}");
        let framed = balls(&clouds, &instances, &b).len();
        assert!((25_000..=30_000).contains(&framed), "{framed}");
        let many = vec![at(DVec3::ZERO, 1.0); 5_000_000];
        assert!(countable(&clouds, &many).is_err());
    }
}
