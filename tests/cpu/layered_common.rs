//! Layered point clouds in memory, small enough for oracles that look at everything.

use glam::{DMat4, DVec3, Vec3, dvec3};
use surfel::select::{DepthConvention, Sight, View};
use surfel::structure::layered::{Index, Node};
use surfel::structure::nodes::NONE;
use surfel::style::Style;

/// Numbers that are the same everywhere.
pub struct Random(pub u64);

impl Random {
    /// From 0 to 1.
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / (1u64 << 31) as f64
    }

    pub fn below(&mut self, n: usize) -> usize {
        ((self.unit() * n as f64) as usize).min(n - 1)
    }

    /// In the cube from −1 to 1.
    pub fn vector(&mut self) -> DVec3 {
        dvec3(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }
}

/// A sample: place and unit normal.
pub type Sample = (Vec3, Vec3);

/// An index, and the samples of each of its nodes.
pub struct Model {
    pub index: Index,
    pub samples: Vec<Vec<Sample>>,
}

/// What is known of a node before numbers are given.
struct Made {
    node: Node,
    samples: Vec<Sample>,
    /// All of it and its descendants.
    all: Vec<Sample>,
}

impl Model {
    /// A tree of patches of `m` samples out of `points`, which must be in random order. Spacing is the largest gap: no sample
    /// that is not drawn is farther than it from one that is, nor a drawn one from the nearest that would come. `published`
    /// is the square root of the share that is drawn.
    pub fn build(points: &[Sample], m: usize) -> Model {
        let mut made: Vec<Made> = Vec::new();
        split(points.to_vec(), m, NONE, 0, &mut made);
        for i in 0..made.len() {
            made[i].node.spacing = gap(&made, i);
        }
        // Never larger than the parent's, and something at leaves as well.
        for i in (1..made.len()).rev() {
            let (parent, spacing) = (made[i].node.parent as usize, made[i].node.spacing);
            made[parent].node.spacing = made[parent].node.spacing.max(spacing);
        }
        for i in 0..made.len() {
            let above = made.get(made[i].node.parent as usize).map_or(1.0, |p| p.node.spacing);
            if made[i].node.split == 3 {
                made[i].node.spacing = 0.5 * above;
            }
        }
        // By level, then by place.
        let mut order: Vec<usize> = (0..made.len()).collect();
        order.sort_by(|&a, &b| {
            let key = |i: usize| (made[i].node.level, made[i].node.centre.x, i);
            key(a).partial_cmp(&key(b)).unwrap()
        });
        let mut numbers = vec![0; made.len()];
        order.iter().enumerate().for_each(|(number, &i)| numbers[i] = number as u32);
        let number = |i: u32| if i == NONE { NONE } else { numbers[i as usize] };
        let mut at = 100;
        let mut index = Index { closed: true, normals: true, ..Index::default() };
        let mut samples = Vec::new();
        for i in order {
            let Made { mut node, samples: own, all: _ } = std::mem::replace(&mut made[i], empty());
            (node.parent, node.children) = (number(node.parent), node.children.map(number));
            (node.at, node.bytes) = (at, 40 + 5 * own.len() as u32);
            at += node.bytes as u64;
            index.nodes.push(node);
            samples.push(own);
        }
        Model { index, samples }
    }

    pub fn len(&self) -> usize {
        self.index.nodes.len()
    }

    /// The child whose region a place is in.
    pub fn below(&self, node: u32, p: Vec3) -> Option<u32> {
        let it = &self.index.nodes[node as usize];
        let side = (it.split < 3).then(|| usize::from(p[it.split as usize] >= it.plane))?;
        Some(it.children[side]).filter(|child| *child != NONE)
    }
}

fn empty() -> Made {
    let node = Node {
        centre: Vec3::ZERO,
        ball: 0.0,
        reach: 0.01,
        axis: Vec3::Z,
        cone: -1.0,
        spacing: 0.0,
        published: 0.0,
        split: 3,
        plane: 0.0,
        children: [NONE; 2],
        parent: NONE,
        level: 0,
        samples: 0,
        at: 0,
        bytes: 0,
        checksum: 0,
    };
    Made { node, samples: Vec::new(), all: Vec::new() }
}

fn split(points: Vec<Sample>, m: usize, parent: u32, level: u8, made: &mut Vec<Made>) -> u32 {
    let number = made.len() as u32;
    let (low, high) = points.iter().fold((points[0].0, points[0].0), |(l, h), (p, _)| (l.min(*p), h.max(*p)));
    let centre = 0.5 * (low + high);
    let far = points.iter().map(|(p, _)| p.as_dvec3().distance(centre.as_dvec3())).fold(0.0, f64::max);
    let sum: DVec3 = points.iter().map(|(_, n)| n.as_dvec3()).sum();
    let axis = sum.normalize_or(DVec3::Z).as_vec3();
    let least = points.iter().map(|(_, n)| n.as_dvec3().dot(axis.as_dvec3())).fold(1.0, f64::min);
    let mut it = empty();
    it.node = Node {
        centre,
        ball: (far as f32).next_up(),
        axis,
        cone: (least - 1e-6).max(-1.0) as f32,
        parent,
        level,
        samples: points.len().min(m) as u32,
        published: (m as f32 / points.len() as f32).sqrt() / 2f32.powi(level as i32),
        ..it.node
    };
    it.samples = points[..points.len().min(m)].to_vec();
    it.all = points;
    let rest = it.all.get(m..).unwrap_or_default().to_vec();
    made.push(it);
    if rest.is_empty() || level >= 40 {
        made[number as usize].samples = made[number as usize].all.clone();
        made[number as usize].node.samples = made[number as usize].all.len() as u32;
        return number;
    }
    let axis = (high - low).max_position();
    let mut places: Vec<f32> = rest.iter().map(|(p, _)| p[axis]).collect();
    places.sort_by(f32::total_cmp);
    let plane = places[places.len() / 2];
    let (below, above): (Vec<Sample>, Vec<Sample>) = rest.into_iter().partition(|(p, _)| p[axis] < plane);
    (made[number as usize].node.split, made[number as usize].node.plane) = (axis as u8, plane);
    for (side, part) in [below, above].into_iter().enumerate().filter(|(_, part)| !part.is_empty()) {
        let child = split(part, m, number, level + 1, made);
        made[number as usize].node.children[side] = child;
    }
    number
}

