//! Light on finished pixels.

use glam::DVec3;

use super::Picture;
use super::camera::Ray;
use crate::style::{EyeDome, Shading};

/// Depths below this count as this in eye-dome lighting's logarithms: orthographic views may have any depth.
const TINY: f64 = 1e-30;

/// Colour of a surface with linear colour `c` and eye-space mean normal `n` on `ray`, and whether rounding decides whether
/// there is a highlight. The mean's length, at most 1, scales what light comes from a direction: where normals disagree, at
/// silhouettes and in leaves, that is the mean of the splats' own diffuse light.
pub fn light(shading: &Shading, c: DVec3, n: DVec3, ray: &Ray, margin: f64) -> (DVec3, bool) {
    let v = -ray.direction / ray.length;
    let agreement = n.length();
    let n = n.try_normalize().unwrap_or(v);
    let (lit, tie) = match *shading {
        Shading::None => (c, false),
        Shading::Headlight { ambient } => (c * diffuse(ambient, agreement * n.dot(v)), false),
        Shading::Phong { light, ambient, specular, shininess } => {
            let l = light.as_dvec3().normalize_or_zero();
            let cosine = n.dot(l);
            let mut lit = c * diffuse(ambient, agreement * cosine);
            if cosine > 0.0 {
                let mirrored = 2.0 * cosine * n - l;
                lit += agreement * specular as f64 * mirrored.dot(v).max(0.0).powf(shininess as f64);
            }
            // Where the light grazes, the highlight sets in with a step.
            (lit, specular > 0.0 && cosine.abs() < 2.0 * margin)
        }
    };
    (lit.max(DVec3::ZERO), tie)
}

fn diffuse(ambient: f32, cosine: f64) -> f64 {
    let ambient = ambient as f64;
    ambient + (1.0 - ambient) * cosine.max(0.0)
}

/// Eye-dome lighting (Boucheny 2009): colour · exp(−100 · strength · s), s the mean over eight neighbours of
/// max(0, log₂ z − log₂ z_n). Neighbours outside the picture or without depth count 0.
pub fn eye_dome(picture: &mut Picture, style: EyeDome) {
    let (width, height) = (picture.width as i64, picture.height as i64);
    let (r, strength) = (style.radius as f64, style.strength as f64);
    let d = r * std::f64::consts::FRAC_1_SQRT_2;
    let offsets = [(r, 0.0), (-r, 0.0), (0.0, r), (0.0, -r), (d, d), (d, -d), (-d, d), (-d, -d)]
        .map(|(x, y): (f64, f64)| ((0.5 + x).floor() as i64, (0.5 + y).floor() as i64));
    let logarithms: Vec<f64> = picture.depth.iter().map(|z| z.max(TINY).log2()).collect();
    let ties = picture.ties.clone();
    for y in 0..height {
        for x in 0..width {
            let here = (y * width + x) as usize;
            let mut sum = 0.0;
            for (dx, dy) in offsets {
                let (nx, ny) = (x + dx, y + dy);
                if nx < 0 || ny < 0 || nx >= width || ny >= height {
                    continue;
                }
                let there = (ny * width + nx) as usize;
                picture.ties[here] |= ties[there];
                if picture.depth[here].is_finite() && picture.depth[there].is_finite() {
                    sum += (logarithms[here] - logarithms[there]).max(0.0);
                }
            }
            let factor = (-100.0 * strength * sum / 8.0).exp();
            for channel in &mut picture.rgba[here][..3] {
                *channel *= factor;
            }
        }
    }
}
