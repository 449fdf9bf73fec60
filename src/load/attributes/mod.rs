//! What a cloud's file does not say: normals and covering radii, from the faces or from the nearest neighbours.
//!
//! Everything runs on all of rayon's threads and gives the same bytes for any number of them. Beside the cloud it needs
//! about 100 bytes a point. Each assumption is noted once in the cloud's report.

#![forbid(unsafe_code)]

mod mesh;
pub mod neighbours;
mod normals;
mod orient;
mod radii;

use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::PointCloud;
use neighbours::{MAX_NEIGHBOURS, Neighbour, Tree};

/// Where radii come from.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum RadiusRule {
    /// The file's, else from the faces' edges, else from the density of the points.
    #[default]
    Auto,
    /// This for every point \[world units\], whatever the file says; finite and > 0.
    Value(f32),
    /// This times the automatic radius; finite and > 0.
    Scale(f32),
    /// A scanner's angular step \[rad\] times the distance from where it stood, so that neighbours in its grid just cover
    /// what lies across its rays (unprocessed scans, 2006, section 5, there by the farthest sample of a block). Some files
    /// tell it: [`PointCloud::angular_step`]. Without a viewpoint as `Auto`, which the report says. Finite and > 0.
    Angular(f32),
}

/// What [`complete`] may be told.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// Where radii come from.
    pub radius: RadiusRule,
    /// Neighbours that a normal is fitted to, from 3 to 32; radii always use 8. More is smoother: noise of σ in a
    /// neighbourhood of radius R tilts a normal by about 2 σ / (R √neighbours).
    pub neighbours: usize,
    /// Where the scanner stood \[world units\]; overrides the cloud's own.
    pub viewpoint: Option<DVec3>,
    /// Told the share done, 0 to 1, now and then and from any thread; two threads may overtake each other.
    pub progress: Option<&'a (dyn Fn(f32) + Sync)>,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Options { radius: RadiusRule::Auto, neighbours: 16, viewpoint: None, progress: None }
    }
}

/// Fills the normals and radii that `cloud` has not, and finds out whether its mesh is closed.
///
/// With faces, normals are weighted by the faces' angles and radii reach ¾ of the longest edge; vertices
/// without a face fall back on their neighbours. Without faces, normals are fitted to the nearest neighbours
/// and turned to the scanner where its place is known, else made consistent by propagation; radii are
/// κ d₈ √(π/8), where d₈ is the 8th neighbour's distance in the tangent plane and κ is 1 for even sampling to 1.6 for
/// random, or more where a gap demands it, guarded at borders, outliers and where there is no surface. A point whose neighbours give no
/// plane gets a zero normal: it faces the viewer. Radii are always finite and > 0: a cloud at one place has radius 1.
///
/// Positions must be finite, normals (where present) unit or zero, faces in range; at most 2²⁹ points.
pub fn complete(cloud: &mut PointCloud, options: &Options) {
    let keep_radii = cloud.radii.is_some();
    let scanner = options.viewpoint.or(cloud.viewpoint);
    let given = match options.radius {
        RadiusRule::Value(_) => true,
        RadiusRule::Angular(_) => scanner.is_some(),
        RadiusRule::Auto | RadiusRule::Scale(_) => false,
    };
    let (no_normals, no_radii) = (cloud.normals.is_none(), !keep_radii && !given);
    let faces = cloud.mesh.as_ref().is_some_and(|m| !m.triangles.is_empty());
    if faces {
        from_faces(cloud, options, no_normals, no_radii);
    } else if no_normals || no_radii {
        from_neighbours(cloud, options, no_normals, no_radii);
    }
    match options.radius {
        RadiusRule::Auto => {}
        RadiusRule::Value(value) => {
            cloud.radii = Some(vec![radii::usable(value); cloud.len()]);
            cloud.report.assume(format!("all radii set to {value}"));
        }
        RadiusRule::Scale(scale) => {
            for r in cloud.radii.iter_mut().flatten() {
                *r = radii::usable(*r * scale);
            }
            cloud.report.assume(format!("radii scaled by {scale}"));
        }
        RadiusRule::Angular(step) => match scanner {
            Some(scanner) => {
                let from = scanner - cloud.origin;
                let radius = |p: &Vec3| radii::usable((step as f64 * (p.as_dvec3() - from).length()) as f32);
                cloud.radii = Some(cloud.positions.par_iter().map(radius).collect());
                cloud.report.assume(format!("radii from the scanner's angular step of {step} rad"));
            }
            None => cloud.report.assume("where the scanner stood is not known: radii as if no angular step were given"),
        },
    }
    if let Some(progress) = options.progress {
        progress(1.0);
    }
}

fn from_faces(cloud: &mut PointCloud, options: &Options, no_normals: bool, no_radii: bool) {
    let Some(mesh) = &cloud.mesh else { return };
    let vertices = mesh::vertices(&cloud.positions, mesh);
    let mut normals: Vec<Vec3> = match cloud.normals.take() {
        Some(normals) => normals,
        None => vertices.par_iter().map(|v| v.normal).collect(),
    };
    cloud.closed = mesh::closed(&cloud.positions, mesh, &normals, &vertices);
    let bare = |v: &mesh::Vertex| v.radius <= 0.0 || v.normal == Vec3::ZERO;
    let loose = vertices.par_iter().filter(|v| bare(v)).count();
    let mut all_radii: Vec<f32> = vertices.par_iter().map(|v| v.radius).collect();
    if loose > 0 && (no_normals || no_radii) {
        let fitted = fit(cloud, options, if no_normals { None } else { Some(&normals) });
        for (i, v) in vertices.iter().enumerate().filter(|(_, v)| bare(v)) {
            if no_normals {
                normals[i] = fitted.normals[i];
            }
            if v.radius <= 0.0 {
                all_radii[i] = fitted.radii[i];
            }
        }
    }
    if no_normals {
        cloud.report.assume("normals averaged from the faces by angle");
    }
    if no_radii {
        cloud.report.assume("radii from the faces: 3/4 of the longest edge, at least the spacing");
        all_radii.par_iter_mut().for_each(|r| *r = radii::usable(*r));
        cloud.radii = Some(all_radii);
    }
    if no_normals || no_radii {
        cloud.report.repair("vertices without a face, completed from their neighbours", loose as u64);
    }
    cloud.normals = Some(normals);
}

