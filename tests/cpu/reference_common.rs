//! Small scenes for the reference renderer.

use glam::{DMat4, DVec3, Vec3, dvec3};
use surfel::reference::{Instance, Picture, Scene, render};
use surfel::select::{DrawList, View};
use surfel::structure::{Flat, Groups, octahedral};
use surfel::style::{BackFaces, Shading, Style};
use surfel::technique::{Blend, Technique};

/// A scene of one cloud that owns what it needs.
#[derive(Clone)]
pub struct Small {
    pub flat: Flat,
    pub view: View,
    pub width: u32,
    pub height: u32,
    pub technique: Technique,
    pub style: Style,
    pub host: Option<Vec<f32>>,
}

impl Small {
    /// 8 × 8 pixels of one unit each, orthographic, the origin in the middle and at linear depth 5; near 1, far 9.
    /// No light, no low-pass, everything drawn.
    pub fn flat_view() -> Small {
        let projection = View::orthographic(8.0, 1.0, 1.0, 9.0);
        Small {
            flat: Flat { normals: Some(vec![]), colors: Some(vec![]), ..Flat::default() },
            view: View::look_at(dvec3(0.0, 0.0, 5.0), DVec3::ZERO, DVec3::Y, projection, Default::default()),
            width: 8,
            height: 8,
            technique: technique("flat.two-pass.point"),
            style: Style { low_pass: 0.0, shading: Shading::None, back_faces: BackFaces::Draw, ..Style::default() },
            host: None,
        }
    }

    /// 8 × 8 pixels, 90°, from the origin along −Z, near 1.
    pub fn wide_view() -> Small {
        let projection = View::perspective(std::f64::consts::FRAC_PI_2, 1.0, 1.0);
        let view = View { view: DMat4::IDENTITY, projection, depth: Default::default() };
        Small { view, ..Small::flat_view() }
    }

    /// One more splat; a zero normal is none.
    pub fn splat(mut self, p: [f32; 3], n: [f32; 3], r: f32, color: [u8; 3]) -> Small {
        self.flat.geometry.push([p[0], p[1], p[2], r]);
        self.flat.normals.as_mut().unwrap().push(octahedral::encode(Vec3::from(n)));
        let [red, green, blue] = color;
        self.flat.colors.as_mut().unwrap().push(u32::from_le_bytes([red, green, blue, 255]));
        self
    }

    pub fn style(mut self, change: impl FnOnce(&mut Style)) -> Small {
        change(&mut self.style);
        self
    }

    pub fn opaque(self) -> Small {
        self.blend(Blend::Opaque)
    }

    pub fn blend(mut self, blend: Blend) -> Small {
        self.technique.blend = blend;
        self
    }

    /// Drawn in groups: that of every splat, and whether they may overlap.
    pub fn groups(mut self, of: Vec<u8>, overlapping: bool) -> Small {
        let count = of.iter().max().map_or(0, |&g| g as u32 + 1);
        self.flat.groups = Some(grouped(of, count, overlapping));
        self.blend(Blend::Groups)
    }

    /// Calls `f` with the scene.
    pub fn with<T>(&self, f: impl FnOnce(&Scene) -> T) -> T {
        let list = DrawList::all([self.flat.len() as u32]);
        f(&Scene {
            instances: &[Instance::points(&self.flat, DMat4::IDENTITY)],
            list: &list,
            view: &self.view,
            width: self.width,
            height: self.height,
            technique: self.technique,
            style: &self.style,
            host_depth: self.host.as_deref(),
        })
    }

    pub fn render(&self) -> Picture {
        self.with(|scene| render(scene, 0.0))
    }
}

/// Groups made by hand; whatever else belongs to them is as it comes.
pub fn grouped(of: Vec<u8>, count: u32, overlapping: bool) -> Groups {
    let mut groups = Groups::default();
    (groups.of, groups.count, groups.overlapping) = (of, count, overlapping);
    groups
}

pub fn technique(name: &str) -> Technique {
    Technique::named(name).unwrap()
}

pub const WHITE: [u8; 3] = [255; 3];
pub const RED: [u8; 3] = [255, 0, 0];
pub const BLUE: [u8; 3] = [0, 0, 255];
pub const Z: [f32; 3] = [0.0, 0.0, 1.0];

/// Colour and coverage of a pixel.
pub fn at(picture: &Picture, x: u32, y: u32) -> [f64; 4] {
    picture.rgba[(y * picture.width + x) as usize]
}

pub fn depth_at(picture: &Picture, x: u32, y: u32) -> f64 {
    picture.depth[(y * picture.width + x) as usize]
}

/// Numbers from a seed (PCG's multiplier, upper bits).
pub struct Random(pub u64);

impl Random {
    /// Uniform from `low` to `high`.
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        low + (high - low) * ((self.0 >> 33) as f64 / (1u64 << 31) as f64)
    }
}
