//! The picture of meshes: rays through many places of every pixel, nothing approximated but by their number.

use glam::{DMat3, DMat4, DVec3, dvec2};

use super::Picture;
use super::camera::{Camera, Ray};
use super::mesh::{Hit, Surface};
use super::shade::{eye_dome, light};
use super::tiling::{self, Pixel};
use crate::select::View;
use crate::style::{BackFaces, Style};

/// Samples along a pixel's side that [`ray_cast`] is meant for: 16 a pixel.
pub const SAMPLES: u32 = 4;

/// Side of a tile \[px\]: a few thousand rays that meet the same part of the tree.
const TILE: u32 = 16;

/// One surface of a picture.
#[derive(Debug, Clone, Copy)]
pub struct MeshInstance<'a> {
    /// What is seen.
    pub surface: &'a Surface,
    /// World from the cloud's frame: a rotation, a uniform scale other than 0, a translation.
    pub transform: DMat4,
}

/// What a picture of meshes is made of.
#[derive(Debug, Clone, Copy)]
pub struct MeshScene<'a> {
    /// The surfaces; where two are equally near the first is seen.
    pub instances: &'a [MeshInstance<'a>],
    /// From where.
    pub view: &'a View,
    /// In pixels.
    pub width: u32,
    /// In pixels.
    pub height: u32,
    /// Light, base colour, back faces and eye-dome lighting; what is about splats has no meaning here.
    pub style: &'a Style,
}

/// Casts `samples` × `samples` rays a pixel ([`SAMPLES`] unless you know better).
///
/// The places are those of a sheared grid, (i + (j + ½)/n)/n and (j + (i + ½)/n)/n (Chiu, Shirley, Wang: Multi-Jittered
/// Sampling, 1994, before jittering): n² different columns and rows, so that edges along the picture's axes are as fine
/// as n² samples allow. They are symmetric about the centre.
///
/// A sample sees the nearest triangle beyond the near plane. Its colour is interpolated in linear light, the style's base
/// colour where the cloud has none; its normal is interpolated, normalised and turned to the viewer, as a splat's is, and
/// faces the viewer where the vertices have none. The light is that of [`render`](super::render). The pixel is the
/// mean: premultiplied linear light, coverage the share of samples that see anything, depth the lower median of theirs.
/// Eye-dome lighting follows on the pixels.
///
/// Faces that turn their outer side away are dropped for [`BackFaces::Cull`], where the outer side is the one that the
/// vertices' normals are on. For [`BackFaces::Auto`] nothing needs dropping: what closed surfaces would lose is behind
/// what they show.
///
/// The result does not depend on the number of threads. Its counts are zero, its ties false.
///
/// # Panics
/// If `samples` is 0.
pub fn ray_cast(scene: &MeshScene, samples: u32) -> Picture {
    assert!(samples > 0, "at least one sample a pixel");
    let camera = Camera::new(scene.view, scene.width, scene.height);
    let objects: Vec<Object> = scene.instances.iter().map(|i| Object::new(i, &camera)).collect();
    let n = samples as f64;
    let places: Vec<_> = (0..samples * samples)
        .map(|s| ((s % samples) as f64, (s / samples) as f64))
        .map(|(i, j)| dvec2((i + (j + 0.5) / n) / n, (j + (i + 0.5) / n) / n))
        .collect();
    let mut picture = tiling::picture(scene.width, scene.height, TILE, |_, [x0, y0, x1, y1]| {
        let mut stack = Vec::new();
        let mut seen = Vec::with_capacity(places.len());
        let pixels = (y0..y1).flat_map(|y| (x0..x1).map(move |x| dvec2(x as f64, y as f64)));
        pixels
            .map(|corner| {
                seen.clear();
                seen.extend(
                    places
                        .iter()
                        .map(|&place| sample(scene, &objects, &camera.ray(corner + place), camera.near, &mut stack)),
                );
                Pixel::mean(&seen)
            })
            .collect()
    });
    if let Some(style) = scene.style.eye_dome {
        eye_dome(&mut picture, style);
    }
    picture
}

/// An instance in eye space.
struct Object<'a> {
    surface: &'a Surface,
    /// Eye-space position of the surface's origin.
    origin: DVec3,
    /// Eye from surface without translation, and back.
    linear: DMat3,
    inverse: DMat3,
}

impl<'a> Object<'a> {
    fn new(instance: &MeshInstance<'a>, camera: &Camera) -> Object<'a> {
        let linear = camera.rotation * DMat3::from_mat4(instance.transform);
        let origin = camera.eye(instance.transform.transform_point3(instance.surface.origin));
        Object { surface: instance.surface, origin, linear, inverse: linear.inverse() }
    }

    /// The nearest hit beyond the near plane; its t is linear depth.
    fn hit(&self, ray: &Ray, near: f64, style: &Style, stack: &mut Vec<u32>) -> Option<Hit> {
        let origin = self.inverse * (ray.origin - self.origin);
        let direction = self.inverse * ray.direction;
        let faces = |hit: &Hit| {
            let (face, normal) = (self.surface.face_normal(hit.triangle), self.surface.normal(hit));
            face.dot(direction) * face.dot(normal) <= 0.0
        };
        match style.back_faces {
            BackFaces::Cull => self.surface.nearest(stack, origin, direction, near, faces),
            BackFaces::Auto | BackFaces::Draw => self.surface.nearest(stack, origin, direction, near, |_| true),
        }
    }
}

fn sample(scene: &MeshScene, objects: &[Object], ray: &Ray, near: f64, stack: &mut Vec<u32>) -> Pixel {
    let mut front: Option<(&Object, Hit)> = None;
    for object in objects {
        if let Some(hit) = object.hit(ray, near, scene.style, stack)
            && front.is_none_or(|(_, before)| hit.t < before.t)
        {
            front = Some((object, hit));
        }
    }
    let Some((object, hit)) = front else { return Pixel::EMPTY };
    let viewer = -ray.direction / ray.length;
    let mut normal = (object.linear * object.surface.normal(&hit)).try_normalize().unwrap_or(viewer);
    if normal.dot(viewer) < 0.0 {
        normal = -normal;
    }
    let color = object.surface.color(&hit).unwrap_or_else(|| base(scene.style));
    let (color, _) = light(&scene.style.shading, color, normal, ray, 0.0);
    Pixel { rgba: [color.x, color.y, color.z, 1.0], depth: hit.t, ..Pixel::EMPTY }
}

/// The style's base colour in linear light.
fn base(style: &Style) -> DVec3 {
    let table = crate::color::decode_table();
    DVec3::from(style.base_color.map(|byte| table[byte as usize]))
}
