//! The tiled renderer against every splat × every pixel, in world space and with numerical derivatives.

use glam::{DMat4, DQuat, DVec2, DVec3, DVec4, dvec2, dvec3, dvec4};
use surfel::color::srgb_to_linear;
use surfel::reference::{Instance, MARGIN_F32, Scene, render};
use surfel::select::{DepthConvention, DrawList, Span, View};
use surfel::structure::flat::Block;
use surfel::structure::{Flat, octahedral};
use surfel::style::{BackFaces, Ellipse, Footprint, Front, Shading, Style, Tolerance, Voronoi};
use surfel::technique::Blend;

use crate::reference_blends::{Hit, Kept, fuzzy, groups, within_tolerance};
use crate::reference_common::{Random, grouped, technique};

/// Unlit picture: colour · α with α, and depth. Splats must be valid.
pub fn oracle(scene: &Scene) -> Vec<(DVec4, f64)> {
    let (view, style) = (scene.view, scene.style);
    let size = dvec2(scene.width as f64, scene.height as f64);
    let matrix = view.projection * view.view;
    let back = matrix.inverse();
    let eye = view.view.inverse() * view.centre_of_projection();
    // Left-handed hosts have w = z.
    let sign = if view.projection.row(3).z > 0.0 { 1.0 } else { -1.0 };
    let linear = |x: DVec3| sign * view.view.transform_point3(x).z;
    let near = sign * -view.near();
    let pixel = |x: DVec3| {
        let c = matrix * x.extend(1.0);
        (dvec2(c.x, c.y) / c.w * 0.5 + 0.5) * size
    };
    let hit = |instance: &Instance, i: usize, f: DVec2| -> Option<Hit> {
        let [x, y, z, r] = instance.flat.geometry[i].map(|v| v as f64);
        let p = instance.transform.transform_point3(instance.flat.origin + dvec3(x, y, z));
        let mut r = r * style.radius_scale as f64 * instance.transform.x_axis.length();
        // Towards the viewer; `eye` is a direction in orthographic views.
        let v = if eye.w == 0.0 { eye.truncate() } else { eye.truncate() - p };
        let normal = instance.flat.normals.as_ref().and_then(|n| octahedral::decode(n[i]));
        let n = normal.map_or(v, |n| instance.transform.transform_vector3(n)).normalize();
        // A closed cloud's are dropped where its blocks lie beyond the near plane.
        let whole = || {
            instance.flat.blocks.iter().all(|b| {
                let reach = b.radius as f64 * style.radius_scale as f64 * instance.transform.x_axis.length();
                let corners = (0..8).map(|c| [0, 1, 2].map(|axis| [b.min, b.max][c >> axis & 1][axis] as f64));
                corners.into_iter().all(|c| {
                    linear(instance.transform.transform_point3(instance.flat.origin + DVec3::from(c))) - reach >= near
                })
            })
        };
        let cull = match style.back_faces {
            BackFaces::Cull => true,
            BackFaces::Auto => instance.flat.closed && whole(),
            BackFaces::Draw => false,
        };
        if cull && n.dot(v) < 0.0 {
            return None;
        }
        // The low-pass counts as radius: ρ pixels across the ray, tan θ (1 to 8) times as deep.
        let mut spread = 0.0;
        if linear(p) >= near {
            let (a, b) = v.normalize().any_orthonormal_pair();
            let h = 1e-5 * v.length();
            let across = |t: DVec3| (pixel(p + h * t) - pixel(p - h * t)) / (2.0 * h);
            let width = 1.0 / across(a).perp_dot(across(b)).abs().sqrt();
            let cos = n.dot(v.normalize()).abs();
            spread = style.low_pass as f64 * width * ((1.0 - cos * cos).max(0.0).sqrt() / cos).clamp(1.0, 8.0);
        }
        let eps = (style.tolerance.absolute as f64).max(style.tolerance.relative as f64 * r.max(spread));
        let color = instance.flat.colors.as_ref().map_or(style.base_color, |c| {
            let [r, g, b, _] = c[i].to_le_bytes();
            [r, g, b]
        });
        let color = DVec3::from(color.map(|b| srgb_to_linear(b as f64 / 255.0)));
        let (zp, in_front) = (linear(p), linear(p) >= near);
        let group = instance.flat.groups.as_ref().map(|g| g.of[i]);
        let splat = Hit { z: zp, u: 0.0, epsilon: eps, radius: r, color, group };
        if let Footprint::Pixels(s) = style.footprint {
            let d = (f - pixel(p)) / s as f64;
            let inside = d.min_element() >= -0.5 && d.max_element() < 0.5 && in_front;
            return inside.then_some(splat);
        }
        if scene.technique.blend == Blend::Opaque {
            r /= 2f64.sqrt();
        }
        // Two points of the pixel's ray from the matrices alone.
        let ndc = f / size * 2.0 - 1.0;
        let (a, b) = (back.project_point3(ndc.extend(0.6)), back.project_point3(ndc.extend(0.3)));
        let x = a + (b - a) * (n.dot(p - a) / n.dot(b - a));
        let (t1, t2) = n.any_orthonormal_pair();
        let reach = r * dvec2(linear(p + t1) - zp, linear(p + t2) - zp).length();
        let (mut u2, mut z) = ((x - p).length_squared() / (r * r), linear(x));
        if eye.w != 0.0 && z <= 0.0 {
            (u2, z) = (f64::INFINITY, zp);
        }
        if style.ellipse == Ellipse::Approximate && zp - reach >= near {
            // Differences over a hundred-thousandth of the radius: exact to 10⁻¹⁰ of the second derivative.
            let h = 1e-5 * r;
            let slope = |t: DVec3| (pixel(p + h * t) - pixel(p - h * t)) / (2.0 * h);
            let ab = glam::DMat2::from_cols(slope(t1), slope(t2)).inverse() * (f - pixel(p));
            u2 = ab.length_squared() / (r * r);
            z = linear(p + ab.x * t1 + ab.y * t2);
        }
        if in_front {
            u2 = u2.min((f - pixel(p)).length_squared() / (style.low_pass as f64).powi(2));
        }
        let z = z.clamp(zp - r, zp + r);
        (u2 <= 1.0 && z >= near).then(|| Hit { z, u: u2.sqrt(), ..splat })
    };
    let shade = |i: u32| {
        let f = dvec2((i % scene.width) as f64 + 0.5, (i / scene.width) as f64 + 0.5);
        let host = scene.host_depth.map_or(f64::INFINITY, |d| match d[i as usize] as f64 {
            d if d == view.depth.far() => f64::INFINITY,
            d => sign * -view.linear_depth(d),
        });
        let mut hits: Vec<Hit> = vec![];
        for span in &scene.list.spans {
            let instance = &scene.instances[span.instance as usize];
            hits.extend((span.first..span.first + span.count).filter_map(|i| hit(instance, i as usize, f)));
        }
        let (kept, hidden, front): Kept = match scene.technique.blend {
            Blend::Opaque => {
                let visible = hits.into_iter().filter(|h| h.z <= host).min_by(|a, b| a.z.total_cmp(&b.z));
                return visible.map_or((DVec4::ZERO, f64::INFINITY), |h| (h.color.extend(1.0), h.z));
            }
            Blend::Fuzzy => fuzzy(hits, host, style),
            Blend::Groups => groups(hits, host, scene),
            _ => within_tolerance(hits, host),
        };
        if kept.is_empty() {
            return (DVec4::ZERO, f64::INFINITY);
        }
        let weighted = || kept.iter().map(|h| ((-4.0 * h.u * h.u).exp2(), h.color));
        let weight: f64 = weighted().map(|(w, _)| w).sum();
        let color: DVec3 = weighted().map(|(w, c)| w * c).sum();
        // What a soft rim lets through is the background only where nothing lies behind.
        let alpha = if hidden { 1.0 } else { (2.0 * weight).min(1.0) };
        ((color / weight * alpha).extend(alpha), front)
    };
    (0..scene.width * scene.height).map(shade).collect()
}

