//! How splats look: footprints, tolerances, light. Independent of the technique that draws them.

use glam::Vec3;

use crate::technique::names;

/// What a point covers.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Footprint {
    /// A Gaussian disk of the covering radius r. For [`Blend::Opaque`](crate::technique::Blend::Opaque) a hard disc of
    /// radius r / √2.
    Splat,
    /// A square of so many pixels, whatever the radius; weight 1 all over. Only for `opaque`.
    Pixels(f32),
}

/// How a disk's outline on the screen is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Ellipse {
    /// The perspective image of the disk.
    Exact,
    /// The linear approximation about the centre, as in the shader of Coconu and Hege 2002, eqs 4 and 5.
    Approximate,
}

/// Depth tolerance ε = max(`absolute`, `relative` · max(r, what the low-pass spreads the splat over in depth)) \[world units\]: fragments no more than ε behind the front belong
/// to the same surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// \[world units\]
    pub absolute: f32,
    /// In units of the splat's radius.
    pub relative: f32,
}

impl Tolerance {
    /// Whether both are numbers and no splat's ε is 0: with less, no two splats are one surface.
    pub fn is_positive(&self) -> bool {
        let [a, r] = [self.absolute, self.relative];
        a.is_finite() && r.is_finite() && a.min(r) >= 0.0 && a.max(r) > 0.0
    }
}

/// What is done with splats that face away from the viewer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum BackFaces {
    /// Dropped where the cloud says that it is closed and all of it lies beyond the near plane, else drawn.
    Auto,
    /// Always drawn, lit from the viewer's side.
    Draw,
    /// Always dropped.
    Cull,
}

/// Light on the interpolated normal.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Shading {
    /// The colour as it is.
    None,
    /// A lamp at the eye: c · (ambient + (1 − ambient) · n·v).
    Headlight {
        /// Share of light that comes from everywhere, 0 to 1.
        ambient: f32,
    },
    /// A directional lamp and a highlight (Phong 1975).
    Phong {
        /// Towards the light, in eye space (x right, y up, z towards the viewer); normalised on use.
        light: Vec3,
        /// Share of light that comes from everywhere, 0 to 1.
        ambient: f32,
        /// Strength of the highlight, 0 to 1.
        specular: f32,
        /// Exponent of the highlight.
        shininess: f32,
    },
}

impl Shading {
    /// The lamp at the eye with a tenth of ambient light.
    pub const HEADLIGHT: Shading = Shading::Headlight { ambient: 0.1 };
    /// A lamp over the viewer's left shoulder.
    pub const PHONG: Shading =
        Shading::Phong { light: Vec3::new(-0.4, 0.6, 0.7), ambient: 0.15, specular: 0.25, shininess: 32.0 };
}

/// Format of the sums of colours and weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum SumPrecision {
    /// 32-bit floats, 16 B a pixel: n splats in a pixel are summed to n · 2⁻²⁴.
    #[default]
    Single,
    /// 16-bit floats, 8 B a pixel: n splats in a pixel are summed to n · 2⁻¹¹ at best, and not beyond a sum of weights of
    /// 2048 each. Measured (`tests/gpu/stress.rs`): within 1/255 up to a thousand splats in a pixel, a tenth of the full
    /// range off at three thousand. For devices that are short of bandwidth; normals and the front's depth stay in 32 bits.
    Half,
}

/// Which depth [`Blend::Fuzzy`](crate::technique::Blend::Fuzzy) keeps for a pixel while later fragments are blended in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Front {
    /// The nearest fragment's: the limit zd + ε only ever comes nearer, and what leaves the renderer is the front.
    #[default]
    Nearest,
    /// As published: that of the fragment that came first, so the band drifts with the order.
    First,
}

/// What decides between two splats of one group at one pixel, for [`Blend::Groups`](crate::technique::Blend::Groups).
///
/// Only where a group overlaps itself; elsewhere, and with `Off`, it is the depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Voronoi {
    /// The least z + min(ε, r) u, u the distance from the splat's centre in radii: splats become cones, whose lower envelope
    /// is the Voronoi diagram (Hoff et al. 1999). What lies farther behind than both ε and r never wins.
    #[default]
    Cones,
    /// As published (Zhang and Pajarola 2006, eqs 6 and 10): depth in slabs as thick as the tolerance, u within a slab.
    Slabs,
    /// The nearest depth: splats cut each other.
    Off,
}

/// Eye-dome lighting (Boucheny 2009): darkens a pixel by how far it lies behind its neighbours on the screen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EyeDome {
    /// Contrast; 1 is the default.
    pub strength: f32,
    /// Distance to the eight neighbours \[px\].
    pub radius: f32,
}

impl Default for EyeDome {
    fn default() -> Self {
        EyeDome { strength: 1.0, radius: 1.5 }
    }
}

/// Which entries of a sequential point tree's list are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Interval {
    /// Those that pass while their parent, seen from its own place, does not: no holes, and nothing twice.
    #[default]
    Exact,
    /// As published (Dachsbacher, Vogelgsang, Stamminger 2003, section 3.6): the parent's distance is the entry's, give or
    /// take the way between the two. No holes, but some entries are drawn along with their ancestors.
    Published,
}

/// Everything about the look of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Style {
    /// What a point covers.
    pub footprint: Footprint,
    /// How its outline is computed.
    pub ellipse: Ellipse,
    /// Depth tolerance of blends that have one.
    pub tolerance: Tolerance,
    /// Factor on all radii.
    pub radius_scale: f32,
    /// Smallest footprint radius ρ \[px\]: the low-pass.
    pub low_pass: f32,
    /// What faces away.
    pub back_faces: BackFaces,
    /// Light.
    pub shading: Shading,
    /// Eye-dome lighting, if wanted.
    pub eye_dome: Option<EyeDome>,
    /// sRGB-encoded colour of clouds that have none.
    pub base_color: [u8; 3],
    /// Precision of the sums.
    pub sums: SumPrecision,
    /// The front of `fuzzy`.
    pub front: Front,
    /// What decides within a group of `groups`.
    pub voronoi: Voronoi,
    /// Level of detail \[px\]: how large the error, or the spacing, of what stands for finer points may be in the picture's
    /// middle. More than 0; structures without levels ignore it.
    pub threshold: f32,
    /// Which entries of a sequential point tree are drawn.
    pub interval: Interval,
}

impl Style {
    /// What a footprint covers beyond its radius \[px\].
    pub(crate) fn footprint_margin(&self) -> f64 {
        match self.footprint {
            Footprint::Pixels(side) => 0.5 * side as f64,
            Footprint::Splat => self.low_pass as f64,
        }
    }
}

impl Default for Style {
    fn default() -> Self {
        Style {
            footprint: Footprint::Splat,
            ellipse: Ellipse::Exact,
            tolerance: Tolerance { absolute: 0.0, relative: 1.0 },
            radius_scale: 1.0,
            low_pass: 1.0,
            back_faces: BackFaces::Auto,
            shading: Shading::HEADLIGHT,
            eye_dome: None,
            base_color: [0xd0; 3],
            sums: SumPrecision::Single,
            front: Front::Nearest,
            voronoi: Voronoi::Cones,
            threshold: 1.0,
            interval: Interval::Exact,
        }
    }
}

names!(Ellipse { Exact = "exact", Approximate = "approximate" });
names!(SumPrecision { Single = "single", Half = "half" });
names!(Front { Nearest = "nearest", First = "first" });
names!(Voronoi { Cones = "cones", Slabs = "slabs", Off = "off" });
names!(Interval { Exact = "exact", Published = "published" });
