//! What rounding does to the blends on surfaces: how many pixels are ties, and how little the others change.

use glam::{DMat4, DVec3, DVec4, dvec3};
use surfel::load::synthetic;
use surfel::reference::{Instance, MARGIN_F32, Picture, Scene, render};
use surfel::select::{DrawList, View};
use surfel::structure::Flat;
use surfel::style::{BackFaces, Front, Shading, Style, Voronoi};
use surfel::technique::Blend;

use crate::reference_common::{Random, grouped, technique};

const SIZE: u32 = 160;
const EYE: DVec3 = dvec3(1.9, -1.6, 1.2);

/// A scene with a group for every splat that holds no earlier one nearer than `factor` times the sum of their radii, as far
/// as 256 go.
fn surface(name: &str, points: usize, factor: f32) -> Flat {
    let mut flat = Flat::new(&synthetic::scene(name, points, 1).unwrap());
    let mut of: Vec<u8> = vec![];
    for (i, &[x, y, z, r]) in flat.geometry.iter().enumerate() {
        let mut taken = [false; 256];
        for (&[a, b, c, s], &group) in flat.geometry[..i].iter().zip(&of) {
            let d2 = (a - x) * (a - x) + (b - y) * (b - y) + (c - z) * (c - z);
            taken[group as usize] |= d2 < (factor * (r + s)).powi(2);
        }
        of.push(taken.iter().position(|t| !t).unwrap_or(255) as u8);
    }
    let count = of.iter().max().map_or(0, |&g| g as u32 + 1);
    flat.groups = Some(grouped(of, count, factor < 1.0));
    flat
}

/// Every way to blend, with the groups' factor.
fn every_blend() -> Vec<(&'static str, Blend, Style, f32)> {
    let style = Style { shading: Shading::None, back_faces: BackFaces::Draw, ..Style::default() };
    vec![
        ("two-pass", Blend::TwoPass, style, 1.0),
        ("fuzzy", Blend::Fuzzy, style, 1.0),
        ("fuzzy as published", Blend::Fuzzy, Style { front: Front::First, ..style }, 1.0),
        ("groups without overlap", Blend::Groups, style, 1.0),
        ("groups, cones", Blend::Groups, style, 0.5),
        ("groups, slabs", Blend::Groups, Style { voronoi: Voronoi::Slabs, ..style }, 0.5),
        ("groups, off", Blend::Groups, Style { voronoi: Voronoi::Off, ..style }, 0.5),
    ]
}

fn picture(flat: &Flat, blend: Blend, style: &Style, margin: f64) -> Picture {
    let view = View::look_at(EYE, DVec3::ZERO, DVec3::Z, View::perspective(0.8, 1.0, 0.01), Default::default());
    let mut technique = technique("flat.two-pass.point");
    technique.blend = blend;
    let (instances, list) = ([Instance::points(flat, DMat4::IDENTITY)], DrawList::all([flat.len() as u32]));
    let (instances, list, view) = (&instances, &list, &view);
    let scene = Scene { instances, list, view, width: SIZE, height: SIZE, technique, style, host_depth: None };
    render(&scene, margin)
}

#[test]
fn few_pixels_of_a_surface_are_ties() {
    for scene in ["sphere", "demo", "room"] {
        let flats = [1.0, 0.5].map(|factor| surface(scene, 6000, factor));
        // Splats of one plane are equally deep all over: without cones or slabs nothing but rounding decides.
        for (name, blend, style, factor) in every_blend().into_iter().filter(|b| b.2.voronoi != Voronoi::Off) {
            let picture = picture(&flats[(factor < 1.0) as usize], blend, &style, MARGIN_F32);
            let covered = picture.rgba.iter().filter(|p| p[3] > 0.0).count();
            let ties = picture.ties.iter().filter(|t| **t).count();
            println!("{scene}, {name}: {ties} of {covered}");
            assert!(covered > 2000 && 100 * ties < covered, "{scene}, {name}: {ties} ties of {covered} pixels");
        }
    }
}

/// Positions off by 10⁻⁷ of their distance move images by δ = 10⁻⁷ · focal length: pixels change by their sensitivity
/// times that, or are ties.
#[test]
fn what_is_no_tie_changes_little() {
    let noise = 1e-7;
    let focal = 0.5 * SIZE as f64 / 0.4f64.tan();
    // Across the ray √2 · noise at most; stored positions of up to 2 round by 2⁻²⁴ each way.
    let shift = (2f64.sqrt() * noise + 2f64.sqrt() * 2f64.powi(-24)) * focal;
    for scene in ["sphere", "demo", "room"] {
        let flats = [1.0, 0.5].map(|factor| surface(scene, 3000, factor));
        for (name, blend, style, factor) in every_blend() {
            let flat = &flats[(factor < 1.0) as usize];
            let before = picture(flat, blend, &style, MARGIN_F32);
            let (mut random, mut largest) = (Random(5), 0.0f64);
            for _ in 0..4 {
                let mut moved = flat.clone();
                for g in &mut moved.geometry {
                    let p = dvec3(g[0] as f64, g[1] as f64, g[2] as f64);
                    let scale = noise * ((flat.origin + p) - EYE).length();
                    let p = p + dvec3(1.0, 1.0, 1.0).map(|_| scale * random.range(-1.0, 1.0));
                    (g[0], g[1], g[2]) = (p.x as f32, p.y as f32, p.z as f32);
                }
                let after = picture(&moved, blend, &style, 0.0);
                for i in (0..before.rgba.len()).filter(|&i| !before.ties[i]) {
                    let change = (DVec4::from(before.rgba[i]) - DVec4::from(after.rgba[i])).abs().max_element();
                    // √3 / √2 for noise along the ray, which a wide angle sees from the side; second order beside it.
                    let bound = 1.3 * before.sensitivity[i] * shift + 1e-6;
                    assert!(change <= bound, "{scene}, {name}, pixel {i}: {change:e} is more than {bound:e}");
                    largest = largest.max(change / bound);
                }
            }
            println!("{scene}, {name}: {largest:.2} of the bound");
        }
    }
}
