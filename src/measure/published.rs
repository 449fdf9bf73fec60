//! Figures of the papers, to be printed beside our own.

use crate::technique::Structure;

/// Names of the columns of [`UNPROCESSED`], as the command line has them.
pub const VIEWPOINTS: [&str; 3] = ["distance", "border", "centre"];

/// Frames a second of structures for unprocessed scans from those viewpoints (sequential point trees in a view-frustum-culled
/// octree, 2006, table 1; OneVBO, the first, is every point in one buffer). What compares across twenty years is the ratio.
pub const UNPROCESSED: [(Structure, [f64; 3]); 6] = [
    (Structure::Flat, [15.0, 17.0, 18.0]),
    (Structure::OneSpt, [239.0, 12.0, 12.0]),
    (Structure::VboR, [15.0, 18.0, 228.0]),
    (Structure::SptR, [286.0, 21.0, 160.0]),
    (Structure::Espt, [378.0, 31.0, 240.0]),
    (Structure::Mospt, [300.0, 28.0, 228.0]),
];

/// How many times as fast as OneVBO a structure was from the viewpoint of this number; `None` for what was not published.
pub fn speedup(structure: Structure, viewpoint: usize) -> Option<f64> {
    let of = |s: Structure| UNPROCESSED.iter().find(|(name, _)| *name == s).map(|(_, fps)| fps[viewpoint]);
    Some(of(structure)? / of(Structure::Flat)?)
}