fn from_neighbours(cloud: &mut PointCloud, options: &Options, no_normals: bool, no_radii: bool) {
    let given = cloud.normals.take();
    let fitted = fit(cloud, options, given.as_deref());
    if no_normals {
        let k = clamped(options.neighbours);
        let side = fitted.side;
        cloud.report.assume(format!("normals estimated from {k} nearest neighbours, {side}"));
        let none = fitted.normals.par_iter().filter(|n| **n == Vec3::ZERO).count();
        cloud.report.repair("no plane through the neighbours: faces the viewer", none as u64);
    }
    if no_radii {
        cloud.report.assume("radii from the distance of the 8th neighbour and the gaps between neighbours");
        cloud.radii = Some(fitted.radii);
    }
    cloud.normals = given.or(Some(fitted.normals));
}

/// What the neighbours say.
struct Fitted {
    /// Empty if normals were given.
    normals: Vec<Vec3>,
    radii: Vec<f32>,
    side: &'static str,
}

/// One distinct point while it is worked on, in tree order: 48 bytes.
#[derive(Clone, Copy)]
struct Work {
    normal: Vec3,
    radius: f32,
    near: [u32; radii::K],
}

impl radii::Spaced for Work {
    fn radius(&self) -> f32 {
        self.radius
    }

    fn near(&self) -> &[u32; radii::K] {
        &self.near
    }
}

impl orient::Facing for Work {
    fn normal(&self) -> Vec3 {
        self.normal
    }

    fn flip(&mut self) {
        self.normal = -self.normal;
    }

    fn near(&self) -> &[u32; radii::K] {
        &self.near
    }
}

fn clamped(neighbours: usize) -> usize {
    neighbours.clamp(3, MAX_NEIGHBOURS)
}

fn fit(cloud: &PointCloud, options: &Options, given: Option<&[Vec3]>) -> Fitted {
    let mut tree = Tree::new(&cloud.positions);
    let mut work = vec![Work { normal: Vec3::ZERO, radius: 0.0, near: [radii::NO_ONE; radii::K] }; tree.len()];
    let k = clamped(options.neighbours);
    let visit = |rank: usize, found: &[Neighbour], out: &mut Work| {
        let p = tree.position(rank);
        // The other side of a thin part is no neighbour on the surface, unless too few are left to tell.
        let own_side = |n: &&Neighbour| match given {
            Some(normals) if cloud.closed => normals[tree.index(n.rank())].dot(normals[tree.index(rank)]) >= 0.0,
            _ => true,
        };
        let all = found.iter().filter(own_side).count() < radii::K;
        let mut offsets = [Vec3::ZERO; MAX_NEIGHBOURS];
        let mut count = 0;
        for n in found.iter().filter(|n| all || own_side(n)) {
            offsets[count] = tree.position(n.rank()) - p;
            count += 1;
        }
        let offsets = &offsets[..count];
        out.normal = match given {
            Some(normals) => normals[tree.index(rank)],
            None => normals::plane_normal(&offsets[..k.min(offsets.len())], p.abs().max_element()),
        };
        out.radius = radii::radius(offsets, out.normal);
        for (near, n) in out.near.iter_mut().zip(found) {
            *near = n.rank() as u32;
        }
    };
    let finished = AtomicUsize::new(0);
    let total = tree.len().max(1);
    let done = |n: usize| {
        let finished = finished.fetch_add(n, Ordering::Relaxed) + n;
        if let Some(progress) = options.progress {
            // The build before and the orientation after take about a tenth each.
            progress(0.1 + 0.8 * finished as f32 / total as f32);
        }
    };
    // At least 16: the border guard needs more than the rule's 8.
    tree.search(k.max(2 * radii::K), &mut work, visit, done);
    tree.end_search();

    let found = radii::guarded(&work);
    let mut side = "";
    if given.is_none() {
        let position = |rank: usize| tree.position(rank);
        if let Some(viewpoint) = options.viewpoint.or(cloud.viewpoint) {
            orient::toward(&mut work, position, viewpoint - cloud.origin);
            side = "oriented to the scanner";
        } else {
            orient::propagate(&mut work, position, |rank| found[rank] * found[rank], cloud.up);
            side = "oriented consistently, upward or outward";
        }
    }
    scatter(&tree, &work, &found, cloud.len(), given.is_none(), side)
}

/// From tree order to the cloud's, copies included.
fn scatter(tree: &Tree, work: &[Work], found: &[f32], n: usize, normals: bool, side: &'static str) -> Fitted {
    let mut fitted = Fitted { normals: Vec::new(), radii: vec![radii::FALLBACK; n], side };
    if normals {
        fitted.normals = vec![Vec3::ZERO; n];
    }
    for (rank, work) in work.iter().enumerate() {
        let i = tree.index(rank);
        fitted.radii[i] = found[rank];
        if normals {
            fitted.normals[i] = work.normal;
        }
    }
    for &[copy, first] in tree.copies() {
        fitted.radii[copy as usize] = fitted.radii[first as usize];
        if normals {
            fitted.normals[copy as usize] = fitted.normals[first as usize];
        }
    }
    fitted
}