fn cloud(random: &mut Random, n: usize, attributes: bool) -> Flat {
    let origin = dvec3(1000.0, -500.0, 20.0);
    let mut flat = Flat { origin, closed: attributes, ..Flat::default() };
    let (mut normals, mut colors) = (vec![], vec![]);
    for i in 0..n {
        let mut r = |a, b| random.range(a, b) as f32;
        // From a hundredth of a pixel to the whole picture.
        let radius = 10f32.powf(r(-3.0, 0.3));
        flat.geometry.push([r(-1.5, 1.5), r(-1.5, 1.5), r(-1.5, 1.5), radius]);
        let n = if i % 7 == 0 { glam::Vec3::ZERO } else { glam::vec3(r(-1.0, 1.0), r(-1.0, 1.0), r(-1.0, 1.0)) };
        normals.push(octahedral::encode(n));
        colors.push(u32::from_le_bytes([r(0.0, 255.0) as u8, r(0.0, 255.0) as u8, r(0.0, 255.0) as u8, 255]));
    }
    (flat.normals, flat.colors) = (attributes.then_some(normals), attributes.then_some(colors));
    // Groups that overlap themselves, now and then by chance; slabs over the middle half, so that others lie beyond.
    let (count, overlapping) = (12, attributes);
    let of = (0..n).map(|_| random.range(0.0, count as f64) as u8).collect();
    flat.groups = Some(grouped(of, count, overlapping));
    let half = glam::Vec3::splat(0.75);
    flat.blocks = vec![Block { first: 0, count: n as u32, min: -half, max: half, radius: 0.1 }];
    flat
}

