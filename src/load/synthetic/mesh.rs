//! Triangulated shapes, where truth is a mesh.

use glam::{Vec3, dvec3};

use crate::load::{Mesh, PointCloud};
use crate::rng::sin_cos;

/// A closed unit sphere of `rings` ≥ 2 bands with `sectors` ≥ 3 each (less is raised to that), exact normals. Every
/// vertex is there once.
pub fn sphere_mesh(rings: u32, sectors: u32) -> PointCloud {
    let (rings, sectors) = (rings.max(2), sectors.max(3));
    let mut positions = vec![Vec3::Z];
    for ring in 1..rings {
        let (across, z) = sin_cos(0.5 * f64::from(ring) / f64::from(rings));
        for sector in 0..sectors {
            let (sin, cos) = sin_cos(f64::from(sector) / f64::from(sectors));
            positions.push(dvec3(across * cos, across * sin, z).as_vec3());
        }
    }
    positions.push(Vec3::NEG_Z);
    let last = positions.len() as u32 - 1;
    let at = |ring: u32, sector: u32| 1 + (ring - 1) * sectors + sector % sectors;
    let mut triangles = Vec::new();
    for s in 0..sectors {
        triangles.push([0, at(1, s), at(1, s + 1)]);
        for ring in 1..rings - 1 {
            triangles.push([at(ring, s), at(ring + 1, s), at(ring + 1, s + 1)]);
            triangles.push([at(ring, s), at(ring + 1, s + 1), at(ring, s + 1)]);
        }
        triangles.push([at(rings - 1, s), last, at(rings - 1, s + 1)]);
    }
    closed(positions.clone(), positions, triangles)
}

/// A closed torus (radii 1 and 0.4, axis z) of `around` × `across` ≥ 3 × 3 cells, exact normals.
pub fn torus_mesh(around: u32, across: u32) -> PointCloud {
    let (around, across) = (around.max(3), across.max(3));
    let (mut positions, mut normals, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    let at = |u: u32, v: u32| (u % around) * across + v % across;
    for u in 0..around {
        let (su, cu) = sin_cos(f64::from(u) / f64::from(around));
        for v in 0..across {
            let (sv, cv) = sin_cos(f64::from(v) / f64::from(across));
            let n = dvec3(cv * cu, cv * su, sv);
            positions.push((dvec3(cu, su, 0.0) + 0.4 * n).as_vec3());
            normals.push(n.as_vec3());
            triangles.push([at(u, v), at(u + 1, v), at(u + 1, v + 1)]);
            triangles.push([at(u, v), at(u + 1, v + 1), at(u, v + 1)]);
        }
    }
    closed(positions, normals, triangles)
}

fn closed(positions: Vec<Vec3>, normals: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> PointCloud {
    let mut cloud = PointCloud { positions, normals: Some(normals), closed: true, ..Default::default() };
    cloud.mesh = Some(Mesh { triangles });
    cloud.report.points_in_file = cloud.len() as u64;
    "synthetic mesh".clone_into(&mut cloud.report.format);
    cloud
}
