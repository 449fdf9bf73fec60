//! In which order points are stored: what blends that depend on the order make of it, and what caches do.

use glam::{DVec3, Vec3};

use super::Flat;
use super::morton::Cube;
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
    /// The same points in another order, [unpacked](Flat::unpacked). `depth` is the linear depth of a point of the world \[world units\], asked for only
    /// where the order [needs a view](Arrangement::needs_view). The same bytes for the same input.
    pub fn arranged(&self, how: Arrangement, depth: impl Fn(DVec3) -> f64) -> Flat {
        let full = self.unpacked();
        let world = |[x, y, z, _]: [f32; 4]| self.origin + DVec3::new(x as f64, y as f64, z as f64);
        // Floats in the order of their bits, negative ones turned round.
        let sortable = |z: f64| {
            let bits = z.to_bits();
            if bits >> 63 == 0 { bits | 1 << 63 } else { !bits }
        };
        let mut random = Rng::new(1);
        let [low, high] = self.bounds().map(|p| p.as_vec3());
        let cube = Cube::round(low, high);
        let keys = full.geometry.iter().map(|&g| match how {
            Arrangement::AsRead => 0,
            Arrangement::Morton => cube.code(Vec3::new(g[0], g[1], g[2])),
            Arrangement::Random => random.bits(),
            Arrangement::FrontToBack => sortable(depth(world(g))),
            Arrangement::BackToFront => !sortable(depth(world(g))),
        });
        let mut order: Vec<(u64, u32)> = keys.zip(0..).collect();
        order.sort_unstable();
        fn pick<T: Copy>(order: &[(u64, u32)], from: &[T]) -> Vec<T> {
            order.iter().map(|&(_, i)| from[i as usize]).collect()
        }
        let geometry = pick(&order, &full.geometry);
        Flat {
            origin: self.origin,
            blocks: super::flat::blocks(geometry.len(), |i| geometry[i]),
            geometry,
            normals: full.normals.as_ref().map(|n| pick(&order, n)),
            colors: full.colors.as_ref().map(|c| pick(&order, c)),
            closed: self.closed,
            finest: self.finest,
            packed: None,
            groups: self.groups.as_ref().map(|g| super::Groups { of: pick(&order, &g.of), ..g.clone() }),
        }
    }
}
