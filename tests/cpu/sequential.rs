//! Sequential point trees: averages, disks and errors against all leaves below, odd clouds, clusters.

use glam::{DVec3, Vec3};
use surfel::load::{PointCloud, synthetic};
use surfel::select::{DrawList, Sight};
use surfel::structure::nodes::{ErrorRule, NONE};
use surfel::structure::sequential::Options;
use surfel::structure::{Flat, Sequential, octahedral};
use surfel::style::Interval;

use crate::groups::{random, soup};

pub fn with(rule: ErrorRule) -> Options {
    // Colours of a soup are all mixed up.
    Options { rule, color_error: 2.0, ..Options::default() }
}

/// `n` splats on a bumpy sheet, all normals upward.
pub fn sheet(n: usize, bump: f32, seed: u64) -> Flat {
    let mut next = random(seed);
    let at = (0..n).map(|_| (next().powi(2), next())).collect::<Vec<_>>();
    let height = |x: f32, y: f32| bump * ((7.0 * x).sin() + (9.0 * y).cos());
    let slope = |x: f32, y: f32| Vec3::new(-7.0 * bump * (7.0 * x).cos(), 9.0 * bump * (9.0 * y).sin(), 1.0);
    Flat::new(&PointCloud {
        positions: at.iter().map(|&(x, y)| Vec3::new(x, y, height(x, y))).collect(),
        normals: Some(at.iter().map(|&(x, y)| slope(x, y)).collect()),
        radii: Some(at.iter().map(|&(x, _)| 0.01 + 0.05 * x).collect()),
        ..Default::default()
    })
}

/// The entry of each node.
pub fn entries(tree: &Sequential) -> Vec<usize> {
    let mut of = vec![usize::MAX; tree.nodes.nodes.len()];
    for (i, [own, _]) in tree.nodes.links.iter().enumerate().filter(|(_, link)| link[0] != NONE) {
        assert_eq!(std::mem::replace(&mut of[*own as usize], i), usize::MAX, "one entry a node");
    }
    assert!(!of.contains(&usize::MAX));
    assert!(of.is_sorted(), "nodes are in the list's order");
    of
}

/// Leaves below each node.
fn below(tree: &Sequential) -> Vec<Vec<usize>> {
    let entry = entries(tree);
    let mut below = vec![Vec::new(); entry.len()];
    for (i, [own, parent]) in tree.nodes.links.iter().enumerate() {
        let mut up = if *own == NONE { *parent } else { NONE };
        while up != NONE {
            below[up as usize].push(i);
            up = tree.nodes.links[entry[up as usize]][1];
        }
    }
    below
}

fn place(flat: &Flat, i: usize) -> DVec3 {
    let [x, y, z, _] = flat.geometry[i];
    Vec3::new(x, y, z).as_dvec3()
}

fn normal(flat: &Flat, i: usize) -> Option<DVec3> {
    flat.normals.as_ref().and_then(|n| octahedral::decode(n[i]))
}

/// How far a disk reaches in a direction.
fn reach(flat: &Flat, i: usize, along: DVec3) -> f64 {
    let sine = normal(flat, i).map_or(1.0, |n| (1.0 - n.dot(along).powi(2)).max(0.0).sqrt());
    flat.geometry[i][3] as f64 * sine
}

fn clouds() -> Vec<Flat> {
    vec![soup(500, 0.1, 3.0, 1), sheet(500, 0.02, 2), sheet(400, 0.0, 3), soup(70, 0.5, 0.0, 4)]
}

