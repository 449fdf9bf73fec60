//! One node: the averages of what is below it, and its errors.

use glam::{DVec3, Vec3};

use super::Options;
use super::error::{Errors, Part, inherited, up};
use crate::color::{decode_table, linear_to_srgb};
use crate::structure::nodes::{ErrorRule, NONE, Node};
use crate::structure::{Flat, octahedral};

/// A sum of n unit normals that is shorter than n times this has no direction.
const NO_DIRECTION: f64 = 1e-3;

/// A node with children.
pub struct Inner {
    pub node: Node,
    pub radius: f32,
    /// [`octahedral`] code.
    pub normal: u32,
    /// sRGB bytes.
    pub color: u32,
    /// Another inner node; [`NONE`] for the root.
    pub parent: u32,
    /// Steps from the root.
    pub level: u8,
}

/// What a parent needs to know of a child; lengths in cloud units.
#[derive(Clone, Copy)]
pub struct Child {
    pub leaf: bool,
    /// Among the leaves or the inner nodes of its part of the tree.
    pub id: u32,
    leaves: u32,
    /// Over the leaves: positions, normals, and colours in linear light.
    positions: DVec3,
    normals: DVec3,
    colors: DVec3,
    /// Least and greatest bytes of the leaves.
    dark: [u8; 3],
    bright: [u8; 3],
    /// As stored from here on.
    position: DVec3,
    radius: f64,
    normal: Option<DVec3>,
    error: f64,
    tangential: f64,
    /// Whether its error depends on the view.
    directed: bool,
    /// See [`Part`].
    above: f64,
    below: f64,
    inner: f64,
}

impl Child {
    /// No child.
    pub const NONE: Child = Child {
        leaf: true,
        id: NONE,
        leaves: 0,
        positions: DVec3::ZERO,
        normals: DVec3::ZERO,
        colors: DVec3::ZERO,
        dark: [255; 3],
        bright: [0; 3],
        position: DVec3::ZERO,
        radius: 0.0,
        normal: None,
        error: 0.0,
        tangential: 0.0,
        directed: false,
        above: 0.0,
        below: 0.0,
        inner: 0.0,
    };
}

/// Makes nodes for a cloud.
pub struct Maker<'a> {
    pub flat: &'a Flat,
    pub options: &'a Options,
}

