//! Joining clouds, and their bounds.

use glam::{DVec3, Vec3, dvec3, vec3};
use proptest::prelude::*;
use surfel::load::synthetic::{scene, torus_mesh};
use surfel::load::{Bounds, Mesh, PointCloud, merge};

use crate::load_files::check_promises;

fn points(origin: DVec3, positions: &[Vec3]) -> PointCloud {
    PointCloud { origin, positions: positions.to_vec(), ..Default::default() }
}

#[test]
fn nothing_and_one_stay_what_they_are() {
    assert!(merge(vec![]).is_empty());
    let one = points(dvec3(7.0, 0.0, 0.1), &[Vec3::X]);
    assert_eq!(merge(vec![one.clone()]).world(0), one.world(0));
}

#[test]
fn world_positions_survive_and_missing_attributes_are_filled_and_noted() {
    let mut a = points(dvec3(515368.25, 4918340.5, 2322.0), &[vec3(0.5, 0.25, 1.0), vec3(-3.0, 2.0, 0.125)]);
    a.colors = Some(vec![[1, 2, 3], [4, 5, 6]]);
    a.radii = Some(vec![0.1, 0.2]);
    a.up = Some(Vec3::Z);
    a.angular_step = Some(0.01);
    let mut b = points(dvec3(515400.0, 4918300.0, 2330.0), &[vec3(0.5, -0.5, 0.75); 3]);
    b.normals = Some(vec![Vec3::Y; 3]);
    b.mesh = Some(Mesh { triangles: vec![[0, 1, 2]] });
    b.opacity = Some(vec![0.5; 3]);
    let told: Vec<DVec3> = (0..2).map(|i| a.world(i)).chain((0..3).map(|i| b.world(i))).collect();
    let all = merge(vec![a, b]);
    check_promises(&all);
    // All coordinates are multiples of 1/8 within 64 of the new origin, which is one of a coarser grid: exact.
    assert_eq!((0..5).map(|i| all.world(i)).collect::<Vec<_>>(), told);
    assert_eq!(all.colors.unwrap()[..2], [[1, 2, 3], [4, 5, 6]]);
    assert_eq!(all.normals.unwrap(), [Vec3::ZERO, Vec3::ZERO, Vec3::Y, Vec3::Y, Vec3::Y]);
    assert_eq!(all.opacity.unwrap(), [1.0, 1.0, 0.5, 0.5, 0.5]);
    assert_eq!(all.mesh.unwrap().triangles, [[2, 3, 4]]);
    assert_eq!((all.radii, all.up, all.angular_step), (None, Some(Vec3::Z), Some(0.01)));
    assert_eq!(all.report.assumed.len(), 4, "{:?}", all.report.assumed);
}

#[test]
fn angular_steps_that_differ_are_none() {
    let with = |step| PointCloud { angular_step: Some(step), ..points(DVec3::ZERO, &[Vec3::X]) };
    assert_eq!(merge(vec![with(0.01), with(0.01)]).angular_step, Some(0.01));
    let all = merge(vec![with(0.01), with(0.02)]);
    assert_eq!((all.angular_step, all.report.assumed.len()), (None, 1));
}

#[test]
fn the_same_origin_leaves_every_bit() {
    let (a, b) = (scene("sphere", 100, 0).unwrap(), torus_mesh(5, 4));
    let expected: Vec<Vec3> = a.positions.iter().chain(&b.positions).copied().collect();
    let all = merge(vec![a, b]);
    assert_eq!((all.positions, all.origin, all.closed), (expected, DVec3::ZERO, true));
}

proptest! {
    /// Against sorting everything.
    #[test]
    fn bounds_agree_with_a_sort(
        values in prop::collection::vec(prop::array::uniform3(-1e3..1e3f32), 1..5000), origin in prop::array::uniform3(-1e6..1e6f64),
    ) {
        let cloud = points(DVec3::from_array(origin), &values.iter().map(|v| Vec3::from_array(*v)).collect::<Vec<_>>());
        let b = Bounds::of(&cloud).unwrap();
        let skip = (values.len() - 1) / 1000;
        for axis in 0..3 {
            let mut sorted: Vec<f64> = values.iter().map(|v| cloud.origin[axis] + f64::from(v[axis])).collect();
            sorted.sort_by(f64::total_cmp);
            let last = sorted.len() - 1;
            prop_assert_eq!([b.min[axis], b.max[axis]], [sorted[0], sorted[last]]);
            prop_assert_eq!([b.robust_min[axis], b.robust_max[axis]], [sorted[skip], sorted[last - skip]]);
        }
        prop_assert_eq!(b.radius, 0.5 * (b.robust_max - b.robust_min).length());
    }
}

#[test]
fn stray_points_do_not_move_the_robust_box() {
    let mut cloud = scene("noise", 10_000, 1).unwrap();
    cloud.positions.extend([Vec3::splat(1e30), Vec3::splat(-1e20)]);
    let b = Bounds::of(&cloud).unwrap();
    assert!(b.robust_min.min_element() >= 0.0 && b.robust_max.max_element() <= 1.0 && b.radius > 0.8);
    assert_eq!((b.max, b.min.x), (Vec3::splat(1e30).as_dvec3(), f64::from(-1e20f32)));
    assert_eq!(Bounds::of(&PointCloud::default()), None);
}