/// Views of the clouds about (1000, −500, 20): perspective from without and from within, asymmetric and jittered, standard
/// depth, orthographic, left-handed.
fn views() -> Vec<View> {
    let target = dvec3(1000.0, -500.0, 20.0);
    let look = |from: DVec3, projection| View::look_at(target + from, target, DVec3::Z, projection, Default::default());
    let outside = look(dvec3(3.0, 2.0, 1.0), View::perspective(0.9, 1.4, 0.5));
    let mut shifted = outside;
    shifted.projection.z_axis.x = 0.3;
    shifted.projection.z_axis.y = -0.2;
    shifted.projection.w_axis.x = 0.1;
    shifted.projection.x_axis.x *= -1.0;
    let mut standard = outside;
    (standard.projection.z_axis.z, standard.projection.w_axis.z) = (-50.0 / 49.5, -25.0 / 49.5);
    standard.depth = DepthConvention::Standard;
    let mut left = outside;
    let mirror = DMat4::from_diagonal(dvec4(1.0, 1.0, -1.0, 1.0));
    (left.view, left.projection) = (mirror * left.view, left.projection * mirror);
    let inside = look(dvec3(0.3, 0.1, 0.2), View::perspective(1.8, 1.4, 0.05));
    let orthographic = look(dvec3(3.0, 2.0, 1.0), View::orthographic(4.0, 1.4, 1.0, 9.0));
    vec![outside, shifted, standard, left, inside, orthographic]
}

fn styles() -> Vec<Style> {
    let plain = Style { shading: Shading::None, ..Style::default() };
    vec![
        plain,
        Style {
            ellipse: Ellipse::Approximate,
            back_faces: BackFaces::Draw,
            radius_scale: 0.7,
            front: Front::First,
            voronoi: Voronoi::Slabs,
            ..plain
        },
        Style {
            low_pass: 2.5,
            back_faces: BackFaces::Cull,
            tolerance: Tolerance { absolute: 0.05, relative: 0.0 },
            voronoi: Voronoi::Off,
            ..plain
        },
        Style { footprint: Footprint::Pixels(5.0), front: Front::First, ..plain },
        Style { front: Front::First, voronoi: Voronoi::Slabs, ..plain },
    ]
}

/// Calls `f` for every view, style and blend, with two clouds of `n` points in four spans.
pub fn every_scene(n: usize, seed: u64, f: impl Fn(&Scene, &str)) {
    let mut random = Random(seed);
    let clouds = [cloud(&mut random, n, true), cloud(&mut random, n, false)];
    let target = clouds[0].origin;
    let turn = DMat4::from_translation(target)
        * DMat4::from_scale_rotation_translation(
            DVec3::splat(0.6),
            DQuat::from_rotation_x(1.0) * DQuat::from_rotation_z(2.0),
            dvec3(0.2, 0.1, -0.3),
        )
        * DMat4::from_translation(-target);
    let instances = [Instance::points(&clouds[0], DMat4::IDENTITY), Instance::points(&clouds[1], turn)];
    let span = |instance, first, count| Span { instance, first, count, least: 0.0 };
    let (n, half) = (n as u32, n as u32 / 2);
    let spans = vec![span(1, half, n - half), span(0, 3, n - 3), span(1, 0, half), span(0, 0, 2)];
    let list = DrawList { spans, ..DrawList::default() };
    for (v, view) in views().iter().enumerate() {
        // Tiles of 32 px: two whole and two cut ones.
        let (width, height) = (45, 37);
        let host: Vec<f32> = (0..width * height)
            .map(|i| if i % 3 == 0 { random_depth(view, i) } else { view.depth.far() as f32 })
            .collect();
        for (s, style) in styles().iter().enumerate() {
            for name in ["flat.two-pass.point", "flat.opaque.point", "flat.fuzzy.point", "flat.groups.point"] {
                let host_depth = (s % 2 == 0).then_some(host.as_slice());
                let technique = technique(name);
                let (instances, list) = (&instances, &list);
                f(
                    &Scene { instances, list, view, width, height, technique, style, host_depth },
                    &format!("seed {seed}, view {v}, style {s}, {name}"),
                );
            }
        }
    }
}

/// Depth-buffer value of a surface 2 to 5 in front of the viewer.
fn random_depth(view: &View, i: u32) -> f32 {
    let z = 2.0 + 3.0 * (i as f64 * 0.618).fract();
    let z_eye = if view.projection.row(3).z > 0.0 { z } else { -z };
    let clip = view.projection * dvec4(0.0, 0.0, z_eye, 1.0);
    (clip.z / clip.w) as f32
}

