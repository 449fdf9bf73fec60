//! What a frame submits, in exact submission order: the contract between selection, the GPU and the reference.

/// A run of consecutive points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// Which cloud of the frame, as an index into its instances.
    pub instance: u32,
    /// Index of the first point in the cloud's structure.
    pub first: u32,
    /// Number of points.
    pub count: u32,
    /// Least radius of its points \[cloud units\], for points that stand for a cell of a structure; 0: each has its own.
    pub least: f32,
}

/// Spans in submission order, each in stored order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DrawList {
    /// The runs of points.
    pub spans: Vec<Span>,
    /// Runs of [`Triangles`](crate::structure::hybrid::Triangles): an instance's are drawn before its points. `least` is 0.
    pub triangles: Vec<Span>,
}

impl DrawList {
    /// Every point of clouds with these numbers of points.
    pub fn all(counts: impl IntoIterator<Item = u32>) -> DrawList {
        let spans = counts
            .into_iter()
            .enumerate()
            .filter(|(_, count)| *count > 0)
            .map(|(instance, count)| Span { instance: instance as u32, first: 0, count, least: 0.0 })
            .collect();
        DrawList { spans, triangles: Vec::new() }
    }

    /// Adds a span; one that goes on where the last one ends, by the same rule, becomes part of it.
    pub fn push(&mut self, span: Span) {
        push(&mut self.spans, span);
    }

    /// The same for triangles.
    pub fn push_triangles(&mut self, span: Span) {
        push(&mut self.triangles, span);
    }

    /// The largest of the spans' least radii \[cloud units\].
    pub fn least(&self) -> f32 {
        self.spans.iter().map(|s| s.least).fold(0.0, f32::max)
    }

    /// Number of points submitted.
    pub fn submitted(&self) -> u64 {
        self.spans.iter().map(|s| s.count as u64).sum()
    }
}

fn push(spans: &mut Vec<Span>, span: Span) {
    if span.count == 0 {
        return;
    }
    match spans.last_mut() {
        Some(last)
            if last.instance == span.instance
                && last.first + last.count == span.first
                && last.least.to_bits() == span.least.to_bits() =>
        {
            last.count += span.count;
        }
        _ => spans.push(span),
    }
}
