//! A device table of the engine's own: creating functions that fail on demand, and commands that are written down.
//!
//! The real functions and the orders are kept per thread: a test records on its own.

use std::cell::RefCell;
use std::collections::HashMap;
use std::ffi::{CStr, c_char, c_void};

use surfel::ash::{self, vk};

use crate::host_engine::Engine;

#[derive(Default)]
struct Table {
    real: HashMap<&'static str, *const c_void>,
    calls: u64,
    fail_at: u64,
    failed: Option<&'static str>,
    commands: Vec<&'static str>,
    ordered: Ordered,
    images: Vec<vk::Image>,
}

/// What was said about order when passes and pipelines were made: no picture of a device that is in order anyway tells.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Ordered {
    /// Flags of every subpass, and the dependencies of subpasses on themselves.
    pub passes: Vec<(vk::SubpassDescriptionFlags, Vec<SelfDependency>)>,
    /// Flags of the colour blending of every pipeline for such a pass.
    pub pipelines: Vec<vk::PipelineColorBlendStateCreateFlags>,
}

/// Source stages and accesses, destination stages and accesses, flags.
pub type SelfDependency =
    (vk::PipelineStageFlags, vk::AccessFlags, vk::PipelineStageFlags, vk::AccessFlags, vk::DependencyFlags);

thread_local! {
    static TABLE: RefCell<Table> = RefCell::default();
}

/// Whether this call of a creating function is the one that fails.
fn fails(name: &'static str) -> bool {
    TABLE.with_borrow_mut(|t| {
        t.calls += 1;
        if t.calls == t.fail_at {
            t.failed = Some(name);
        }
        t.calls == t.fail_at
    })
}

fn real(name: &str) -> *const c_void {
    TABLE.with_borrow(|t| t.real[name])
}

/// Wrappers of functions that create (they may fail) and of commands (they are noted).
macro_rules! wrappers {
    (create { $($create:ident = $name:literal ($($arg:ident: $ty:ty),*);)* }
     command { $($command:ident = $note:literal ($($parameter:ident: $kind:ty),*);)* }) => {
        $(unsafe extern "system" fn $create($($arg: $ty),*) -> vk::Result {
            if fails($name) {
                return vk::Result::ERROR_OUT_OF_DEVICE_MEMORY;
            }
            // SAFETY: the pointer is the real function of this name, which has this signature.
            unsafe {
                let function: unsafe extern "system" fn($($ty),*) -> vk::Result = std::mem::transmute(real($name));
                function($($arg),*)
            }
        })*
        $(unsafe extern "system" fn $command($($parameter: $kind),*) {
            TABLE.with_borrow_mut(|t| t.commands.push($note));
            // SAFETY: as above.
            unsafe {
                let function: unsafe extern "system" fn($($kind),*) = std::mem::transmute(real($note));
                function($($parameter),*)
            }
        })*
        fn wrapper(name: &str) -> Option<(&'static str, *const c_void)> {
            match name {
                $($name => Some(($name, $create as *const c_void)),)*
                $($note => Some(($note, $command as *const c_void)),)*
                _ => None,
            }
        }
    };
}

type Info = *const c_void;
type Out = *mut c_void;

