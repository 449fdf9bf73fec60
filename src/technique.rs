//! What a frame is made of: one value on each of five independent axes.
//!
//! No technique is a renderer of its own. The papers, and combinations that none of them had, are rows of [`PRESETS`].

/// How the points are arranged in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Structure {
    /// One array in stored order, all of it drawn (OneVBO in the comparison of unprocessed scans, 2006).
    Flat,
    /// A point tree as a list, tested point by point by its error (Dachsbacher, Vogelgsang, Stamminger: Sequential Point
    /// Trees, 2003).
    Sequential,
    /// The same by the size of cells (OneSPT, 2006).
    OneSpt,
    /// A sequential tree with a mesh's triangles where those are larger than the threshold (2003, section 3.8).
    Hybrid,
    /// Patches of a model on disk or behind a server, as many as the view needs (Gobbetti, Marton: Layered Point Clouds, 2004).
    Layered,
    /// Blocks of points in an octree (VBOsR, 2006).
    VboR,
    /// Sequential lists in an octree (SPTsR, 2006).
    SptR,
    /// Blocks with averages and points by level (ESPTs, 2006).
    Espt,
    /// Blocks of original points by level (MOSPTs, 2006).
    Mospt,
    /// Blocks with points at the centres of cells, r³ to a cell (r-grids; 2006, section 3.2).
    RGrid,
    /// Blocks of original points by level, each level a Poisson-disk sample (after McCool, Fiume: Hierarchical Poisson disk
    /// sampling distributions, 1992).
    Poisson,
}

/// Which points of the structure are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Selection {
    /// What the view needs: of a flat array every point. Where a structure is tested point by point, the vertex stage does
    /// that (Dachsbacher, Vogelgsang, Stamminger: Sequential Point Trees, 2003, section 3.7).
    Vertex,
    /// The same, tested by compute passes that write the numbers of what is drawn, in order, for an indirect draw.
    Compute,
}

/// What the rasteriser is given for a splat.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Primitive {
    /// A point primitive of the footprint's size; footprints beyond the device's limit become quads.
    Point,
    /// Two triangles round the footprint's exact bound.
    Quad,
}

/// The order in which splats reach the framebuffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Order {
    /// As stored.
    Stored,
}

/// How fragments of one pixel become one colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Blend {
    /// The nearest fragment alone.
    Opaque,
    /// Visibility, then weighted sums of what lies within the tolerance of the front, then one division a pixel.
    #[default]
    TwoPass,
    /// Depth test and blending in one pass, fragment by fragment in the order of submission (Dachsbacher, Vogelgsang,
    /// Stamminger: Sequential Point Trees, 2003, section 5). Where a device has no ordered access to its attachments,
    /// [`TwoPass`](Blend::TwoPass) is drawn, and the statistics say so.
    Fuzzy,
    /// One layer for each group of splats that do not overlap, then a pass that sums the layers within the tolerance of the
    /// front (Zhang, Pajarola: Single-Pass Point Rendering and Transparent Shading, 2006, sections 3 and 5.1). Needs
    /// clouds with [`groups`](crate::structure::Flat::groups).
    Groups,
}

/// One value on each axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Technique {
    /// How the points are arranged: what clouds are built as. A renderer draws each [`Cloud`](crate::structure::Cloud) by the
    /// structure that it has.
    pub structure: Structure,
    /// Which are drawn.
    pub selection: Selection,
    /// As what.
    pub primitive: Primitive,
    /// In which order.
    pub order: Order,
    /// And how they are combined.
    pub blend: Blend,
}

impl Technique {
    /// Two passes over all points: no order, no groups, no optional feature. What splats are judged by.
    pub const TWO_PASS: Technique = Technique {
        structure: Structure::Flat,
        selection: Selection::Vertex,
        primitive: Primitive::Point,
        order: Order::Stored,
        blend: Blend::TwoPass,
    };

    /// The preset of this name, if there is one.
    pub fn named(name: &str) -> Option<Technique> {
        PRESETS.iter().find(|(n, _)| *n == name).map(|(_, t)| *t)
    }
}

const fn flat(blend: Blend, primitive: Primitive) -> Technique {
    Technique { blend, primitive, ..Technique::TWO_PASS }
}

/// Techniques by name: `structure.blend.primitive`. The first is the default: of those that blend, the fastest, at no more
/// error than any (docs/MEASURING.md).
pub const PRESETS: &[(&str, Technique)] = &[
    ("flat.fuzzy.point", flat(Blend::Fuzzy, Primitive::Point)),
    ("flat.fuzzy.quad", flat(Blend::Fuzzy, Primitive::Quad)),
    ("flat.two-pass.point", flat(Blend::TwoPass, Primitive::Point)),
    ("flat.two-pass.quad", flat(Blend::TwoPass, Primitive::Quad)),
    ("flat.groups.point", flat(Blend::Groups, Primitive::Point)),
    ("flat.groups.quad", flat(Blend::Groups, Primitive::Quad)),
    ("flat.opaque.point", flat(Blend::Opaque, Primitive::Point)),
    ("flat.opaque.quad", flat(Blend::Opaque, Primitive::Quad)),
];

impl Default for Technique {
    fn default() -> Self {
        PRESETS[0].1
    }
}

/// The names that the command line and the statistics use, one table a choice.
macro_rules! names {
    ($axis:ty { $($value:ident = $name:literal),* $(,)? }) => {
        impl $axis {
            /// Every value with its name.
            pub const ALL: &'static [(&'static str, Self)] = &[$(($name, Self::$value)),*];

            /// The value of this name.
            pub fn named(name: &str) -> Option<Self> {
                Self::ALL.iter().find(|(n, _)| *n == name).map(|(_, v)| *v)
            }

            /// This value's name.
            pub fn name(self) -> &'static str {
                match self { $(Self::$value => $name),* }
            }
        }
        impl std::fmt::Display for $axis {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }
    };
}

pub(crate) use names;

names!(Structure {
    Flat = "flat",
    Sequential = "sequential",
    Hybrid = "hybrid",
    Layered = "layered",
    OneSpt = "one-spt",
    VboR = "vbo-r",
    SptR = "spt-r",
    Espt = "espt",
    Mospt = "mospt",
    RGrid = "r-grid",
    Poisson = "poisson",
});
names!(Selection { Vertex = "vertex", Compute = "compute" });
names!(Primitive { Point = "point", Quad = "quad" });
names!(Order { Stored = "stored" });
names!(Blend { Opaque = "opaque", TwoPass = "two-pass", Fuzzy = "fuzzy", Groups = "groups" });
