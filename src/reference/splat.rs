//! From a point of the draw list to a splat in eye space, or the reason why it is not drawn.

use glam::{DMat3, DVec2, DVec3};

use super::Scene;
use super::bound::{Bound, footprint};
use super::camera::Camera;
use super::groups::{Key, NO_GROUPS};
use crate::color::decode_table;
use crate::structure::{Flat, octahedral};
use crate::style::{BackFaces, Ellipse, Footprint};
use crate::technique::Blend;

/// What a splat covers.
#[derive(Clone, Copy)]
pub enum Shape {
    /// A disk with its low-pass; all weights 1 if `hard`.
    Disk { hard: bool },
    /// A square, half its side in pixels.
    Square { half: f64 },
}

/// A splat in eye space.
pub struct Splat {
    /// Centre.
    pub p: DVec3,
    /// Unit normal on the viewer's side.
    pub n: DVec3,
    /// Radius of the footprint.
    pub r: f64,
    /// Linear depth of the centre.
    pub z: f64,
    /// Projected centre \[px\], where the centre is not before the near plane.
    pub screen: Option<DVec2>,
    /// The affine form's direction: the ray through the centre, per unit of linear depth. `None`: exact form.
    pub affine: Option<DVec3>,
    /// Not dropped.
    pub drawn: bool,
    /// Rounding cannot turn it to the other side.
    pub sure: bool,
}

/// What a splat's fragments carry, beside their place.
pub struct Look {
    /// Depth tolerance ε.
    pub epsilon: f64,
    /// How far off rounding may be in it.
    pub d_epsilon: f64,
    /// Linear colour.
    pub color: DVec3,
}

/// What becomes of a point.
pub enum Fate {
    Invalid,
    /// Facing away. Where rounding may see that otherwise the splat comes along (with `drawn` false), for the ties.
    Away(Option<(Splat, Bound)>),
    Outside,
    Drawn(Splat, Bound),
}

struct Object<'a> {
    flat: &'a Flat,
    /// Eye-space position of the cloud's origin: rounded once for all points, at the precision of the origin.
    origin: DVec3,
    /// Eye from cloud without translation.
    linear: DMat3,
    scale: f64,
    /// All of it lies beyond the near plane, so a closed surface is seen from outside and whole.
    in_front: bool,
}

/// The frame's constants.
pub struct Setup<'a> {
    scene: &'a Scene<'a>,
    objects: Vec<Object<'a>>,
    /// Number of the first point of each span, and the total.
    starts: Vec<u32>,
    pub camera: Camera,
    pub shape: Shape,
    /// ρ \[samples\]
    pub low_pass: f64,
    pub margin: f64,
    /// What decides within a layer of groups.
    pub key: Option<Key>,
}

