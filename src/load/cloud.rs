//! The one form in which points leave `load`: a structure of arrays about an f64 origin.

use glam::{DVec3, Vec3};

/// Points with what is known of them. All arrays that are present have [`PointCloud::len`] entries.
///
/// A position in the world is `origin + positions[i]`, the sum taken in f64.
#[derive(Debug, Clone, Default)]
pub struct PointCloud {
    /// World position \[world units\] that the offsets are relative to.
    pub origin: DVec3,
    /// Offsets from `origin` \[world units\], all finite.
    pub positions: Vec<Vec3>,
    /// Unit normals; a zero vector says that this point has none and faces the viewer.
    pub normals: Option<Vec<Vec3>>,
    /// Covering radii \[world units\]: neighbours of an even sampling lie about this far apart. Finite and > 0.
    pub radii: Option<Vec<f32>>,
    /// sRGB-encoded colours.
    pub colors: Option<Vec<[u8; 3]>>,
    /// Opacity, 0 to 1.
    pub opacity: Option<Vec<f32>>,
    /// Return strength in the file's own unit, not normalised; of E57 with limits, 0 to 1 between these.
    pub intensity: Option<Vec<f32>>,
    /// LAS classification codes.
    pub classes: Option<Vec<u8>>,
    /// Triangles over the points.
    pub mesh: Option<Mesh>,
    /// Which way is up, where the format says so (LAS and E57: +Z).
    pub up: Option<Vec3>,
    /// Where the scanner stood \[world units\], where the file says so.
    pub viewpoint: Option<DVec3>,
    /// Angle between neighbours in the scanner's grid, the wider of rows and columns \[rad\], where the file says so. Above 0
    /// and less than π/2.
    pub angular_step: Option<f32>,
    /// The surface is closed and all normals point out of it: what faces away is always hidden.
    pub closed: bool,
    /// What was read, dropped and assumed on the way.
    pub report: Report,
}

/// A triangle mesh over a cloud's points.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Indices into the points, counter-clockwise seen from outside; all in range.
    pub triangles: Vec<[u32; 3]>,
}

/// What happened between the file and the cloud. Nothing is lost without a line here.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Report {
    /// The format as read, such as `PLY binary little-endian` or `LAS 1.2 format 3`.
    pub format: String,
    /// Points that the file holds (or says it holds).
    pub points_in_file: u64,
    /// Points or faces left out: reason (such as `non-finite coordinates`) and how many.
    pub dropped: Vec<(String, u64)>,
    /// Repairs that kept the point: reason (such as `zero normals`) and how many.
    pub repaired: Vec<(String, u64)>,
    /// What was assumed where the file is silent, one sentence each.
    pub assumed: Vec<String>,
}

impl Report {
    /// Counts `n` points or faces left out for `reason`; nothing is noted for zero.
    pub fn drop(&mut self, reason: &str, n: u64) {
        count(&mut self.dropped, reason, n);
    }

    /// Counts `n` points kept with a repair; nothing is noted for zero.
    pub fn repair(&mut self, reason: &str, n: u64) {
        count(&mut self.repaired, reason, n);
    }

    /// Notes an assumption once.
    pub fn assume(&mut self, what: impl Into<String>) {
        let what = what.into();
        if !self.assumed.contains(&what) {
            self.assumed.push(what);
        }
    }
}

fn count(list: &mut Vec<(String, u64)>, reason: &str, n: u64) {
    if n == 0 {
        return;
    }
    match list.iter_mut().find(|(r, _)| r == reason) {
        Some((_, k)) => *k += n,
        None => list.push((reason.to_owned(), n)),
    }
}

impl PointCloud {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is no point at all.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// World position of point `i`.
    pub fn world(&self, i: usize) -> DVec3 {
        self.origin + self.positions[i].as_dvec3()
    }
}
