//! The shaders as the build made them: words, bindings and block layouts.

/// Pipeline stage of a shader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// `.vert`
    Vertex,
    /// `.frag`
    Fragment,
    /// `.comp`
    Compute,
}

/// Descriptor kind as reflected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// `uniform` block.
    UniformBuffer,
    /// `buffer` block.
    StorageBuffer,
    /// Combined image and sampler.
    SampledImage,
    /// Image that is loaded from and stored to.
    StorageImage,
    /// Attachment that the pass itself reads.
    InputAttachment,
}

/// One reflected binding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Binding {
    /// Set number.
    pub set: u32,
    /// Binding number.
    pub binding: u32,
    /// What is bound.
    pub kind: Kind,
}

/// One compiled shader.
#[derive(Debug)]
pub struct Shader {
    /// Path below `glsl/`.
    pub name: &'static str,
    /// Its stage.
    pub stage: Stage,
    /// Sorted by set, then binding.
    pub bindings: &'static [Binding],
    /// SPIR-V 1.6.
    pub words: &'static [u32],
}

/// Shader constants and, in modules named after the blocks, their members' byte offsets.
#[allow(missing_docs)]
pub mod generated {
    use super::{Binding, Kind, Shader, Stage};
    include!(concat!(env!("OUT_DIR"), "/spirv.rs"));
}