#[test]
fn tiles_are_the_naive_sum() {
    for seed in 1..=3 {
        every_scene(40, seed, |scene, name| {
            let picture = render(scene, 0.0);
            // World coordinates near 1000 round by 10⁻¹³, grazing rays magnify that a thousandfold; numerical derivatives of
            // the approximate form are good to 10⁻⁷ of its u.
            let bound = if scene.style.ellipse == Ellipse::Approximate { 1e-5 } else { 1e-8 };
            let mut covered = 0;
            for (i, (color, depth)) in oracle(scene).into_iter().enumerate() {
                let same_depth = depth == picture.depth[i] || (depth - picture.depth[i]).abs() < bound;
                let error = (DVec4::from(picture.rgba[i]) - color).abs().max_element();
                assert!(
                    same_depth && error < bound,
                    "{name}, pixel {i}: {:?} {} is not {color} {depth}",
                    picture.rgba[i],
                    picture.depth[i]
                );
                covered += depth.is_finite() as u32;
            }
            assert!(covered > 50, "{name}: only {covered} pixels covered");
            let c = picture.counts;
            assert_eq!(c.submitted, 79);
            assert_eq!(c.submitted, c.drawn + c.culled_frustum + c.culled_cone + c.culled_invalid, "{name}");
            assert!(picture.ties.iter().all(|t| !t));
        });
    }
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let (one, five) = (pool(1), pool(5));
    every_scene(300, 9, |scene, name| {
        let a = one.install(|| render(scene, MARGIN_F32));
        assert!(a == five.install(|| render(scene, MARGIN_F32)), "{name}");
        // And the margin is only for the ties.
        let b = render(scene, 0.0);
        assert!(a.rgba == b.rgba && a.depth == b.depth && a.counts == b.counts, "{name}");
    });
}

/// Moves every point by less than the margin: pixels that jump must be ties.
#[test]
fn rounding_makes_jumps_only_at_ties() {
    let jumps = std::cell::RefCell::new(std::collections::BTreeMap::new());
    // Large enough that jumps happen in small pictures.
    let margin = 2e-4;
    for seed in 20..30 {
        every_scene(100, seed, |scene, name| {
            let before = render(scene, margin);
            let mut random = Random(seed);
            let moved: Vec<Flat> = scene
                .instances
                .iter()
                .map(|i| {
                    let mut flat = i.flat.clone();
                    let inverse = i.transform.inverse();
                    let eye = scene.view.eye();
                    for g in &mut flat.geometry {
                        let p = flat.origin + dvec3(g[0] as f64, g[1] as f64, g[2] as f64);
                        let world = i.transform.transform_point3(p);
                        let distance = if eye.w == 0.0 { 1.0 } else { (world - eye.truncate()).length() };
                        // A third of the margin on each axis.
                        let mut step = || margin / 3.0 * distance * random.range(-1.0, 1.0);
                        let p = inverse.transform_point3(world + dvec3(step(), step(), step())) - flat.origin;
                        (g[0], g[1], g[2]) = (p.x as f32, p.y as f32, p.z as f32);
                    }
                    flat
                })
                .collect();
            let instances: Vec<Instance> =
                scene.instances.iter().zip(&moved).map(|(i, flat)| Instance { flat, ..*i }).collect();
            let after = render(&Scene { instances: &instances, ..*scene }, 0.0);
            let mut jumps = jumps.borrow_mut();
            let [jumped, ties, covered] = jumps.entry(scene.technique.blend.name()).or_insert([0u32; 3]);
            for i in 0..before.rgba.len() {
                let change = (DVec4::from(before.rgba[i]) - DVec4::from(after.rgba[i])).abs().max_element();
                *covered += before.depth[i].is_finite() as u32;
                *ties += before.ties[i] as u32;
                // u of a splat of one pixel (r ≈ 0.1 at 4) moves by 2·10⁻⁴ · 4 / 0.1 = 0.008, and the slope of α = 2 w in u is
                // 2.9 at most: 0.023, some more in a normalised colour. A rim is a jump of 0.125.
                if change > 0.08 {
                    *jumped += 1;
                    assert!(before.ties[i], "{name}, pixel {i}: {:?} became {:?}", before.rgba[i], after.rgba[i]);
                }
            }
        });
    }
    for (blend, [jumped, ties, covered]) in jumps.into_inner() {
        println!("{blend}: {jumped} jumped, {ties} ties, {covered} covered");
        assert!(jumped > 100, "{blend}: only {jumped} pixels jumped: the test shows nothing");
        assert!(ties < covered / 2, "{blend}: {ties} ties among {covered} covered pixels");
    }
}