impl Maker<'_> {
    pub fn leaf(&self, point: u32, id: u32) -> Child {
        let i = point as usize;
        let [x, y, z, radius] = self.flat.geometry[i];
        let position = Vec3::new(x, y, z).as_dvec3();
        let normal = self.flat.normals.as_ref().and_then(|n| octahedral::decode(n[i]));
        let mut child = Child { id, leaves: 1, positions: position, position, normal, ..Child::NONE };
        child.radius = radius as f64;
        child.inner = child.radius;
        child.normals = normal.unwrap_or_default();
        if let Some(colors) = &self.flat.colors {
            let [r, g, b, _] = colors[i].to_le_bytes();
            (child.dark, child.bright) = ([r, g, b], [r, g, b]);
            child.colors = linear([r, g, b]);
        }
        child
    }

    /// The node over some children, in a cell of this side.
    pub fn node(&self, children: &[Child], side: f64, id: u32) -> (Inner, Child) {
        let mut top = Child { leaf: false, id, ..Child::NONE };
        // A closed surface knows its outside. Elsewhere a normal may point either way: to the side of the clearest.
        let clearest = children
            .iter()
            .map(|c| c.normals)
            .fold(DVec3::ZERO, |a, b| if b.length_squared() > a.length_squared() { b } else { a });
        for child in children {
            top.leaves += child.leaves;
            top.positions += child.positions;
            top.colors += child.colors;
            let turn = !self.flat.closed && child.normals.dot(clearest) < 0.0;
            top.normals += if turn { -child.normals } else { child.normals };
            top.dark = std::array::from_fn(|k| top.dark[k].min(child.dark[k]));
            top.bright = std::array::from_fn(|k| top.bright[k].max(child.bright[k]));
        }
        let count = top.leaves as f64;
        // From here on as it is stored: what is rounded off is then within the errors.
        let position = (top.positions / count).as_vec3();
        top.position = position.as_dvec3();
        let clear = top.normals.length() > NO_DIRECTION * count;
        let normal = if clear { octahedral::encode(top.normals.normalize().as_vec3()) } else { octahedral::NONE };
        top.normal = octahedral::decode(normal);
        let apart = |c: &Child| (c.position - top.position).length();
        let radius = up(children.iter().map(|c| apart(c) + c.radius).fold(0.0, f64::max));
        top.radius = radius as f64;

        let varies = self.flat.colors.is_some() && {
            let mean = top.colors / count;
            let spread = (linear(top.bright) - mean).max(mean - linear(top.dark)).max_element();
            spread > self.options.color_error as f64
        };
        let own = self.own(&mut top, children).filter(|_| !varies);
        let test_normal = self.raise(&mut top, children, own, side);
        let node = Node {
            position: position.to_array(),
            error: top.error as f32,
            normal: test_normal.as_vec3().to_array(),
            tangential: top.tangential as f32,
        };
        let color = (top.colors / count).to_array().map(|v| (linear_to_srgb(v) * 255.0).round() as u8);
        let color = u32::from_le_bytes([color[0], color[1], color[2], 255]);
        (Inner { node, radius, normal, color, parent: NONE, level: 0 }, top)
    }

    /// e_p and e_t as geometry has them; `None` for a node without normal, of which nothing but the diameter is known.
    fn own(&self, top: &mut Child, children: &[Child]) -> Option<(f64, f64)> {
        let mut parts = [Part::default(); 8];
        for (part, c) in parts.iter_mut().zip(children) {
            let offset = c.position - top.position;
            *part = match self.options.published_errors {
                true => Part::disk(offset, c.normal, c.radius),
                false => {
                    Part { above: c.above, below: c.below, inner: c.inner, ..Part::disk(offset, c.normal, c.radius) }
                }
            };
        }
        let normal = top.normal?;
        let errors = Errors::over(normal, 2.0 * top.radius, &parts[..children.len()]);
        (top.above, top.below, top.inner) = (errors.above, errors.below, errors.inner);
        Some((errors.perpendicular(), errors.tangential))
    }

    /// Sets the errors: its own, where it has such, and what passing needs to be inherited by the children. Returns the
    /// normal to test by.
    fn raise(&self, top: &mut Child, children: &[Child], own: Option<(f64, f64)>, side: f64) -> DVec3 {
        let (tau_max, diameter) = (self.options.tau_max as f64, 2.0 * top.radius);
        let normal = top.normal.unwrap_or_default();
        let apart = |c: &Child| (c.position - top.position).length();
        let error = match self.options.rule {
            ErrorRule::Geometric => own.map_or(diameter, |(p, t)| p.hypot(t)),
            ErrorRule::Diameter => diameter,
            ErrorRule::Cell => side * 3f64.sqrt(),
            ErrorRule::Split => {
                if let Some((mut p, mut t)) = own {
                    for c in children.iter().filter(|c| !c.leaf) {
                        let normals = c.normal.filter(|_| c.directed).map(|n| (n, normal));
                        let (cp, ct) = inherited(c.error, c.tangential, normals, tau_max, apart(c));
                        (p, t) = (p.max(cp), t.max(ct));
                    }
                    let (p, t) = (up(p), up(t));
                    if (p as f64).hypot(t as f64) <= diameter {
                        (top.error, top.tangential, top.directed) = (p as f64, t as f64, true);
                        return normal;
                    }
                }
                // The diameter from everywhere, which is what the test makes of no normal. It meets every demand.
                top.error = diameter;
                return DVec3::ZERO;
            }
        };
        let demands = children.iter().filter(|c| !c.leaf).map(|c| c.error + tau_max * apart(c));
        let error = up(demands.fold(error, f64::max)) as f64;
        // Disks hold their children's, so the diameter meets every demand (tau_max ≤ 1/2).
        top.error = if self.options.rule == ErrorRule::Cell { error } else { error.min(diameter) };
        normal
    }
}

/// Linear light of sRGB bytes.
fn linear(color: [u8; 3]) -> DVec3 {
    DVec3::from_array(color.map(|byte| decode_table()[byte as usize]))
}