/// Everything that a tree promises of its shape.
fn check(flat: &Flat, tree: &Sequential) {
    let all = &tree.flat;
    assert_eq!(all.len(), flat.len() + tree.nodes.nodes.len());
    assert_eq!([tree.levels.len(), tree.nodes.links.len()], [all.len(); 2]);
    assert_eq!(tree.leaves as usize, flat.len());
    let bits = |f: &Flat, i: usize| {
        (f.geometry[i].map(f32::to_bits), f.normals.as_ref().map(|n| n[i]), f.colors.as_ref().map(|c| c[i]))
    };
    let mut there: Vec<_> = (0..all.len()).filter(|&i| tree.nodes.links[i][0] == NONE).map(|i| bits(all, i)).collect();
    let mut given: Vec<_> = (0..flat.len()).map(|i| bits(flat, i)).collect();
    there.sort_unstable();
    given.sort_unstable();
    assert!(there == given, "every point is there, once");
    let mut end = 0;
    for list in &tree.lists {
        assert_eq!(list.first, end);
        end += list.count;
        let keys: Vec<f32> = (list.first..end).map(|i| tree.key(i as usize)).collect();
        assert!(keys.is_sorted_by(|a, b| a >= b), "keys fall");
    }
    assert_eq!(end as usize, all.len());
    let entry = entries(tree);
    let mut roots = 0;
    let mut children = vec![0; entry.len()];
    for (i, &[own, parent]) in tree.nodes.links.iter().enumerate() {
        if parent == NONE {
            assert_eq!(tree.levels[i], 0);
            roots += (own != NONE) as usize;
            continue;
        }
        children[parent as usize] += 1;
        let up = entry[parent as usize];
        assert_eq!(tree.levels[i], tree.levels[up] + 1);
        let (apart, [r, whole]) = ((place(all, i) - place(all, up)).length(), [i, up].map(|i| all.geometry[i][3]));
        assert!(apart + r as f64 <= whole as f64, "a disk holds its child's");
        let error = |n: u32| {
            let node = &tree.nodes.nodes[n as usize];
            (node.error as f64).hypot(node.tangential as f64)
        };
        if own != NONE {
            assert!(error(own) + tree.nodes.tau_max as f64 * apart <= error(parent), "errors are inherited");
        }
        let wide = 2.0 * whole as f64;
        assert!(tree.nodes.rule == ErrorRule::Cell || error(parent) <= wide, "{} > {wide}", error(parent));
    }
    assert_eq!(roots, (!entry.is_empty()) as usize);
    assert!(children.iter().all(|n| (2..=8).contains(n)), "no chains");
    assert!(tree.levels.iter().all(|&l| l <= 32), "depth {:?}", tree.levels.iter().max());
}

#[test]
fn disks_hold_all_disks_below() {
    for flat in clouds() {
        let tree = Sequential::build(&flat, &with(ErrorRule::Geometric));
        check(&flat, &tree);
        for (leaves, &entry) in below(&tree).iter().zip(&entries(&tree)) {
            let (all, mut mean) = (&tree.flat, DVec3::ZERO);
            for &leaf in leaves {
                let apart = (place(all, leaf) - place(all, entry)).length();
                assert!(apart + all.geometry[leaf][3] as f64 <= all.geometry[entry][3] as f64);
                mean += place(all, leaf) / leaves.len() as f64;
            }
            assert!((mean - place(all, entry)).length() < 1e-6, "positions average");
        }
    }
}

#[test]
fn errors_bound_all_disks_below() {
    for (published, rule) in [false, true].into_iter().flat_map(|p| [(p, ErrorRule::Geometric), (p, ErrorRule::Split)])
    {
        let mut short = 0;
        for flat in clouds() {
            let tree = Sequential::build(&flat, &Options { published_errors: published, ..with(rule) });
            let all = &tree.flat;
            for ((leaves, node), &entry) in below(&tree).iter().zip(&tree.nodes.nodes).zip(&entries(&tree)) {
                let Some(n) = normal(all, entry) else { continue };
                let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
                for &leaf in leaves {
                    let (at, half) = ((place(all, leaf) - place(all, entry)).dot(n), reach(all, leaf, n));
                    (low, high) = (low.min(at - half), high.max(at + half));
                }
                short += ((node.error as f64) < high - low) as usize;
            }
        }
        // Published errors are over children alone, and are too small for some.
        assert_eq!(short > 0, published, "{short} are short, {rule}");
    }
}

