//! Splats of more and more samples come nearer to the mesh that they were taken from.

use glam::{DMat4, DVec3, dvec3};
use surfel::load::attributes::{self, Options};
use surfel::load::{PointCloud, sample_mesh};
use surfel::measure::{Image, Interior, compare};
use surfel::reference::{self, Instance, MeshInstance, MeshScene, Picture, Scene, Surface};
use surfel::select::{DrawList, View};
use surfel::structure::Flat;
use surfel::style::Style;
use surfel::technique::Technique;

const SIDE: u32 = 320;

fn image(picture: &Picture, view: &View) -> Image {
    let mut image = Image::from_linear(SIDE, SIDE, &picture.rgba, [0x1d, 0x1f, 0x23]);
    image.depth = Some(picture.depth.clone());
    image.pixel = Some(1.0 / view.focal(SIDE as f64));
    image
}

fn interior(cloud: &PointCloud, samples: usize, view: &View, truth: &Image) -> Interior {
    let mut sampled = sample_mesh(cloud, samples, 1);
    attributes::complete(&mut sampled, &Options::default());
    let flat = Flat::new(&sampled);
    let scene = Scene {
        instances: &[Instance::points(&flat, DMat4::IDENTITY)],
        list: &DrawList::all([samples as u32]),
        view,
        width: SIDE,
        height: SIDE,
        technique: Technique::TWO_PASS,
        style: &Style::default(),
        host_depth: None,
    };
    let picture = reference::render(&scene, 0.0);
    compare(truth, &image(&picture, view), 0.0).unwrap().interior.unwrap()
}

/// Weights smooth a surface of curvature c over the radius r, which moves its normals by some c² r² and its points by
/// c r²: with four times the points r halves, and the error, where it is smooth, falls to a quarter; where creases are
/// sharper than r, to one half. Half is what is asked. With 12,500 the radii still resolve the dragon's folds; with
/// 200,000 they are 1.4 px, and below one the low-pass takes over and the error nears its floor.
#[test]
fn with_data_four_times_the_samples_halve_the_error() {
    let mut cloud = surfel::load::open(&crate::common::data("stanford_dragon.ply"), &Default::default()).unwrap();
    attributes::complete(&mut cloud, &Options::default());
    let bounds = surfel::load::Bounds::of(&cloud).unwrap();
    let eye = bounds.center + bounds.radius * dvec3(0.9, 0.6, 2.2);
    let projection = View::perspective(45f64.to_radians(), 1.0, 1e-3 * bounds.radius);
    let view = View::look_at(eye, bounds.center, DVec3::Y, projection, Default::default());
    let surface = Surface::new(&cloud).unwrap();
    let mesh = MeshInstance { surface: &surface, transform: DMat4::IDENTITY };
    let scene = MeshScene { instances: &[mesh], view: &view, width: SIDE, height: SIDE, style: &Style::default() };
    let truth = image(&reference::ray_cast(&scene, 4), &view);
    let found = [12_500, 50_000, 200_000].map(|n| interior(&cloud, n, &view, &truth));
    for pair in found.windows(2) {
        let (before, after) = (pair[0].rmse.unwrap(), pair[1].rmse.unwrap());
        assert!(pair[1].pixels > 10_000 && after <= 0.5 * before, "{before} to {after}: {found:?}");
    }
}
