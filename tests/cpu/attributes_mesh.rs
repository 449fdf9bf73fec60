//! What faces give: exact normals, radii that cover, and whether the surface is closed.

use glam::Vec3;
use proptest::prelude::*;
use surfel::load::attributes::{Options, complete};
use surfel::load::{Mesh, PointCloud};

const TETRAHEDRON: [[f32; 3]; 4] = [[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0]];
const SIDES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

fn mesh(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> PointCloud {
    PointCloud {
        positions: positions.iter().map(|p| Vec3::from(*p)).collect(),
        mesh: Some(Mesh { triangles: triangles.to_vec() }),
        ..Default::default()
    }
}

fn completed(mut cloud: PointCloud) -> PointCloud {
    complete(&mut cloud, &Options::default());
    cloud
}

fn tetrahedron() -> PointCloud {
    mesh(&TETRAHEDRON, &SIDES)
}

/// The cube from −1 to 1; vertex i has the signs of its bits. Faces are cut along arbitrary diagonals.
fn cube() -> PointCloud {
    let positions: Vec<[f32; 3]> =
        (0..8).map(|i| [0, 1, 2].map(|a| if i >> a & 1 == 1 { 1.0 } else { -1.0 })).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles: Vec<[u32; 3]> = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    mesh(&positions, &triangles)
}

/// An octahedron, each face cut in four, `times` over, and pushed out to the unit sphere.
fn sphere(times: u32) -> PointCloud {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let mut positions = vec![x, -x, y, -y, z, -z];
    let mut triangles = vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    for _ in 0..times {
        let mut middles = std::collections::BTreeMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                positions.push((positions[a as usize] + positions[b as usize]).normalize());
                positions.len() as u32 - 1
            })
        };
        let cut = |[a, b, c]: [u32; 3]| {
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        };
        triangles = triangles.into_iter().flat_map(cut).collect();
    }
    PointCloud { positions, mesh: Some(Mesh { triangles }), ..Default::default() }
}

/// By symmetry the vertex directions, for the cube because the angles of a face's triangles add up to its 90 degrees
/// however it is cut (area weights fail here). f64 sums rounded once to f32.
#[test]
fn symmetric_solids_have_exact_normals() {
    for cloud in [tetrahedron(), cube(), sphere(0)] {
        let found = completed(cloud);
        for (n, p) in found.normals.unwrap().iter().zip(&found.positions) {
            assert!((*n - p.normalize()).abs().max_element() < 1.2e-7, "{n} at {p}");
        }
        assert!(found.closed);
        assert_eq!(found.report.assumed.len(), 2);
    }
}

/// Facets of length e on the unit sphere lean by at most e / √3 (their circumradius) against the vertices, and
/// so does any average of them.
#[test]
fn sphere_within_its_facets() {
    let found = completed(sphere(4));
    let mut longest = 0.0f32;
    for t in &found.mesh.as_ref().unwrap().triangles {
        let [a, b, c] = t.map(|i| found.positions[i as usize]);
        longest = longest.max((b - a).length()).max((c - b).length()).max((a - c).length());
    }
    for (n, p) in found.normals.unwrap().iter().zip(&found.positions) {
        assert!(n.cross(*p).length() < longest / 3f32.sqrt() && n.dot(*p) > 0.0);
    }
    assert!(found.closed);
}

/// Tetrahedron of edge 2√2: ¾ of it is 2.12, more than √(a third of three faces of 2√3) = 1.86.
/// Flat hexagon of edge 1: the centre has six faces of √3/4, √(6 √3/12) = 0.93, more than ¾.
#[test]
fn radii_are_the_documented_ones() {
    for r in completed(tetrahedron()).radii.unwrap() {
        assert!((r - 0.75 * 8f32.sqrt()).abs() < 1e-6);
    }
    let mut positions = vec![[0.0f32; 3]];
    positions.extend((0..6).map(|i| (std::f32::consts::FRAC_PI_3 * i as f32).sin_cos()).map(|(s, c)| [c, s, 0.0]));
    let triangles: Vec<[u32; 3]> = (0..6).map(|i| [0, i + 1, (i + 1) % 6 + 1]).collect();
    let found = completed(mesh(&positions, &triangles));
    assert!((found.radii.unwrap()[0] - (3f32.sqrt() / 2.0).sqrt()).abs() < 1e-6);
    assert_eq!(found.normals.unwrap(), [Vec3::Z; 7]);
    assert!(!found.closed);
}