#[test]
fn tangential_errors_of_a_plane_bound_all_disks_below() {
    let flat = sheet(400, 0.0, 3);
    let tree = Sequential::build(&flat, &with(ErrorRule::Split));
    let (u, v) = DVec3::Z.any_orthonormal_pair();
    let mut some = 0;
    for ((leaves, node), &entry) in below(&tree).iter().zip(&tree.nodes.nodes).zip(&entries(&tree)) {
        let diameter = 2.0 * tree.flat.geometry[entry][3] as f64;
        for k in 0..8 {
            let (sine, cosine) = (std::f64::consts::PI * f64::from(k) / 8.0).sin_cos();
            let along = u * cosine + v * sine;
            let ends = |sign: f64| {
                let end = |&leaf: &usize| sign * place(&tree.flat, leaf).dot(along) + reach(&tree.flat, leaf, along);
                leaves.iter().map(end).fold(f64::NEG_INFINITY, f64::max)
            };
            let error = node.error.max(node.tangential) as f64;
            assert!(error >= diameter - ends(1.0) - ends(-1.0) - 1e-9);
        }
        some += (node.tangential > 0.0 && (node.tangential as f64) < 0.8 * diameter) as usize;
    }
    assert!(some > tree.nodes.nodes.len() / 2, "{some}: errors say something");
}

#[test]
fn colours_average_in_linear_light_and_raise_errors() {
    let cloud = |colors: Vec<[u8; 3]>| {
        Flat::new(&PointCloud {
            positions: (0..colors.len()).map(|i| Vec3::X * i as f32).collect(),
            normals: Some(vec![Vec3::Z; colors.len()]),
            radii: Some(vec![1.0; colors.len()]),
            colors: Some(colors),
            ..Default::default()
        })
    };
    for rule in [ErrorRule::Geometric, ErrorRule::Split] {
        let options = Options { rule, ..Options::default() };
        let root = |colors| {
            let tree = Sequential::build(&cloud(colors), &options);
            let color = tree.flat.colors.as_ref().expect("colours")[0].to_le_bytes();
            (color, tree.nodes.nodes[0], tree.flat.geometry[0][3])
        };
        // (0 + 1) / 2 in linear light is byte 188.
        let (color, node, r) = root(vec![[0; 3], [255; 3]]);
        assert_eq!(color, [188, 188, 188, 255]);
        assert_eq!((node.error, node.tangential), (2.0 * r, 0.0));
        assert!(rule == ErrorRule::Geometric || node.normal == [0.0; 3], "from everywhere");
        let (color, node, r) = root(vec![[100; 3], [100; 3]]);
        assert_eq!(color, [100, 100, 100, 255]);
        assert!(node.error < r && node.normal == [0.0, 0.0, 1.0]);
    }
}

#[test]
fn normals_of_open_surfaces_may_point_either_way() {
    let mut flat = sheet(300, 0.0, 5);
    flat.normals.as_mut().expect("normals").iter_mut().step_by(3).for_each(|n| *n = octahedral::encode(-Vec3::Z));
    let upright = |tree: &Sequential| tree.nodes.nodes.iter().all(|n| n.normal[2].abs() > 0.999);
    assert!(upright(&Sequential::build(&flat, &with(ErrorRule::Geometric))));
    flat.closed = true;
    let closed = Sequential::build(&flat, &with(ErrorRule::Geometric));
    assert!(!upright(&closed) && closed.flat.closed, "two sides that cancel have no normal");
}

#[test]
fn odd_clouds() {
    let cloud = |positions: Vec<Vec3>| {
        Flat::new(&PointCloud { radii: Some(vec![0.5; positions.len()]), positions, ..Default::default() })
    };
    let mut next = random(8);
    let line: Vec<Vec3> = (0..500).map(|_| Vec3::new(1.0, 2.0, 3.0) * next()).collect();
    let scaled = |scale: f32| {
        let mut flat = soup(300, 0.1, 2.0, 9);
        flat.geometry.iter_mut().flatten().for_each(|v| *v *= scale);
        flat
    };
    let clouds = [
        cloud(Vec::new()),
        cloud(vec![Vec3::ONE]),
        cloud(vec![Vec3::ONE; 2]),
        cloud(vec![Vec3::ONE; 1000]),
        cloud(line),
        cloud((0..500).map(|_| Vec3::new(next(), next(), 0.0)).collect()),
        cloud((0..100).map(|i| Vec3::X * (0.5f32).powi(i)).collect()),
        scaled(1e-6),
        scaled(1e7),
        soup(300, 0.0, 0.0, 1),
    ];
    for flat in clouds {
        for (_, rule) in ErrorRule::ALL {
            check(&flat, &Sequential::build(&flat, &with(*rule)));
        }
    }
}