wrappers! {
    create {
        create_buffer = "vkCreateBuffer" (device: vk::Device, info: Info, callbacks: Info, out: Out);
        create_image = "vkCreateImage" (device: vk::Device, info: Info, callbacks: Info, out: Out);
        create_image_view = "vkCreateImageView" (device: vk::Device, info: Info, callbacks: Info, out: Out);
        create_sampler = "vkCreateSampler" (device: vk::Device, info: Info, callbacks: Info, out: Out);
        create_shader_module = "vkCreateShaderModule" (device: vk::Device, info: Info, callbacks: Info, out: Out);
        create_set_layout = "vkCreateDescriptorSetLayout" (device: vk::Device, info: Info, callbacks: Info, out: Out);
        create_layout = "vkCreatePipelineLayout" (device: vk::Device, info: Info, callbacks: Info, out: Out);
        create_pool = "vkCreateDescriptorPool" (device: vk::Device, info: Info, callbacks: Info, out: Out);
        create_framebuffer = "vkCreateFramebuffer" (device: vk::Device, info: Info, callbacks: Info, out: Out);
        create_query_pool = "vkCreateQueryPool" (device: vk::Device, info: Info, callbacks: Info, out: Out);
        allocate_sets = "vkAllocateDescriptorSets" (device: vk::Device, info: Info, out: Out);
        bind_buffer = "vkBindBufferMemory" (device: vk::Device, buffer: vk::Buffer, memory: vk::DeviceMemory, at: u64);
        bind_image = "vkBindImageMemory" (device: vk::Device, image: vk::Image, memory: vk::DeviceMemory, at: u64);
        compute_pipelines = "vkCreateComputePipelines"
            (device: vk::Device, cache: vk::PipelineCache, count: u32, infos: Info, callbacks: Info, out: Out);
    }
    command {
        begin_rendering = "vkCmdBeginRendering" (cmd: vk::CommandBuffer, info: Info);
        end_rendering = "vkCmdEndRendering" (cmd: vk::CommandBuffer);
        begin_pass = "vkCmdBeginRenderPass" (cmd: vk::CommandBuffer, info: Info, contents: vk::SubpassContents);
        end_pass = "vkCmdEndRenderPass" (cmd: vk::CommandBuffer);
        set_viewport = "vkCmdSetViewport" (cmd: vk::CommandBuffer, first: u32, count: u32, viewports: Info);
        set_scissor = "vkCmdSetScissor" (cmd: vk::CommandBuffer, first: u32, count: u32, scissors: Info);
        copy_buffer = "vkCmdCopyBuffer"
            (cmd: vk::CommandBuffer, from: vk::Buffer, to: vk::Buffer, count: u32, regions: Info);
        fill_buffer = "vkCmdFillBuffer" (cmd: vk::CommandBuffer, buffer: vk::Buffer, at: u64, size: u64, data: u32);
        bind_pipeline = "vkCmdBindPipeline"
            (cmd: vk::CommandBuffer, point: vk::PipelineBindPoint, pipeline: vk::Pipeline);
        bind_sets = "vkCmdBindDescriptorSets"
            (cmd: vk::CommandBuffer, point: vk::PipelineBindPoint, layout: vk::PipelineLayout, first: u32, count: u32,
             sets: Info, offsets: u32, offset: Info);
        push = "vkCmdPushConstants"
            (cmd: vk::CommandBuffer, layout: vk::PipelineLayout, stages: vk::ShaderStageFlags, at: u32, size: u32,
             data: Info);
        draw = "vkCmdDraw" (cmd: vk::CommandBuffer, vertices: u32, instances: u32, first: u32, instance: u32);
        draw_indexed = "vkCmdDrawIndexed"
            (cmd: vk::CommandBuffer, indices: u32, instances: u32, first: u32, offset: i32, instance: u32);
        draw_indirect = "vkCmdDrawIndirect"
            (cmd: vk::CommandBuffer, commands: vk::Buffer, at: u64, count: u32, stride: u32);
        draw_indexed_indirect = "vkCmdDrawIndexedIndirect"
            (cmd: vk::CommandBuffer, commands: vk::Buffer, at: u64, count: u32, stride: u32);
        dispatch = "vkCmdDispatch" (cmd: vk::CommandBuffer, x: u32, y: u32, z: u32);
        bind_vertices = "vkCmdBindVertexBuffers"
            (cmd: vk::CommandBuffer, first: u32, count: u32, buffers: Info, offsets: Info);
        bind_indices = "vkCmdBindIndexBuffer"
            (cmd: vk::CommandBuffer, buffer: vk::Buffer, at: u64, kind: vk::IndexType);
        reset_queries = "vkCmdResetQueryPool" (cmd: vk::CommandBuffer, pool: vk::QueryPool, first: u32, count: u32);
        begin_query = "vkCmdBeginQuery"
            (cmd: vk::CommandBuffer, pool: vk::QueryPool, query: u32, flags: vk::QueryControlFlags);
        end_query = "vkCmdEndQuery" (cmd: vk::CommandBuffer, pool: vk::QueryPool, query: u32);
        copy_queries = "vkCmdCopyQueryPoolResults"
            (cmd: vk::CommandBuffer, pool: vk::QueryPool, first: u32, count: u32, to: vk::Buffer, at: u64, stride: u64, flags: vk::QueryResultFlags);
        timestamp = "vkCmdWriteTimestamp2"
            (cmd: vk::CommandBuffer, stage: vk::PipelineStageFlags2, pool: vk::QueryPool, query: u32);
    }
}

unsafe extern "system" fn create_pass(
    device: vk::Device,
    info: *const vk::RenderPassCreateInfo,
    callbacks: Info,
    out: Out,
) -> vk::Result {
    if fails("vkCreateRenderPass") {
        return vk::Result::ERROR_OUT_OF_DEVICE_MEMORY;
    }
    // SAFETY: the caller gives a valid description, and the pointer is the real function of this name.
    unsafe {
        let dependencies = (0..(*info).dependency_count as usize).map(|i| *(*info).p_dependencies.add(i));
        let itself = dependencies
            .filter(|d| d.src_subpass == d.dst_subpass)
            .map(|d| (d.src_stage_mask, d.src_access_mask, d.dst_stage_mask, d.dst_access_mask, d.dependency_flags));
        let pass = ((*(*info).p_subpasses).flags, itself.collect());
        TABLE.with_borrow_mut(|t| t.ordered.passes.push(pass));
        type Create = unsafe extern "system" fn(vk::Device, *const vk::RenderPassCreateInfo, Info, Out) -> vk::Result;
        let function: Create = std::mem::transmute(real("vkCreateRenderPass"));
        function(device, info, callbacks, out)
    }
}

