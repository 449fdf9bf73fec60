//! The supersampled picture against one that is rendered whole and filtered by hand.

use surfel::reference::{Picture, Scene, render, supersampled};
use surfel::style::{EyeDome, Footprint, Style};

use crate::reference_common::{RED, Small, WHITE, Z, at, depth_at};
use crate::reference_oracle::every_scene;

/// Renders `factor` times as large and filters: mean of the light, and the depth below which as many covered samples
/// lie as above, or one fewer.
fn by_hand(scene: &Scene, factor: u32) -> Picture {
    let (width, height) = (scene.width * factor, scene.height * factor);
    let host: Option<Vec<f32>> = scene.host_depth.map(|depth| {
        (0..width * height).map(|i| depth[(i / width / factor * scene.width + i % width / factor) as usize]).collect()
    });
    let footprint = match scene.style.footprint {
        Footprint::Pixels(side) => Footprint::Pixels(side * factor as f32),
        splat => splat,
    };
    let style = Style { footprint, ..*scene.style };
    let fine = render(&Scene { width, height, style: &style, host_depth: host.as_deref(), ..*scene }, 0.0);
    let mut picture = Picture { width: scene.width, height: scene.height, rgba: vec![], depth: vec![], ..fine };
    for (y, x) in (0..scene.height).flat_map(|y| (0..scene.width).map(move |x| (y, x))) {
        let samples: Vec<usize> = (0..factor * factor)
            .map(|s| ((y * factor + s / factor) * width + x * factor + s % factor) as usize)
            .collect();
        let mean = |channel: usize| samples.iter().map(|&s| fine.rgba[s][channel]).sum::<f64>() / samples.len() as f64;
        picture.rgba.push([0, 1, 2, 3].map(mean));
        let mut depths: Vec<f64> = samples.iter().map(|&s| fine.depth[s]).filter(|z| z.is_finite()).collect();
        depths.sort_by(f64::total_cmp);
        picture.depth.push(depths.get(depths.len().saturating_sub(1) / 2).copied().unwrap_or(f64::INFINITY));
    }
    picture
}

#[test]
fn folding_tiles_is_filtering_the_whole_picture() {
    for factor in [2, 8] {
        every_scene(40, 4 + factor as u64, |scene, name| {
            let (folded, whole) = (supersampled(scene, factor), by_hand(scene, factor));
            let (mut covered, mut partly) = (0, 0);
            for i in 0..whole.rgba.len() {
                // 64 values of at most 1, summed in another order: 64 · 2⁻⁵³ · 64 / 64 < 10⁻¹⁴.
                let off = (0..4).map(|c| (folded.rgba[i][c] - whole.rgba[i][c]).abs()).fold(0.0, f64::max);
                assert!(off < 1e-14, "{name}, × {factor}, pixel {i}: {:?} {:?}", folded.rgba[i], whole.rgba[i]);
                assert_eq!(folded.depth[i], whole.depth[i], "{name}, × {factor}, pixel {i}");
                covered += (whole.rgba[i][3] > 0.0) as u32;
                partly += (whole.rgba[i][3] > 0.0 && whole.rgba[i][3] < 1.0) as u32;
            }
            assert!(covered > 50 && partly > 0, "{name}: {covered} pixels covered, {partly} in part");
            assert_eq!(folded.counts, whole.counts, "{name}");
            assert_eq!((folded.width, folded.height), (scene.width, scene.height));
            assert!(folded.ties.len() == folded.rgba.len() && folded.ties.iter().all(|t| !t));
        });
    }
}

#[test]
fn one_sample_a_pixel_is_the_picture_itself() {
    every_scene(40, 7, |scene, name| assert!(supersampled(scene, 1) == render(scene, 0.0), "{name}"));
}

/// Opaque squares of three pixels' sides about a pixel's corner: a quarter of a pixel is known.
#[test]
fn squares_keep_their_size_and_edges_their_share() {
    let scene = Small::flat_view()
        .opaque()
        .splat([0.25, 0.25, 0.0], Z, 1.0, WHITE)
        .style(|s| s.footprint = Footprint::Pixels(3.0));
    let picture = scene.with(|scene| supersampled(scene, 4));
    // Over x from 2.75 to 5.75 pixels to the right and y from 2.25 to 5.25 downwards.
    let (across, down) = ([0.25, 1.0, 1.0, 0.75], [0.75, 1.0, 1.0, 0.25]);
    for (y, x) in (0..8).flat_map(|y| (0..8).map(move |x| (y, x))) {
        let share =
            |shares: [f64; 4], i: u32| i.checked_sub(2).and_then(|i| shares.get(i as usize)).copied().unwrap_or(0.0);
        let expected = share(across, x) * share(down, y);
        assert_eq!(at(&picture, x, y), [expected; 4], "{x}, {y}");
        assert_eq!(depth_at(&picture, x, y), if expected > 0.0 { 5.0 } else { f64::INFINITY });
    }
}

/// Two surfaces in one pixel: the depth is one of theirs, the nearer for half and half.
#[test]
fn depths_at_an_edge_are_not_mixed() {
    let half = |x: f32, near: f32| {
        let scene =
            Small::flat_view().opaque().splat([x, 0.5, near], Z, 1.0, RED).splat([0.5, 0.5, 0.0], Z, 1.0, WHITE);
        let scene = scene.style(|s| s.footprint = Footprint::Pixels(1.0));
        depth_at(&scene.with(|scene| supersampled(scene, 8)), 4, 3)
    };
    assert_eq!(half(0.0, 1.0), 4.0);
    assert_eq!(half(-0.125, 1.0), 5.0);
}

/// Eye-dome lighting is of the final picture: neighbours are final pixels, depths the folded ones.
#[test]
fn the_eye_dome_sees_final_pixels() {
    let eye_dome = EyeDome { strength: 0.25, radius: 2.0 };
    let scene = Small::flat_view().opaque().splat([0.5, 0.5, 0.0], Z, 1.0, WHITE).splat([2.5, 0.5, 1.0], Z, 1.0, WHITE);
    let scene = scene.style(|s| s.footprint = Footprint::Pixels(1.0));
    let plain = scene.with(|scene| supersampled(scene, 4));
    let dark = scene.style(|s| s.eye_dome = Some(eye_dome)).with(|scene| supersampled(scene, 4));
    // The pixel at depth 5 has a neighbour at depth 4 two final pixels to its right, one of eight.
    let factor = (-100.0 * 0.25 * (5f64 / 4.0).log2() / 8.0).exp();
    assert_eq!(at(&plain, 4, 3), [1.0; 4]);
    assert!((at(&dark, 4, 3)[0] - factor).abs() < 1e-15 && at(&dark, 4, 3)[3] == 1.0);
    assert_eq!(at(&dark, 6, 3), [1.0; 4]);
}

#[test]
#[should_panic(expected = "divides 32")]
fn a_factor_that_does_not_divide_a_tile_is_refused() {
    Small::flat_view().with(|scene| supersampled(scene, 3));
}