#[test]
fn what_cannot_be_tested_comes_first_and_is_kept() {
    let mut flat = soup(200, 0.1, 1.0, 6);
    let odd =
        [(3, 0, f32::NAN), (40, 1, f32::INFINITY), (77, 3, f32::NAN), (120, 3, -1.0), (121, 2, 1e20), (199, 3, 0.0)];
    odd.iter().for_each(|&(i, k, v)| flat.geometry[i][k] = v);
    for clusters in [false, true] {
        let tree = Sequential::build(&flat, &Options { clusters, ..with(ErrorRule::Geometric) });
        check(&flat, &tree);
        assert_eq!((tree.lists[0].first, tree.lists[0].count as usize), (0, odd.len()));
        assert!(tree.nodes.links[..odd.len()].iter().all(|l| *l == [NONE; 2]));
        assert!(tree.lists[1..].iter().all(|l| l.min.is_finite() && l.max.is_finite()));
        // Even where nothing else is seen.
        let away = Sight {
            eye: DVec3::splat(9.0).extend(1.0),
            tau: 0.001,
            planes: [DVec3::X.extend(-99.0); 5],
            radius_scale: 1.0,
        };
        let mut list = DrawList::default();
        tree.select(&away, Interval::Exact, false, 3, &mut list);
        assert_eq!(list.spans.iter().map(|s| (s.instance, s.first, s.count)).collect::<Vec<_>>(), [(3, 0, 6)]);
    }
}

#[test]
fn a_hundred_thousand_in_one_place() {
    let mut flat = soup(100_000, 0.1, 1.0, 7);
    for p in &mut flat.geometry[1000..] {
        [p[0], p[1], p[2]] = [0.25, 0.5, 0.75];
    }
    let tree = Sequential::build(&flat, &with(ErrorRule::Split));
    check(&flat, &tree);
}

#[test]
fn threads_change_nothing() {
    let flat = soup(60_000, 0.05, 3.0, 11);
    let made = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let mut bytes = Vec::new();
        let options = Options { clusters: true, ..Options::default() };
        pool.install(|| Sequential::build(&flat, &options)).write(&mut bytes).expect("memory");
        bytes
    };
    let one = made(1);
    assert!(one == made(2) && one == made(3));
}

#[test]
fn lists_by_normal_face_away_together() {
    let flat = Flat::new(&synthetic::scene("sphere", 5000, 1).expect("a sphere"));
    let one = Sequential::build(&flat, &Options::default());
    let tree = Sequential::build(&flat, &Options { clusters: true, ..Options::default() });
    check(&flat, &tree);
    assert!((100..130).contains(&tree.lists.len()), "{}", tree.lists.len());
    let mut next = random(5);
    let (mut all, mut kept) = (0, 0);
    for k in 0..200 {
        let to = DVec3::from([0; 3].map(|_: u8| 2.0 * next() as f64 - 1.0)).normalize();
        let eye = if k % 4 == 0 { to.extend(0.0) } else { (to * f64::from(k)).extend(1.0) };
        let sight = Sight { eye, tau: 1e-9, planes: [DVec3::ZERO.extend(1.0); 5], radius_scale: 1.0 };
        let mut list = DrawList::default();
        tree.select(&sight, Interval::Exact, true, 0, &mut list);
        let mut drawn = vec![false; tree.flat.len()];
        list.spans.iter().for_each(|s| drawn[s.first as usize..(s.first + s.count) as usize].fill(true));
        // Lists of nodes alone, none of which passes, are left out too.
        let leaf = |i: usize| tree.nodes.links[i][0] == NONE;
        for i in (0..drawn.len()).filter(|&i| !drawn[i] && leaf(i)) {
            let v = eye.truncate() - place(&tree.flat, i) * eye.w;
            assert!(normal(&tree.flat, i).expect("a normal").dot(v) < 0.0, "entry {i} faces the viewer");
        }
        all += drawn.len();
        kept += list.submitted() as usize;
        let mut whole = DrawList::default();
        one.select(&sight, Interval::Exact, true, 0, &mut whole);
        assert_eq!(whole.submitted() as usize, one.flat.len());
    }
    assert!(kept < all * 7 / 10, "{kept} of {all}");
}
