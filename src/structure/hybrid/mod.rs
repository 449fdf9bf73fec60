//! Triangles near the viewer, points beyond (Dachsbacher, Vogelgsang, Stamminger: Sequential Point Trees, 2003, section 3.8).
//!
//! A triangle of size s is drawn, fragment by fragment, where that is larger than the threshold: up to distance s / τ. Its
//! corners are the points of a [`Sequential`] tree; each has for an error of its own the least s of its faces, less τ_max times
//! its covering radius ρ, from which it is needed on.
//!
//! *Size* is the longest side, as published, but no less than the least, over the corners, of the longest side of any face there:
//! a sliver among large triangles is drawn as long as they are. By its own side it would end before them, and the splats of
//! its corners, which are as wide as the large ones, would lie over these.
//!
//! *No hole*, for τ ≤ τ_max: a place of the surface at distance r where its triangle is not drawn, s ≤ τ r, is covered by a
//! corner's disk, at most ρ away. The corner's error is at most s − τ_max ρ ≤ τ r − τ ρ, and it is at least r − ρ from the eye: it
//! passes, so that it or what stands for it is drawn. For larger τ a strip of at most ρ (1 − τ_max / τ) may be left open.

mod file;
mod triangles;

use crate::load::Mesh;
use crate::structure::file::Fnv;
use crate::structure::{Flat, Packing, Sequential, sequential};

pub use triangles::Triangles;

/// A mesh with levels of detail.
#[derive(Debug, Clone)]
pub struct Hybrid {
    /// What is drawn where triangles are smaller than the threshold; without what these stand for everywhere.
    pub tree: Sequential,
    /// The faces, by place and size.
    pub triangles: Triangles,
    /// Fingerprint of the faces that it was made of.
    pub mesh: u64,
}

/// Changes with the faces and their order.
fn fingerprint(mesh: &Mesh) -> u64 {
    let mut hash = Fnv::NEW;
    hash.add(bytemuck::cast_slice(&mesh.triangles));
    hash.0
}

impl Hybrid {
    /// Of a mesh over the points of a cloud. Without a face it is the tree alone.
    ///
    /// # Panics
    /// As [`Sequential::build`], and where a face has a corner beyond the last point.
    pub fn build(flat: &Flat, mesh: &Mesh, options: &sequential::Options) -> Hybrid {
        let mut errors = vec![f32::INFINITY; flat.len()];
        let sizes = triangles::sizes(flat, &mesh.triangles);
        for (face, size) in mesh.triangles.iter().zip(&sizes) {
            for &corner in face {
                let error = &mut errors[corner as usize];
                *error = error.min(*size);
            }
        }
        for (error, point) in errors.iter_mut().zip(&flat.geometry) {
            // A point of no face is always needed.
            *error = if *error < f32::INFINITY { *error - options.tau_max * point[3] } else { 0.0 };
        }
        let tree = Sequential::under(flat, options, &errors);
        Hybrid { tree, triangles: Triangles::new(flat.clone(), &mesh.triangles, &sizes), mesh: fingerprint(mesh) }
    }

    /// Whether it is what [`build`](Self::build) makes of this mesh over this cloud with these options: for what was
    /// [loaded](Self::load).
    pub fn is_of(&self, flat: &Flat, mesh: &Mesh, options: &sequential::Options) -> bool {
        self.tree.is_of(flat, options) && self.mesh == fingerprint(mesh)
    }

    /// The same over [packed](Flat::packed) points. Faces stay as they are.
    pub fn packed(self, packing: Packing) -> Hybrid {
        Hybrid { tree: self.tree.packed(packing), ..self }
    }

    /// Bytes of what a device needs.
    pub fn bytes(&self) -> u64 {
        self.tree.bytes() + self.triangles.bytes()
    }
}
