//! Every barrier's scope, as one table: nobody else types a stage mask.

use ash::vk;

use super::resource::{Image, aspect};

/// A use of a resource.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Access {
    /// Nothing that matters was there.
    Undefined,
    /// Source of a copy.
    CopyRead,
    /// Destination of a copy or fill.
    CopyWrite,
    /// Colour attachment, blended or not.
    ColorWrite,
    /// Colour attachment that the fragments of a pass read and write, in order.
    ColorOrdered,
    /// Storage image that fragments read and write.
    FragmentStorage,
    /// Depth and stencil attachment, tested or written.
    DepthWrite,
    /// Sampled in a fragment shader.
    FragmentRead,
    /// Vertex attributes, indices, indirect commands, and storage read by vertex shaders.
    VertexRead,
    /// Storage read and written by compute.
    ComputeWrite,
    /// Decides whether commands are run: `VK_EXT_conditional_rendering`.
    Condition,
    /// Read by the processor after a fence or semaphore.
    HostRead,
}

impl Access {
    /// Stages and accesses on either side of a barrier.
    pub fn scope(self) -> (vk::PipelineStageFlags2, vk::AccessFlags2) {
        use vk::{AccessFlags2 as A, PipelineStageFlags2 as S};
        match self {
            Access::Undefined => (S::NONE, A::NONE),
            Access::CopyRead => (S::COPY, A::TRANSFER_READ),
            Access::CopyWrite => (S::COPY | S::CLEAR, A::TRANSFER_WRITE),
            Access::ColorWrite => (S::COLOR_ATTACHMENT_OUTPUT, A::COLOR_ATTACHMENT_WRITE | A::COLOR_ATTACHMENT_READ),
            Access::ColorOrdered => (
                S::COLOR_ATTACHMENT_OUTPUT | S::FRAGMENT_SHADER,
                A::COLOR_ATTACHMENT_WRITE | A::COLOR_ATTACHMENT_READ | A::INPUT_ATTACHMENT_READ,
            ),
            Access::FragmentStorage => (S::FRAGMENT_SHADER, A::SHADER_STORAGE_READ | A::SHADER_STORAGE_WRITE),
            Access::DepthWrite => (
                S::EARLY_FRAGMENT_TESTS | S::LATE_FRAGMENT_TESTS,
                A::DEPTH_STENCIL_ATTACHMENT_WRITE | A::DEPTH_STENCIL_ATTACHMENT_READ,
            ),
            Access::FragmentRead => (S::FRAGMENT_SHADER, A::SHADER_SAMPLED_READ),
            Access::VertexRead => (
                S::DRAW_INDIRECT | S::VERTEX_ATTRIBUTE_INPUT | S::INDEX_INPUT | S::VERTEX_SHADER | S::COMPUTE_SHADER,
                A::INDIRECT_COMMAND_READ | A::VERTEX_ATTRIBUTE_READ | A::INDEX_READ | A::SHADER_STORAGE_READ,
            ),
            Access::ComputeWrite => (S::COMPUTE_SHADER, A::SHADER_STORAGE_READ | A::SHADER_STORAGE_WRITE),
            Access::Condition => (S::CONDITIONAL_RENDERING_EXT, A::CONDITIONAL_RENDERING_READ_EXT),
            Access::HostRead => (S::HOST, A::HOST_READ),
        }
    }

    /// The layout that an image must have for this use.
    pub fn layout(self) -> vk::ImageLayout {
        match self {
            Access::Undefined => vk::ImageLayout::UNDEFINED,
            Access::CopyRead => vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
            Access::CopyWrite => vk::ImageLayout::TRANSFER_DST_OPTIMAL,
            Access::ColorWrite => vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL,
            Access::DepthWrite => vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL,
            Access::FragmentRead => vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
            Access::ColorOrdered
            | Access::FragmentStorage
            | Access::VertexRead
            | Access::ComputeWrite
            | Access::Condition
            | Access::HostRead => vk::ImageLayout::GENERAL,
        }
    }

    /// Whether the use leaves something to be made visible.
    pub fn writes(self) -> bool {
        match self {
            Access::CopyWrite
            | Access::ColorWrite
            | Access::ColorOrdered
            | Access::FragmentStorage
            | Access::DepthWrite
            | Access::ComputeWrite => true,
            Access::Undefined
            | Access::CopyRead
            | Access::FragmentRead
            | Access::VertexRead
            | Access::Condition
            | Access::HostRead => false,
        }
    }
}

/// Moves an image to its next use; `discard` gives up what it holds. `None` when nothing has to be waited for.
pub fn image(image: &mut Image, to: Access, discard: bool) -> Option<vk::ImageMemoryBarrier2<'static>> {
    let from = std::mem::replace(&mut image.access, to);
    if from == to && !to.writes() {
        return None;
    }
    let old_layout = if discard { vk::ImageLayout::UNDEFINED } else { from.layout() };
    Some(image_handle(image.handle, aspect(image.format), from, to).old_layout(old_layout))
}

/// The same for an image that is not ours.
pub fn image_handle(
    image: vk::Image,
    aspect: vk::ImageAspectFlags,
    from: Access,
    to: Access,
) -> vk::ImageMemoryBarrier2<'static> {
    let ((from_stages, from_access), (to_stages, to_access)) = (from.scope(), to.scope());
    vk::ImageMemoryBarrier2::default()
        .image(image)
        .subresource_range(
            vk::ImageSubresourceRange::default()
                .aspect_mask(aspect)
                .level_count(vk::REMAINING_MIP_LEVELS)
                .layer_count(vk::REMAINING_ARRAY_LAYERS),
        )
        .old_layout(from.layout())
        .new_layout(to.layout())
        .src_stage_mask(from_stages)
        .src_access_mask(if from.writes() { from_access } else { vk::AccessFlags2::NONE })
        .dst_stage_mask(to_stages)
        .dst_access_mask(to_access)
        .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
}

/// All memory, from one use to another.
pub fn memory(from: Access, to: Access) -> vk::MemoryBarrier2<'static> {
    let ((from_stages, from_access), (to_stages, to_access)) = (from.scope(), to.scope());
    vk::MemoryBarrier2::default()
        .src_stage_mask(from_stages)
        .src_access_mask(if from.writes() { from_access } else { vk::AccessFlags2::NONE })
        .dst_stage_mask(to_stages)
        .dst_access_mask(to_access)
}
