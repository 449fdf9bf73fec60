//! In which order points are stored: what blends that depend on the order make of it, and what caches do.

use glam::{DVec3, Vec3};

use super::Flat;
use crate::rng::Rng;
use crate::technique::names;

/// An order of storage. Points that tie stay in the order that they had.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Arrangement {
    /// As they are.
    #[default]
    AsRead,
    /// Along the Morton curve through the bounds (21 bits an axis): neighbours in space are neighbours in memory.
    Morton,
    /// Shuffled.
    Random,
    /// Nearest to the viewer first: for one view.
    FrontToBack,
    /// Farthest from the viewer first: for one view.
    BackToFront,
}

names!(Arrangement {
    AsRead = "as-read",
    Morton = "morton",
    Random = "random",
    FrontToBack = "front-to-back",
    BackToFront = "back-to-front",
});

impl Arrangement {
    /// Whether it is for one view.
    pub fn needs_view(self) -> bool {
        matches!(self, Arrangement::FrontToBack | Arrangement::BackToFront)
    }
}

impl Flat {
    /// The same points in another order. `depth` is the linear depth of a point of the world \[world units\], asked for only
    /// where the order [needs a view](Arrangement::needs_view). The same bytes for the same input.
    pub fn arranged(&self, how: Arrangement, depth: impl Fn(DVec3) -> f64) -> Flat {
        let world = |[x, y, z, _]: [f32; 4]| self.origin + DVec3::new(x as f64, y as f64, z as f64);
        // Floats in the order of their bits, negative ones turned round.
        let sortable = |z: f64| {
            let bits = z.to_bits();
            if bits >> 63 == 0 { bits | 1 << 63 } else { !bits }
        };
        let mut random = Rng::new(1);
        let [low, high] = self.bounds().map(|p| p.as_vec3());
        let keys = self.geometry.iter().map(|&g| match how {
            Arrangement::AsRead => 0,
            Arrangement::Morton => morton(Vec3::new(g[0], g[1], g[2]), low, high),
            Arrangement::Random => random.bits(),
            Arrangement::FrontToBack => sortable(depth(world(g))),
            Arrangement::BackToFront => !sortable(depth(world(g))),
        });
        let mut order: Vec<(u64, u32)> = keys.zip(0..).collect();
        order.sort_unstable();
        fn pick<T: Copy>(order: &[(u64, u32)], from: &[T]) -> Vec<T> {
            order.iter().map(|&(_, i)| from[i as usize]).collect()
        }
        let geometry = pick(&order, &self.geometry);
        Flat {
            origin: self.origin,
            blocks: super::flat::blocks(&geometry),
            geometry,
            normals: self.normals.as_ref().map(|n| pick(&order, n)),
            colors: self.colors.as_ref().map(|c| pick(&order, c)),
            closed: self.closed,
            groups: self.groups.as_ref().map(|g| super::Groups { of: pick(&order, &g.of), ..g.clone() }),
        }
    }
}

/// Place on the Morton curve: 21 bits of every axis' place in the longest side of the bounds, interleaved. What is outside,
/// or no number, goes to the nearest end.
fn morton(p: Vec3, low: Vec3, high: Vec3) -> u64 {
    let side = (high - low).max_element().max(f32::MIN_POSITIVE) as f64;
    let place =
        |v: f32, low: f32| ((v as f64 - low as f64) / side * (1 << 21) as f64).clamp(0.0, ((1 << 21) - 1) as f64);
    // Two zero bits between each two (the usual shifts and masks, from 21 bits to 63).
    let spread = |v: f64| {
        let mut x = v as u64;
        for (shift, mask) in [
            (32, 0x001f_0000_0000_ffff),
            (16, 0x001f_0000_ff00_00ff),
            (8, 0x100f_00f0_0f00_f00f),
            (4, 0x10c3_0c30_c30c_30c3),
            (2, 0x1249_2492_4924_9249),
        ] {
            x = (x | x << shift) & mask;
        }
        x
    };
    spread(place(p.x, low.x)) | spread(place(p.y, low.y)) << 1 | spread(place(p.z, low.z)) << 2
}
