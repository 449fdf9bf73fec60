//! What a frame did, and what it did not have to do.

use crate::select::layered::Counts;
use crate::stream::FetchStats;
use crate::style::SumPrecision;
use crate::technique::{Blend, names};

/// How fragments of a pixel are blended one after the other, in the order of submission.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum OrderedAccess {
    /// The pass reads its own attachments: `VK_EXT_rasterization_order_attachment_access`.
    RasterizationOrder,
    /// Fragments take turns at storage images: `VK_EXT_fragment_shader_interlock`.
    Interlock,
}

names!(OrderedAccess { RasterizationOrder = "rasterization-order", Interlock = "interlock" });

/// A stage that did not run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Skip {
    /// Name of the stage.
    pub stage: &'static str,
    /// Why it was not needed, or what was used in its place.
    pub reason: &'static str,
}

/// Points that were not drawn, by what; counted only where [`FrameInput::count`](crate::FrameInput::count) asks for it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Culled {
    /// By a structure's interval test.
    pub interval: u64,
    /// Outside the clip volume.
    pub frustum: u64,
    /// Facing away.
    pub cone: u64,
    /// Behind something.
    pub occluded: u64,
    /// Not a splat: NaN, infinity, radius zero.
    pub invalid: u64,
}

impl Culled {
    /// All of them.
    pub fn total(&self) -> u64 {
        self.interval + self.frustum + self.cone + self.occluded + self.invalid
    }
}

/// One pass and its time.
#[derive(Debug, Clone, PartialEq)]
pub struct PassTime {
    /// The pass's name, as in its debug label.
    pub name: &'static str,
    /// Time on the device \[ms\], from its timestamps.
    pub gpu_ms: f64,
}

/// A layered point cloud in one frame, over all its views and instances.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LayeredStats {
    /// Nodes that were met, by what became of them, and samples drawn.
    pub cut: Counts,
    /// Factor on the threshold, for a limit of samples or slots: 1 where there is none, or it is kept.
    pub factor: f64,
    /// Balls of nodes that were tested for being behind other things.
    pub tested: u32,
    /// Patches that their test in this frame found hidden, and which were not drawn; known once the frame is complete.
    pub hidden: u32,
    /// So little was hidden lately that patches are not tested before they are drawn the first time.
    pub occlusion_idle: bool,
    /// Patches asked for.
    pub wished: u32,
    /// Patches taken in, and there from this frame on.
    pub arrived: u32,
    /// Patches that came and found no place.
    pub refused: u32,
    /// Slots that hold a patch, before this frame's.
    pub resident: u32,
    /// Slots that there are.
    pub slots: u32,
    /// Patches that had to go, since the model was added.
    pub evicted: u64,
    /// What fetching did, since then.
    pub fetched: FetchStats,
    /// The latest fault, until a request succeeds; else why a patch is never to be had.
    pub fault: Option<String>,
}

/// One frame's account. Over all views; with n views every point is submitted n times.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FrameStats {
    /// The frame's id.
    pub frame: u64,
    /// Points given to the device.
    pub points_submitted: u64,
    /// Triangles given to the device: those of hybrids.
    pub triangles_submitted: u64,
    /// Points that passed selection and lie in the clip volume; `None` where nothing was counted, or the frame ended before `render`.
    pub points_drawn: Option<u64>,
    /// The rest: `points_submitted = points_drawn + culled.total()`. `None` where nothing was counted.
    pub culled: Option<Culled>,
    /// Precision of the sums.
    pub sums: SumPrecision,
    /// The blend that was drawn: `two-pass` where the device has no way for `fuzzy`, see [`skipped`](Self::skipped).
    pub blend: Blend,
    /// How `fuzzy` was drawn; `None` for other blends.
    pub ordered: Option<OrderedAccess>,
    /// Layers that `groups` drew into, K; 0 for other blends.
    pub layers: u32,
    /// Bytes of device memory of those layers.
    pub layer_bytes: u64,
    /// Recorded draw and dispatch calls.
    pub draw_calls: u32,
    /// In order; empty where the device has no timestamps.
    pub passes: Vec<PassTime>,
    /// What did not run.
    pub skipped: Vec<Skip>,
    /// Bytes copied to the device in this frame.
    pub bytes_uploaded: u64,
    /// Bytes of device memory held.
    pub device_bytes: u64,
    /// Numbers of the points that compaction listed, in the order in which they are drawn; empty unless
    /// [`FrameInput::keep_lists`](crate::FrameInput::keep_lists) asks for it. One list for each view, instance, chunk of 2²²
    /// points and part of it with or without large footprints; numbers count from the chunk's first point.
    pub lists: Vec<Vec<u32>>,
    /// Layered point clouds, in the order in which instances name them first.
    pub layered: Vec<LayeredStats>,
    /// Pipelines built in this frame: 0 after warm-up.
    pub pipelines_built: u32,
}

impl FrameStats {
    /// Time of all passes \[ms\].
    pub fn gpu_ms(&self) -> f64 {
        self.passes.iter().map(|p| p.gpu_ms).sum()
    }
}
