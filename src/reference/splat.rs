//! From a point of the draw list to a splat in eye space, or the reason why it is not drawn.

use glam::{DMat3, DVec2, DVec3};

use super::Scene;
use super::bound::{Bound, footprint};
use super::camera::Camera;
use super::face::{Corners, Face};
use super::groups::{Key, NO_GROUPS};
use crate::color::decode_table;
use crate::select::{Sight, Span};
use crate::structure::hybrid::Triangles;
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
    /// A triangle of which something may be drawn.
    Face(Box<Face>, Bound),
    /// A triangle that is not drawn.
    NoFace,
}

struct Object<'a> {
    flat: &'a Flat,
    triangles: Option<&'a Triangles>,
    /// The eye in the cloud's frame, and τ there.
    sight: Sight,
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
    /// Spans in the order in which they are drawn, and whether they are of triangles.
    runs: Vec<(Span, bool)>,
    /// Number of the first point or triangle of each, and the total.
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
                let extent = [scene.width * factor, scene.height * factor];
                let sight = Sight::new(scene.view, extent, &i.transform, i.flat.origin, scene.style);
                Object { flat: i.flat, triangles: i.triangles, sight, origin, linear, scale, in_front }
            })
            .collect();
        // An instance's triangles come before the first of its points.
        let mut triangles = scene.list.triangles.iter().peekable();
        let mut runs = Vec::new();
        for span in &scene.list.spans {
            while let Some(faces) = triangles.next_if(|faces| faces.instance <= span.instance) {
                runs.push((*faces, true));
            }
            runs.push((*span, false));
        }
        runs.extend(triangles.map(|faces| (*faces, true)));
        let mut starts = vec![0u32];
        for (span, _) in &runs {
            let total = starts[starts.len() - 1].checked_add(span.count);
            starts.push(total.expect("at most 2³² − 1 points a frame"));
        }
        let shape = match scene.style.footprint {
            // So many of the picture's own pixels.
            Footprint::Pixels(side) => Shape::Square { half: 0.5 * side as f64 * factor as f64 },
            Footprint::Splat => Shape::Disk { hard: scene.technique.blend == Blend::Opaque },
        };
        let key = (scene.technique.blend == Blend::Groups).then(|| Key::new(scene));
        Setup { scene, objects, runs, starts, camera, shape, low_pass: scene.style.low_pass as f64, margin, key }
    }

    /// Points and triangles submitted.
    pub fn len(&self) -> u32 {
        self.starts[self.starts.len() - 1]
    }

    /// Point or triangle `number` of the draw list.
    pub fn item(&self, number: u32) -> Fate {
        let (object, index, least) = self.find(number);
        match least {
            Some(least) => self.splat(object, index, least),
            None => match self.face(object, index).and_then(|face| face.bound(self).map(|bound| (face, bound))) {
                Some((face, bound)) => Fate::Face(Box::new(face), bound),
                None => Fate::NoFace,
            },
        }
    }

    fn face(&self, object: &Object, index: usize) -> Option<Face> {
        let triangles = object.triangles.expect("triangles of a draw list are a hybrid's");
        let (flat, corners) = (&triangles.vertices, triangles.corners[index]);
        let positions = corners.map(|i| flat.position(i).as_dvec3());
        let normal = |i: u32| flat.normals.as_ref().and_then(|n| octahedral::decode(n[i as usize]));
        let eye = object.sight.eye;
        // Counter-clockwise from outside, in the cloud's own frame: eye space may be mirrored.
        let [a, b, c] = positions;
        let away = (b - a).cross(c - a).dot(a * eye.w - eye.truncate()) > 0.0;
        if away && flat.normals.is_some() && self.culls(object) {
            return None;
        }
        let of = Corners {
            eye_space: positions.map(|p| object.origin + object.linear * p),
            places: positions.map(|p| p * eye.w - eye.truncate()),
            normals: corners.map(|i| normal(i).map_or(DVec3::ZERO, |n| (object.linear * n).normalize())),
            colors: corners.map(|i| color(flat, i as usize, self.scene.style.base_color)),
            size: triangles.sizes[index],
        };
        let scale = self.scene.style.radius_scale as f64 * object.scale;
        Some(Face::new(of, object.sight.tau, scale))
    }

    /// Whether what faces away is dropped.
    fn culls(&self, object: &Object) -> bool {
        match self.scene.style.back_faces {
            BackFaces::Auto => object.flat.closed && object.in_front,
            BackFaces::Draw => false,
            BackFaces::Cull => true,
        }
    }

    /// The layer of point or triangle `number`: its group, or the one after all of them.
    pub fn layer(&self, number: u32) -> u32 {
        let (object, index, least) = self.find(number);
        if least.is_none() {
            return u32::MAX;
        }
        let groups = object.flat.groups.as_ref().expect(NO_GROUPS);
        let group = groups.of[index];
        assert!((group as u32) < groups.count, "group {group} of {}", groups.count);
        group as u32
    }

    /// The cloud of something in the draw list, its index there, and for points the least radius.
    fn find(&self, number: u32) -> (&Object<'a>, usize, Option<f32>) {
        let at = self.starts.partition_point(|&s| s <= number) - 1;
        let (span, triangles) = self.runs[at];
        let index = (span.first + (number - self.starts[at])) as usize;
        (&self.objects[span.instance as usize], index, (!triangles).then_some(span.least))
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
            drawn = !(self.culls(object) && facing < 0.0);
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
        let (epsilon, d_epsilon) = tolerance(self, splat);
        Look { epsilon, d_epsilon, color: color(object.flat, index, self.scene.style.base_color) }
    }
}

/// ε of a splat, and how far off rounding may be in it.
pub fn tolerance(setup: &Setup, splat: &Splat) -> (f64, f64) {
    let viewer = setup.camera.towards_viewer(splat.p);
    let cosine = splat.n.dot(viewer);
    // The low-pass spreads a splat over ρ pixels of its plane, tan θ times as deep as wide (83° at most): that is
    // its radius where it exceeds r.
    let slope = (1.0 - cosine.powi(2)).max(0.0).sqrt() / cosine.max(1e-6);
    let spread = match splat.screen {
        Some(at) => setup.low_pass * setup.camera.pixel_width(splat.p, at, viewer) * slope.clamp(1.0, 8.0),
        None => 0.0,
    };
    let tolerance = setup.scene.style.tolerance;
    let epsilon = (tolerance.absolute as f64).max(tolerance.relative as f64 * splat.r.max(spread));
    // tan θ of a steep splat is off by margin / cos θ relative to it.
    let d_epsilon = epsilon * setup.margin * (2.0 + 1.0 / cosine.max(0.1));
    (epsilon, d_epsilon)
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