proptest! {
    /// Every point of every triangle, however thin, is within 0.943 r of a corner: √½ / ¾, and rounding.
    #[test]
    fn triangles_are_covered(x in 0.001f32..1.0, y in 1e-4f32..2.0, u in 0f32..1.0, v in 0f32..1.0) {
        let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [x, y, 0.0]];
        let found = completed(mesh(&positions, &[[0, 1, 2]]));
        let radii = found.radii.unwrap();
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        let at = Vec3::new(u + v * x, v * y, 0.0);
        let nearest = (0..3).map(|i| (found.positions[i] - at).length() / radii[i]).fold(f32::INFINITY, f32::min);
        prop_assert!(nearest <= 0.943, "{}", nearest);
    }
}

/// Each of these has something to see behind what faces away.
#[test]
fn not_closed() {
    let closed = |cloud: PointCloud| completed(cloud).closed;
    let with = |triangles: &[[u32; 3]]| mesh(&TETRAHEDRON, triangles);
    let flip = |t: [u32; 3]| [t[0], t[2], t[1]];
    assert!(closed(tetrahedron()));
    assert!(!closed(with(&SIDES[..3])), "a face is missing");
    assert!(!closed(with(&[SIDES[0], SIDES[1], SIDES[2], flip(SIDES[3])])), "a face is turned round");
    assert!(!closed(with(&SIDES.map(flip))), "inside out");
    assert!(!closed(with(&[SIDES, SIDES].concat())), "every face twice");
    assert!(!closed(with(&[SIDES[0], flip(SIDES[0])])), "a sheet, and a vertex without a face");
    assert!(!closed(mesh(&TETRAHEDRON[..3], &[SIDES[0], flip(SIDES[0])])), "a sheet");
    assert!(!closed(mesh(&TETRAHEDRON, &[])), "no faces");

    let two = |second: [[u32; 3]; 4], shift: f32| {
        let moved = TETRAHEDRON.map(|p| [p[0] + shift, p[1], p[2]]);
        let triangles = [SIDES, second.map(|t| t.map(|i| i + 4))].concat();
        mesh(&[TETRAHEDRON, moved].concat(), &triangles)
    };
    assert!(closed(two(SIDES, 10.0)));
    assert!(!closed(two(SIDES.map(flip), 10.0)), "one of two parts is inside out");

    let mut loose = tetrahedron();
    loose.positions.push(Vec3::X * 9.0);
    assert!(!closed(loose), "a point without a face");
    let mut inward = tetrahedron();
    inward.normals = Some(inward.positions.iter().map(|p| -p.normalize()).collect());
    assert!(!closed(inward), "the file's normals point in");
    // Far from the origin the volume's rounding is the part's own, not the distance's.
    let mut far = cube();
    far.positions.iter_mut().for_each(|p| *p = *p * 0.125 + Vec3::splat(1e5));
    assert!(closed(far));
}

/// A vertex without a face, or with none that has an area, is completed from its neighbours.
#[test]
fn loose_vertices_fall_back() {
    let mut cloud = sphere(3);
    let n = cloud.len();
    let unit = cloud.positions.clone();
    cloud.positions.extend(unit.iter().map(|p| *p * 3.0));
    cloud.mesh.as_mut().unwrap().triangles.push([n as u32; 3]);
    let found = completed(cloud);
    let (normals, radii) = (found.normals.unwrap(), found.radii.unwrap());
    for i in n..2 * n {
        assert!(normals[i].dot(unit[i - n]).abs() > 0.95, "{}", normals[i]);
        assert!(radii[i] > 0.15 && radii[i] < 1.5, "{}", radii[i]);
    }
    assert_eq!(
        found.report.repaired,
        [("vertices without a face, completed from their neighbours".to_owned(), n as u64)]
    );
    assert!(!found.closed);
}
