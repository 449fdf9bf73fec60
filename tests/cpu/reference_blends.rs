//! The blends over all fragments of a pixel at once, for the oracle: written from the definitions.

use glam::DVec3;
use surfel::reference::Scene;
use surfel::select::Slabs;
use surfel::style::{Front, Style, Voronoi};

/// A splat at a pixel.
#[derive(Clone, Copy)]
pub struct Hit {
    pub z: f64,
    pub u: f64,
    pub epsilon: f64,
    pub radius: f64,
    pub color: DVec3,
    pub group: Option<u8>,
}

/// What is summed at a pixel, whether anything is hidden, and the front's depth, infinite where nothing is.
pub type Kept = (Vec<Hit>, bool, f64);

/// Over all that the nearest leaves: two-pass of all fragments, groups of the winners.
pub fn within_tolerance(hits: Vec<Hit>, host: f64) -> Kept {
    let limit = hits.iter().fold(host, |l, h| l.min(h.z + h.epsilon));
    let (kept, hidden): (Vec<Hit>, Vec<Hit>) = hits.into_iter().partition(|h| h.z <= limit);
    let front = kept.iter().map(|h| h.z).fold(f64::INFINITY, f64::min);
    (kept, !hidden.is_empty(), front)
}

/// Fragment by fragment, in this order.
pub fn fuzzy(hits: Vec<Hit>, host: f64, style: &Style) -> Kept {
    let (mut kept, mut hidden, mut zd, mut limit): (Vec<Hit>, _, _, _) = (vec![], false, f64::INFINITY, host);
    for hit in hits {
        let back = hit.z + hit.epsilon;
        if hit.z > limit {
            hidden = true;
        } else if back < zd {
            hidden |= !kept.is_empty();
            (kept, zd, limit) = (vec![hit], hit.z, host.min(back));
        } else {
            kept.push(hit);
            if style.front == Front::Nearest {
                (zd, limit) = (zd.min(hit.z), limit.min(back));
            }
        }
    }
    (kept, hidden, zd)
}

/// Group by group.
pub fn groups(hits: Vec<Hit>, host: f64, scene: &Scene) -> Kept {
    let overlapping = scene.instances.iter().any(|i| i.flat.groups.as_ref().unwrap().overlapping);
    let slabs = Slabs::new(scene.view, scene.style, scene.instances.iter().map(|i| (i.flat, i.transform)));
    let key = |h: &Hit| match scene.style.voronoi {
        Voronoi::Cones if overlapping => h.z + h.epsilon.min(h.radius) * h.u,
        Voronoi::Slabs if overlapping => -slabs.key(h.z, h.u),
        _ => h.z,
    };
    // Of equals `min_by` returns the first.
    let winner = |g: u8| hits.iter().filter(|h| h.group == Some(g)).min_by(|a, b| key(a).total_cmp(&key(b))).copied();
    within_tolerance((0..=255).filter_map(winner).collect(), host)
}
