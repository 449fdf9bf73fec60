//! From records to columns.

/// Where things are in a record.
pub(super) struct Layout {
    /// Bytes of a record, at least what the format needs.
    pub(super) length: u16,
    /// Formats 6 to 10: flags and class have bytes of their own.
    pub(super) is_extended: bool,
    /// Byte of the red channel, if the format has colours.
    pub(super) color: Option<usize>,
}

/// Decoded records of one block, withheld ones left out.
#[derive(Default)]
pub(super) struct Block {
    xyz: Vec<[i32; 3]>,
    colors: Vec<[u16; 3]>,
    intensity: Vec<u16>,
    classes: Vec<u8>,
    withheld: u64,
    synthetic: u64,
}

/// Decodes whole records.
pub(super) fn decode(records: &[u8], layout: &Layout) -> Block {
    let mut out = Block::default();
    decode_into(records, layout, &mut out);
    out
}

/// Decodes whole records and appends them.
pub(super) fn decode_into(records: &[u8], layout: &Layout, out: &mut Block) {
    let n = records.len() / usize::from(layout.length);
    out.xyz.reserve(n);
    out.intensity.reserve(n);
    out.classes.reserve(n);
    if layout.color.is_some() {
        out.colors.reserve(n);
    }
    for r in records.chunks_exact(usize::from(layout.length)) {
        // 17 bytes are less than any format's record, which the header's check guarantees.
        let Some(head) = r.first_chunk::<17>() else { continue };
        let (class, synthetic, withheld) = match layout.is_extended {
            true => (head[16], head[15] & 1, head[15] & 4),
            false => (head[15] & 31, head[15] & 32, head[15] & 128),
        };
        if withheld != 0 {
            out.withheld += 1;
            continue;
        }
        out.synthetic += u64::from(synthetic != 0);
        let int = |i: usize| i32::from_le_bytes([head[i], head[i + 1], head[i + 2], head[i + 3]]);
        out.xyz.push([int(0), int(4), int(8)]);
        out.intensity.push(u16::from_le_bytes([head[12], head[13]]));
        out.classes.push(class);
        if let Some(c) = layout.color.and_then(|at| r.get(at..)).and_then(|r| r.first_chunk::<6>()) {
            out.colors.push([0, 2, 4].map(|i| u16::from_le_bytes([c[i], c[i + 1]])));
        }
    }
}

/// All points so far.
#[derive(Default)]
pub(super) struct Points {
    pub(super) xyz: Vec<[i32; 3]>,
    pub(super) colors: Vec<[u8; 3]>,
    /// A channel above 255 was seen: `colors` holds the upper bytes of 16 bits, otherwise all of 8.
    pub(super) wide_color: bool,
    pub(super) any_color: bool,
    pub(super) intensity: Vec<f32>,
    pub(super) any_intensity: bool,
    pub(super) classes: Vec<u8>,
    pub(super) any_class: bool,
    pub(super) withheld: u64,
    pub(super) synthetic: u64,
}

impl Points {
    /// Room for `n` points that are known to be there.
    pub(super) fn reserve(&mut self, n: u64) {
        let n = usize::try_from(n).unwrap_or(0);
        self.xyz.reserve_exact(n);
        self.intensity.reserve_exact(n);
        self.classes.reserve_exact(n);
    }

    /// No points yet, of a file of which a sample is known.
    #[cfg(feature = "layered")]
    pub(super) fn like(sample: &Points) -> Points {
        Points { wide_color: sample.wide_color, any_color: sample.any_color, ..Points::default() }
    }

    /// Decoded so far, dropped ones included.
    pub(super) fn seen(&self) -> u64 {
        self.xyz.len() as u64 + self.withheld
    }

    pub(super) fn push(&mut self, block: Block) {
        self.xyz.extend_from_slice(&block.xyz);
        self.intensity.extend(block.intensity.iter().map(|&v| f32::from(v)));
        self.any_intensity |= block.intensity.iter().any(|&v| v != 0);
        self.classes.extend_from_slice(&block.classes);
        self.any_class |= block.classes.iter().any(|&v| v != 0);
        self.withheld += block.withheld;
        self.synthetic += block.synthetic;
        let highest = block.colors.iter().flatten().copied().max().unwrap_or(0);
        self.any_color |= highest > 0;
        if highest > 255 && !self.wide_color {
            // What came before was taken for 8 bits.
            self.wide_color = true;
            self.colors.iter_mut().for_each(|c| *c = c.map(|v| eight_bits(v.into())));
        }
        self.colors.reserve(self.xyz.capacity().min(self.xyz.len() * 2).saturating_sub(self.colors.len()));
        match self.wide_color {
            true => self.colors.extend(block.colors.iter().map(|c| c.map(eight_bits))),
            false => self.colors.extend(block.colors.iter().map(|c| c.map(|v| v as u8))),
        }
    }
}

/// The nearest of 256 levels: 65535 is 255, and 257 v is v.
fn eight_bits(v: u16) -> u8 {
    ((u32::from(v) + 128) / 257) as u8
}