/// The largest gap where a node is the deepest that is drawn.
fn gap(made: &[Made], i: usize) -> f32 {
    let it = &made[i];
    let mut drawn = it.samples.clone();
    let mut above = it.node.parent;
    while let Some(parent) = made.get(above as usize) {
        drawn.extend(&parent.samples);
        above = parent.node.parent;
    }
    let nearest = |p: Vec3, of: &[Sample]| of.iter().map(|(q, _)| q.distance(p)).fold(f32::INFINITY, f32::min);
    let mut most = it.all.iter().map(|(p, _)| nearest(*p, &drawn)).fold(0.0, f32::max);
    // The regions above that a place must be in.
    let mut inside = drawn;
    let (mut child, mut parent) = (i, it.node.parent);
    while let Some(above) = made.get(parent as usize) {
        let side = usize::from(above.node.children[1] == child as u32);
        inside.retain(|(p, _)| usize::from(p[above.node.split as usize] >= above.node.plane) == side);
        (child, parent) = (parent as usize, above.node.parent);
    }
    for (side, child) in it.node.children.into_iter().enumerate().filter(|(_, child)| *child != NONE) {
        let there = inside.iter().filter(|(p, _)| usize::from(p[it.node.split as usize] >= it.node.plane) == side);
        most = there.map(|(p, _)| nearest(*p, &made[child as usize].all)).fold(most, f32::max);
    }
    most * 1.0001
}

/// A bumpy sphere of about radius 1, denser at one side, normals outward give or take some noise.
pub fn surface(n: usize, seed: u64) -> Vec<Sample> {
    let mut random = Random(seed);
    let mut sample = || {
        let p = (random.vector() + dvec3(0.4, 0.0, 0.0)).normalize();
        let normal = (p + 0.1 * random.vector()).normalize();
        ((p * (1.0 + 0.1 * (7.0 * p.x).sin() * (5.0 * p.y).cos())).as_vec3(), normal.as_vec3())
    };
    (0..n).map(|_| sample()).collect()
}

/// The surface, and a few samples in the air.
pub fn with_strays(n: usize, seed: u64) -> Vec<Sample> {
    let (mut random, mut points) = (Random(seed), surface(n, seed));
    points.iter_mut().step_by(40).for_each(|sample| sample.0 = (1.7 * random.vector()).as_vec3());
    points
}

/// Inputs that are hard to divide.
pub fn degenerate() -> Vec<(&'static str, Vec<Sample>)> {
    let mut random = Random(5);
    let at = |p: Vec3| (p, Vec3::Z);
    vec![
        ("one", vec![at(Vec3::ONE)]),
        ("one place", vec![at(Vec3::ONE); 300]),
        ("a line", (0..500).map(|i| at(Vec3::X * ((i * 197) % 500) as f32)).collect()),
        ("small", (0..500).map(|_| at((random.vector() * 1e-6).as_vec3())).collect()),
        ("large", (0..500).map(|_| at((random.vector() * 1e7).as_vec3())).collect()),
    ]
}

/// Any view of a model of about radius 1: perspective and orthographic, from within, near, far, and behind; wide and narrow.
pub fn any_sight(random: &mut Random) -> Sight {
    let eye = random.vector() * [0.0, 0.3, 1.0, 2.0, 8.0, 60.0][random.below(6)];
    let target = if random.unit() < 0.6 { random.vector() } else { eye + random.vector() };
    let aspect = 0.5 + random.unit();
    let lens = match random.below(4) {
        0 => View::orthographic([0.1, 1.0, 5.0][random.below(3)], aspect, 1e-3, 100.0),
        _ => View::perspective([0.03, 0.5, 1.2, 2.4][random.below(4)], aspect, [1e-3, 0.5][random.below(2)]),
    };
    let view = View::look_at(eye, target, dvec3(0.1, 0.2, 0.9), lens, DepthConvention::Reversed);
    let style = Style {
        threshold: [0.5, 2.0, 8.0, 40.0][random.below(4)],
        radius_scale: [1.0, 1.0, 2.0][random.below(3)],
        ..Style::default()
    };
    let transform = match random.below(3) {
        0 => DMat4::from_axis_angle(DVec3::Y, 1.0) * DMat4::from_scale(DVec3::splat(2.0)),
        _ => DMat4::IDENTITY,
    };
    Sight::new(&view, [300, 200], &transform, DVec3::ZERO, &style)
}

/// The eye's way to a place, in any length for orthographic views, and its distance, 1 there.
pub fn to_eye(sight: &Sight, p: Vec3) -> (DVec3, f64) {
    let eye = sight.eye.truncate();
    if sight.eye.w == 0.0 { (eye, 1.0) } else { (eye - p.as_dvec3(), (eye - p.as_dvec3()).length()) }
}

/// Whether a sphere meets the picture.
pub fn meets(sight: &Sight, p: Vec3, radius: f64) -> bool {
    sight.planes.iter().all(|q| q.truncate().dot(p.as_dvec3()) + q.w >= -radius)
}