impl<'a> Setup<'a> {
    /// Of the scene with both sides of the picture `factor` times as long.
    pub fn new(scene: &'a Scene<'a>, factor: u32, margin: f64) -> Setup<'a> {
        let camera = Camera::new(scene.view, scene.width * factor, scene.height * factor);
        let objects = scene
            .instances
            .iter()
            .map(|i| {
                let linear = DMat3::from_mat4(i.transform);
                let origin = camera.eye(i.transform.transform_point3(i.flat.origin));
                let scale = linear.determinant().abs().cbrt();
                let linear = camera.rotation * linear;
                let in_front = i.flat.surface().all(|b| {
                    let reach = b.radius as f64 * scene.style.radius_scale as f64 * scale;
                    (0..8).all(|corner| {
                        let pick = |axis: usize| if corner >> axis & 1 == 0 { b.min[axis] } else { b.max[axis] } as f64;
                        -(origin + linear * DVec3::new(pick(0), pick(1), pick(2))).z - reach >= camera.near
                    })
                });
                Object { flat: i.flat, origin, linear, scale, in_front }
            })
            .collect();
        let mut starts = vec![0u32];
        for span in &scene.list.spans {
            let total = starts[starts.len() - 1].checked_add(span.count);
            starts.push(total.expect("at most 2³² − 1 points a frame"));
        }
        let shape = match scene.style.footprint {
            // So many of the picture's own pixels.
            Footprint::Pixels(side) => Shape::Square { half: 0.5 * side as f64 * factor as f64 },
            Footprint::Splat => Shape::Disk { hard: scene.technique.blend == Blend::Opaque },
        };
        let key = (scene.technique.blend == Blend::Groups).then(|| Key::new(scene));
        Setup { scene, objects, starts, camera, shape, low_pass: scene.style.low_pass as f64, margin, key }
    }

    /// Points submitted.
    pub fn len(&self) -> u32 {
        self.starts[self.starts.len() - 1]
    }

    /// Point `number` of the draw list.
    pub fn point(&self, number: u32) -> Fate {
        let (object, index, least) = self.find(number);
        self.splat(object, index, least)
    }

    /// The group of point `number`.
    pub fn group(&self, number: u32) -> u8 {
        let (object, index, _) = self.find(number);
        let groups = object.flat.groups.as_ref().expect(NO_GROUPS);
        let group = groups.of[index];
        assert!((group as u32) < groups.count, "group {group} of {}", groups.count);
        group
    }

    /// The cloud of a point of the draw list, its index there, and its least radius.
    fn find(&self, number: u32) -> (&Object<'a>, usize, f32) {
        let at = self.starts.partition_point(|&s| s <= number) - 1;
        let span = self.scene.list.spans[at];
        (&self.objects[span.instance as usize], (span.first + (number - self.starts[at])) as usize, span.least)
    }

    fn splat(&self, object: &Object, index: usize, least: f32) -> Fate {
        let style = self.scene.style;
        let [x, y, z, radius] = object.flat.point(index as u32);
        let p = object.origin + object.linear * DVec3::new(x as f64, y as f64, z as f64);
        let scale = style.radius_scale as f64 * object.scale;
        let valid = radius > 0.0 && (radius as f64 * scale).is_finite() && scale > 0.0;
        let r = radius.max(least) as f64 * scale;
        if !(p.is_finite() && valid) {
            return Fate::Invalid;
        }

        let viewer = self.camera.towards_viewer(p);
        let code = object.flat.normal(index as u32);
        let (mut n, mut drawn, mut sure) = (viewer, true, true);
        if let Some(normal) = octahedral::decode(code) {
            n = (object.linear * normal).normalize();
            let facing = n.dot(viewer);
            let cull = match style.back_faces {
                BackFaces::Auto => object.flat.closed && object.in_front,
                BackFaces::Draw => false,
                BackFaces::Cull => true,
            };
            drawn = !(cull && facing < 0.0);
            // Two unit vectors, each with its own error.
            sure = facing.abs() >= 2.0 * self.margin;
            if facing < 0.0 {
                n = -n;
            }
            if !drawn && sure {
                return Fate::Away(None);
            }
        }

        let depth = -p.z;
        let screen = (depth >= self.camera.near).then(|| self.camera.project(p));
        let mut splat = Splat {
            p,
            n,
            r: if matches!(self.shape, Shape::Disk { hard: true }) { r * std::f64::consts::FRAC_1_SQRT_2 } else { r },
            z: depth,
            screen,
            affine: None,
            drawn,
            sure,
        };
        if let (Ellipse::Approximate, Some(at)) = (style.ellipse, screen) {
            // Only for disks that do not reach the near plane.
            if splat.z - splat.depth_extent() >= self.camera.near {
                splat.affine = Some(self.camera.ray(at).direction);
            }
        }
        let bound = footprint(self, &splat);
        match (bound, drawn) {
            (None, true) => Fate::Outside,
            (None, false) => Fate::Away(None),
            (Some(bound), true) => Fate::Drawn(splat, bound),
            (Some(bound), false) => Fate::Away(Some((splat, bound))),
        }
    }
}

impl Setup<'_> {
    /// What the fragments of point `number` carry; `splat` is what it became.
    pub fn look(&self, number: u32, splat: &Splat) -> Look {
        let (object, index, _) = self.find(number);
        let viewer = self.camera.towards_viewer(splat.p);
        let cosine = splat.n.dot(viewer);
        // The low-pass spreads a splat over ρ pixels of its plane, tan θ times as deep as wide (83° at most): that is
        // its radius where it exceeds r.
        let slope = (1.0 - cosine.powi(2)).max(0.0).sqrt() / cosine.max(1e-6);
        let spread = match splat.screen {
            Some(at) => self.low_pass * self.camera.pixel_width(splat.p, at, viewer) * slope.clamp(1.0, 8.0),
            None => 0.0,
        };
        let tolerance = self.scene.style.tolerance;
        let epsilon = (tolerance.absolute as f64).max(tolerance.relative as f64 * splat.r.max(spread));
        // tan θ of a steep splat is off by margin / cos θ relative to it.
        let d_epsilon = epsilon * self.margin * (2.0 + 1.0 / cosine.max(0.1));
        Look { epsilon, d_epsilon, color: color(object.flat, index, self.scene.style.base_color) }
    }
}

impl Splat {
    /// Half the range of depths of the disk.
    pub fn depth_extent(&self) -> f64 {
        self.r * self.n.truncate().length()
    }
}

fn color(flat: &Flat, index: usize, base: [u8; 3]) -> DVec3 {
    let table = decode_table();
    let [r, g, b] = flat.color(index as u32).unwrap_or(base);
    DVec3::new(table[r as usize], table[g as usize], table[b as usize])
}