unsafe extern "system" fn graphics_pipelines(
    device: vk::Device,
    cache: vk::PipelineCache,
    count: u32,
    infos: *const vk::GraphicsPipelineCreateInfo,
    callbacks: Info,
    out: Out,
) -> vk::Result {
    if fails("vkCreateGraphicsPipelines") {
        return vk::Result::ERROR_OUT_OF_DEVICE_MEMORY;
    }
    // SAFETY: as above.
    unsafe {
        for i in 0..count as usize {
            let info = &*infos.add(i);
            if info.render_pass != vk::RenderPass::null() {
                let flags = (*info.p_color_blend_state).flags;
                TABLE.with_borrow_mut(|t| t.ordered.pipelines.push(flags));
            }
        }
        type Create = unsafe extern "system" fn(
            vk::Device,
            vk::PipelineCache,
            u32,
            *const vk::GraphicsPipelineCreateInfo,
            Info,
            Out,
        ) -> vk::Result;
        let function: Create = std::mem::transmute(real("vkCreateGraphicsPipelines"));
        function(device, cache, count, infos, callbacks, out)
    }
}

unsafe extern "system" fn barrier(cmd: vk::CommandBuffer, info: *const vk::DependencyInfo) {
    // SAFETY: the caller gives a valid description, and the pointer is the real function of this name.
    unsafe {
        let images =
            (0..(*info).image_memory_barrier_count as usize).map(|i| (*(*info).p_image_memory_barriers.add(i)).image);
        TABLE.with_borrow_mut(|t| {
            t.commands.push("vkCmdPipelineBarrier2");
            t.images.extend(images);
        });
        let function: vk::PFN_vkCmdPipelineBarrier2 = std::mem::transmute(real("vkCmdPipelineBarrier2"));
        function(cmd, info);
    }
}

/// The engine's device through wrappers. Commands and submissions that the library must never use are missing: a call
/// ends the process with the function's name.
pub fn wrapped_device(engine: &Engine) -> ash::Device {
    TABLE.with_borrow_mut(|t| *t = Table::default());
    let get = engine.instance.fp_v1_0().get_device_proc_addr;
    let load = |name: &CStr| {
        let text = name.to_str().unwrap();
        // SAFETY: the device lives; an address or null comes back.
        let address = unsafe { get(engine.device.handle(), name.as_ptr() as *const c_char) };
        let address = address.map_or(std::ptr::null(), |f| f as *const c_void);
        let found = match text {
            "vkCmdPipelineBarrier2" => Some(("vkCmdPipelineBarrier2", barrier as *const c_void)),
            "vkCreateRenderPass" => Some(("vkCreateRenderPass", create_pass as *const c_void)),
            "vkCreateGraphicsPipelines" => Some(("vkCreateGraphicsPipelines", graphics_pipelines as *const c_void)),
            _ => wrapper(text),
        };
        match found {
            Some((name, wrapper)) => {
                TABLE.with_borrow_mut(|t| t.real.insert(name, address));
                wrapper
            }
            None if text.starts_with("vkCmd") || text.starts_with("vkQueue") || text.contains("Wait") => {
                std::ptr::null()
            }
            None => address,
        }
    };
    // SAFETY: every address is the device's own function of that name, or a wrapper of the same signature.
    unsafe { ash::Device::load_with(load, engine.device.handle()) }
}

/// The `n`-th creating call from now on fails; 0: none does.
pub fn fail_at(n: u64) {
    TABLE.with_borrow_mut(|t| (t.calls, t.fail_at, t.failed) = (0, n, None));
}

/// Which call failed, if one did.
pub fn failed() -> Option<&'static str> {
    TABLE.with_borrow(|t| t.failed)
}

/// What was said about order so far.
pub fn ordered() -> Ordered {
    TABLE.with_borrow(|t| t.ordered.clone())
}

/// Names of the commands since the last call, and the images that barriers named.
pub fn take_commands() -> (Vec<&'static str>, Vec<vk::Image>) {
    TABLE.with_borrow_mut(|t| (std::mem::take(&mut t.commands), std::mem::take(&mut t.images)))
}
