//! What a cloud's colours show: its own, or values made visible.

use anyhow::Result;
use glam::DVec3;

use surfel::load::{Bounds, PointCloud};

use super::args::ColorBy;
use super::palette;

/// Puts the chosen colours into every cloud, and says what was chosen.
///
/// A cloud without the values that are asked for keeps no colours: it is drawn in the base colour, and that is said.
pub fn paint(clouds: &mut [PointCloud], by: ColorBy, up: DVec3, bounds: &Bounds) -> Result<Vec<String>> {
    let mut said = Vec::new();
    let mut without = 0;
    match by {
        ColorBy::Rgb => without = clouds.iter().filter(|c| c.colors.is_none()).count(),
        ColorBy::Intensity => {
            let scale = Intensity::of(clouds.iter().filter_map(|c| c.intensity.as_deref()));
            for cloud in clouds.iter_mut() {
                cloud.colors = cloud.intensity.as_ref().map(|list| list.iter().map(|&v| scale.grey(v)).collect());
                without += cloud.colors.is_none() as usize;
            }
            if without < clouds.len() {
                let Intensity { low, high, gamma } = scale;
                said.push(format!(
                    "intensity {low} to {high} (1st to 99th percentile) is black to white, gamma {gamma:.2}"
                ));
            }
        }
        ColorBy::Class => {
            for cloud in clouds.iter_mut() {
                cloud.colors = cloud.classes.as_ref().map(|list| list.iter().map(|&c| palette::class(c)).collect());
                without += cloud.colors.is_none() as usize;
            }
        }
        ColorBy::Height => {
            let [low, high] = heights(bounds, up);
            let scale = if high > low { 1.0 / (high - low) } else { 0.0 };
            for cloud in clouds.iter_mut() {
                let base = cloud.origin.dot(up) - low;
                let color = |p: &glam::Vec3| palette::ramp((p.as_dvec3().dot(up) + base) * scale);
                cloud.colors = Some(cloud.positions.iter().map(color).collect());
            }
            said.push(format!("height {low:.6} to {high:.6} along up is dark to bright"));
        }
        ColorBy::Normal => {
            for cloud in clouds.iter_mut() {
                let color = |n: &glam::Vec3| n.to_array().map(|v| ((v * 0.5 + 0.5) * 255.0).round() as u8);
                cloud.colors = cloud.normals.as_ref().map(|list| list.iter().map(color).collect());
                without += cloud.colors.is_none() as usize;
            }
        }
    }
    if without > 0 {
        let what = match by {
            ColorBy::Rgb => "colours",
            ColorBy::Intensity => "intensities",
            ColorBy::Class => "classes",
            ColorBy::Height | ColorBy::Normal => "normals",
        };
        let which =
            if without == clouds.len() { String::new() } else { format!("{without} of {} clouds: ", clouds.len()) };
        said.push(format!("{which}no {what} in the input: drawn in one colour"));
    }
    Ok(said)
}

/// The robust box's extent along a direction.
fn heights(bounds: &Bounds, up: DVec3) -> [f64; 2] {
    let corner = |i: usize| {
        let pick = |axis: usize| if i >> axis & 1 == 0 { bounds.robust_min[axis] } else { bounds.robust_max[axis] };
        DVec3::new(pick(0), pick(1), pick(2)).dot(up)
    };
    (0..8).map(corner).fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], h| [low.min(h), high.max(h)])
}

/// How return strengths become grey.
struct Intensity {
    low: f32,
    high: f32,
    gamma: f64,
}

impl Intensity {
    /// From the 1st to the 99th percentile, bent so that half of the points are lighter than the middle grey: scanners
    /// differ by orders of magnitude in where most returns lie.
    fn of<'a>(lists: impl Iterator<Item = &'a [f32]>) -> Intensity {
        let lists: Vec<&[f32]> = lists.collect();
        let total: usize = lists.iter().map(|l| l.len()).sum();
        let step = total.div_ceil(200_000).max(1);
        let mut values: Vec<f32> =
            lists.iter().flat_map(|l| l.iter().step_by(step)).copied().filter(|v| v.is_finite()).collect();
        values.sort_unstable_by(f32::total_cmp);
        let Some(last) = values.len().checked_sub(1) else { return Intensity { low: 0.0, high: 1.0, gamma: 1.0 } };
        let at = |q: f64| values[(q * last as f64).round() as usize];
        let (low, middle, high) = (at(0.01), at(0.5), at(0.99));
        let t = (middle - low) as f64 / (high - low) as f64;
        let gamma = if t > 0.0 && t < 1.0 { (0.5f64.ln() / t.ln()).clamp(0.35, 1.5) } else { 1.0 };
        Intensity { low, high, gamma }
    }

    fn grey(&self, v: f32) -> [u8; 3] {
        let range = (self.high - self.low) as f64;
        let t = if range > 0.0 { ((v - self.low) as f64 / range).clamp(0.0, 1.0) } else { 0.6 };
        // Not down to black: the weakest returns must still be told from shadow.
        [(30.0 + 225.0 * t.powf(self.gamma)).round() as u8; 3]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn cloud() -> PointCloud {
        PointCloud {
            origin: DVec3::new(0.0, 0.0, 100.0),
            positions: (0..=10).map(|i| Vec3::new(i as f32, 0.0, i as f32)).collect(),
            ..Default::default()
        }
    }

    #[test]
    fn heights_go_along_up() {
        let mut clouds = [cloud()];
        let bounds = Bounds::of(&clouds[0]).unwrap();
        paint(&mut clouds, ColorBy::Height, DVec3::Z, &bounds).unwrap();
        let colors = clouds[0].colors.take().unwrap();
        assert_eq!((colors[0], colors[10]), (palette::ramp(0.0), palette::ramp(1.0)));
        paint(&mut clouds, ColorBy::Height, DVec3::NEG_Z, &bounds).unwrap();
        assert_eq!(clouds[0].colors.as_ref().unwrap()[10], palette::ramp(0.0));
        // Flat along y: no division by zero.
        paint(&mut clouds, ColorBy::Height, DVec3::Y, &bounds).unwrap();
    }

    #[test]
    fn intensities_fill_the_range() {
        let list: Vec<f32> = (0..1000).map(|i| (i as f32 / 999.0).powi(3) * 65535.0).collect();
        let scale = Intensity::of([list.as_slice()].into_iter());
        assert_eq!(scale.grey(0.0), [30; 3]);
        assert_eq!(scale.grey(1e9), [255; 3]);
        let middle = scale.grey(list[500])[0];
        assert!((middle as i32 - 142).abs() < 5, "{middle}");
        let constant = Intensity::of([[7.0f32; 5].as_slice()].into_iter());
        assert_eq!(constant.grey(7.0), [165; 3]);
        assert_eq!(Intensity::of(std::iter::empty()).gamma, 1.0);
    }

    #[test]
    fn what_is_missing_is_said() {
        let mut clouds = [cloud()];
        let bounds = Bounds::of(&clouds[0]).unwrap();
        for by in [ColorBy::Rgb, ColorBy::Intensity, ColorBy::Class, ColorBy::Normal] {
            let said = paint(&mut clouds, by, DVec3::Z, &bounds).unwrap();
            assert!(said.len() == 1 && said[0].starts_with("no "), "{said:?}");
        }
    }
}
