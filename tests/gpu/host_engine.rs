//! An engine that is not ours: its own entry, instance, device, allocator, command buffers and frame counter. It knows
//! only what `surfel` publishes for embedders, and `Standalone` not at all.

use std::cell::{Cell, RefCell};
use std::collections::{HashMap, VecDeque};
use std::ffi::{CStr, c_void};
use std::sync::{Arc, Mutex};

use surfel::ash::{self, ext, vk};
use surfel::standalone::Layers;
use surfel::{Enabled, GpuMemory, Host, Location, Memory, MemoryRequest, Requirements};

/// What the layers said, and their account of what is on.
#[derive(Default)]
pub struct Heard {
    pub messages: Mutex<Vec<String>>,
    pub enables: Mutex<String>,
}

/// What the allocator gave out.
#[derive(Default)]
pub struct Ledger {
    /// Pieces held now.
    pub live: usize,
    /// Requests so far.
    pub calls: u64,
    /// The request that fails, counted from 1.
    pub fail_at: Option<u64>,
    /// Every request from `fail_at` on fails, not only that one.
    pub keep_failing: bool,
}

pub struct Engine {
    pub instance: ash::Instance,
    pub physical_device: vk::PhysicalDevice,
    pub device: ash::Device,
    pub queue: vk::Queue,
    pub enabled: Enabled,
    pub ledger: Arc<Mutex<Ledger>>,
    pub pool: vk::CommandPool,
    pub timeline: vk::Semaphore,
    /// Wait by a fence a frame, as older engines do. Synchronization validation 1.3.239 knows nothing of timelines: to it,
    /// memory that is used again after a timeline said so is still in use, so engines that share memory use fences here.
    pub by_fences: bool,
    fences: RefCell<VecDeque<(u64, vk::Fence)>>,
    done: Cell<u64>,
    heard: Box<Heard>,
    messenger: (ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT),
    _entry: ash::Entry,
}

unsafe extern "system" fn hear(
    severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: `user` is the engine's boxed `Heard`, which outlives the messenger; the strings live during the call.
    unsafe {
        let text = CStr::from_ptr((*data).p_message).to_string_lossy().into_owned();
        let heard = &*user.cast::<Heard>();
        if text.contains("Current Enables") {
            *heard.enables.lock().unwrap() = text;
        } else if kind != vk::DebugUtilsMessageTypeFlagsEXT::GENERAL
            && severity > vk::DebugUtilsMessageSeverityFlagsEXT::INFO
        {
            heard.messages.lock().unwrap().push(text);
        }
    }
    vk::FALSE
}

impl Engine {
    pub fn new(layers: Layers) -> Engine {
        let heard = Box::<Heard>::default();
        // SAFETY: the loader is trusted; every description and all that it points to live until the call that takes it
        // returns; the listener is boxed and destroyed last.
        unsafe {
            let entry = ash::Entry::load().expect("a Vulkan loader");
            let application = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_3);
            let (extensions, names): (Vec<_>, Vec<_>) = if layers.any() {
                (
                    vec![ext::debug_utils::NAME.as_ptr(), ext::validation_features::NAME.as_ptr()],
                    vec![c"VK_LAYER_KHRONOS_validation".as_ptr()],
                )
            } else {
                (vec![ext::debug_utils::NAME.as_ptr()], vec![])
            };
            let checks = layers.features();
            let mut validation = vk::ValidationFeaturesEXT::default().enabled_validation_features(&checks);
            use vk::{DebugUtilsMessageSeverityFlagsEXT as Severity, DebugUtilsMessageTypeFlagsEXT as Type};
            let mut listener = vk::DebugUtilsMessengerCreateInfoEXT::default()
                .message_severity(Severity::ERROR | Severity::WARNING | Severity::INFO)
                .message_type(Type::VALIDATION | Type::PERFORMANCE | Type::GENERAL)
                .pfn_user_callback(Some(hear))
                .user_data(std::ptr::from_ref(&*heard).cast_mut().cast());
            let mut info = vk::InstanceCreateInfo::default()
                .application_info(&application)
                .enabled_layer_names(&names)
                .enabled_extension_names(&extensions)
                .push_next(&mut listener);
            if layers.any() {
                info = info.push_next(&mut validation);
            }
            let instance = entry.create_instance(&info, None).expect("an instance");
            let lacking = layers.lacking(&heard.enables.lock().unwrap());
            assert!(lacking.is_empty(), "checks that are not on: {lacking:?}");
            let functions = ext::debug_utils::Instance::new(&entry, &instance);
            let listener = vk::DebugUtilsMessengerCreateInfoEXT { p_next: std::ptr::null(), ..listener };
            let messenger = functions.create_debug_utils_messenger(&listener, None).expect("a messenger");

            let physical_device = *instance
                .enumerate_physical_devices()
                .expect("devices")
                .iter()
                .find(|d| Requirements::query(&instance, **d).missing().is_empty())
                .expect("GPU tests need a Vulkan device that fulfils the requirements");
            let requirements = Requirements::query(&instance, physical_device);
            // The engine's own wishes and the library's, in one chain.
            let mut v12 = requirements.vulkan12.timeline_semaphore(true);
            let (mut v11, mut v13) = (requirements.vulkan11, requirements.vulkan13);
            let (mut order, mut turns) = (requirements.rasterization_order, requirements.interlock);
            let (mut conditional, mut multi) = (requirements.conditional, requirements.multi_draw);
            let mut core = vk::PhysicalDeviceFeatures { fill_mode_non_solid: vk::TRUE, ..requirements.features };
            if layers.gpu_assisted {
                (core.vertex_pipeline_stores_and_atomics, core.fragment_stores_and_atomics) = (vk::TRUE, vk::TRUE);
            }
            let mut robust = vk::PhysicalDeviceRobustness2FeaturesEXT::default()
                .robust_buffer_access2(true)
                .robust_image_access2(true);
            let mut extensions: Vec<_> = requirements.extensions.iter().map(|e| e.as_ptr()).collect();
            let with_robustness = crate::vulkan::options().robustness;
            if with_robustness {
                core.robust_buffer_access = vk::TRUE;
                extensions.push(ext::robustness2::NAME.as_ptr());
            }
            let families = instance.get_physical_device_queue_family_properties(physical_device);
            let both = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
            let family = families.iter().position(|f| f.queue_flags.contains(both)).expect("a queue family") as u32;
            let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[0.5])];
            let mut info = vk::DeviceCreateInfo::default()
                .queue_create_infos(&queues)
                .enabled_extension_names(&extensions)
                .enabled_features(&core)
                .push_next(&mut v12)
                .push_next(&mut v11)
                .push_next(&mut v13);
            if with_robustness {
                info = info.push_next(&mut robust);
            }
            if requirements.extensions.contains(&ext::rasterization_order_attachment_access::NAME) {
                info = info.push_next(&mut order);
            }
            if requirements.extensions.contains(&ext::fragment_shader_interlock::NAME) {
                info = info.push_next(&mut turns);
            }
            if requirements.extensions.contains(&ext::conditional_rendering::NAME) {
                info = info.push_next(&mut conditional);
            }
            if requirements.extensions.contains(&ext::multi_draw::NAME) {
                info = info.push_next(&mut multi);
            }
            let device = instance.create_device(physical_device, &info, None).expect("a device");
            let queue = device.get_device_queue(family, 0);
            let pool = vk::CommandPoolCreateInfo::default()
                .queue_family_index(family)
                .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
            let pool = device.create_command_pool(&pool, None).expect("a pool");
            let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
            let timeline = device
                .create_semaphore(&vk::SemaphoreCreateInfo::default().push_next(&mut kind), None)
                .expect("timeline");
            let mut enabled = requirements.enabled(true);
            enabled.timestamps &= families[family as usize].timestamp_valid_bits > 0;
            Engine {
                instance,
                physical_device,
                device,
                queue,
                enabled,
                ledger: Arc::default(),
                pool,
                timeline,
                by_fences: false,
                fences: RefCell::default(),
                done: Cell::new(0),
                heard,
                messenger: (functions, messenger),
                _entry: entry,
            }
        }
    }

    /// Runs a test with an engine, and afterwards looks for what was left alive, in the engine's own books and in the
    /// layers' messages.
    pub fn with(test: impl FnOnce(&Engine)) {
        Engine::with_progress(false, test);
    }

    /// The same, by fences or by a timeline.
    pub fn with_progress(by_fences: bool, test: impl FnOnce(&Engine)) {
        let layers = crate::vulkan::layers();
        // GPU-assisted validation 1.3.239 stalls on every timeline: its queue thread runs into a timeout.
        Engine { by_fences: by_fences || layers.gpu_assisted, ..Engine::new(layers) }.run(test);
    }

    /// The same without checks inside shaders, for tests of many short lives: each would instrument every shader anew.
    pub fn with_plain_shaders(test: impl FnOnce(&Engine)) {
        Engine::new(Layers { gpu_assisted: false, ..crate::vulkan::layers() }).run(test);
    }

    fn run(self, test: impl FnOnce(&Engine)) {
        let engine = self;
        test(&engine);
        let messages = engine.close();
        assert!(messages.is_empty(), "{} validation messages:\n{}", messages.len(), messages.join("\n"));
    }

    pub fn messages(&self) -> Vec<String> {
        self.heard.messages.lock().unwrap().clone()
    }

    /// What the library is lent, with the engine's own allocator.
    pub fn host(&self) -> Host {
        self.host_with(self.device.clone(), Box::new(self.memory()))
    }

    pub fn host_with(&self, device: ash::Device, memory: Box<dyn GpuMemory>) -> Host {
        Host {
            instance: self.instance.clone(),
            physical_device: self.physical_device,
            device,
            enabled: self.enabled,
            memory,
            pipeline_cache: vk::PipelineCache::null(),
        }
    }

    pub fn memory(&self) -> OwnMemory {
        // SAFETY: the device belongs to the instance.
        let types = unsafe { self.instance.get_physical_device_memory_properties(self.physical_device) };
        OwnMemory {
            device: self.device.clone(),
            types,
            ledger: Arc::clone(&self.ledger),
            held: HashMap::new(),
            next: 0,
        }
    }

    pub fn command_buffer(&self) -> vk::CommandBuffer {
        let info = vk::CommandBufferAllocateInfo::default().command_pool(self.pool).command_buffer_count(1);
        // SAFETY: the pool lives.
        unsafe { self.device.allocate_command_buffers(&info) }.expect("a command buffer")[0]
    }

    pub fn begin(&self, cmd: vk::CommandBuffer) {
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the buffer is not pending: its callers waited for its last frame.
        unsafe { self.device.begin_command_buffer(cmd, &info) }.expect("begin");
    }

    /// Ends and submits; the timeline says `frame` when it is complete. No wait.
    pub fn submit(&self, cmd: vk::CommandBuffer, frame: u64) {
        let buffers = [vk::CommandBufferSubmitInfo::default().command_buffer(cmd)];
        let signals = [vk::SemaphoreSubmitInfo::default()
            .semaphore(self.timeline)
            .value(frame)
            .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)];
        let signals = if self.by_fences { &[][..] } else { &signals[..] };
        let submit = [vk::SubmitInfo2::default().command_buffer_infos(&buffers).signal_semaphore_infos(signals)];
        // SAFETY: recording, every pass is closed; the timeline only grows.
        unsafe {
            self.device.end_command_buffer(cmd).expect("end");
            let mut fence = vk::Fence::null();
            if self.by_fences {
                fence = self.device.create_fence(&Default::default(), None).expect("a fence");
                self.fences.borrow_mut().push_back((frame, fence));
            }
            self.device.queue_submit2(self.queue, &submit, fence).expect("submit");
        }
    }

    /// Waits until the timeline has reached `frame`.
    pub fn wait(&self, frame: u64) {
        if self.by_fences {
            return self.pass_fences(Some(frame));
        }
        let (semaphores, values) = ([self.timeline], [frame]);
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: the semaphore lives; its value was or will be signalled by a submit that was made.
        unsafe { self.device.wait_semaphores(&info, u64::MAX) }.expect("wait");
    }

    /// What the timeline says now.
    pub fn completed(&self) -> u64 {
        if self.by_fences {
            self.pass_fences(None);
            return self.done.get();
        }
        // SAFETY: the semaphore lives.
        unsafe { self.device.get_semaphore_counter_value(self.timeline) }.expect("a counter")
    }

    /// Takes in what is complete; waits for frames up to `wait`.
    fn pass_fences(&self, wait: Option<u64>) {
        let mut fences = self.fences.borrow_mut();
        while let Some(&(frame, fence)) = fences.front() {
            // SAFETY: the fence was submitted, and is destroyed once it has signalled.
            unsafe {
                if wait.is_some_and(|w| frame <= w) {
                    self.device.wait_for_fences(&[fence], true, u64::MAX).expect("wait");
                } else if !self.device.get_fence_status(fence).expect("a fence") {
                    return;
                }
                self.device.destroy_fence(fence, None);
            }
            fences.pop_front();
            self.done.set(frame);
        }
    }

    fn close(self) -> Vec<String> {
        assert_eq!(self.ledger.lock().unwrap().live, 0, "pieces of memory that were not given back");
        // SAFETY: all frames were waited for, and whatever was made from the device is gone, or a message follows.
        unsafe {
            self.device.device_wait_idle().expect("idle");
            self.device.destroy_semaphore(self.timeline, None);
            self.device.destroy_command_pool(self.pool, None);
            self.device.destroy_device(None);
            self.messenger.0.destroy_debug_utils_messenger(self.messenger.1, None);
            self.instance.destroy_instance(None);
        }
        self.messages()
    }
}

/// The engine's allocator: one device allocation a piece, which is all that the seam asks for.
pub struct OwnMemory {
    device: ash::Device,
    types: vk::PhysicalDeviceMemoryProperties,
    ledger: Arc<Mutex<Ledger>>,
    held: HashMap<u64, vk::DeviceMemory>,
    next: u64,
}

impl OwnMemory {
    /// With books of its own.
    pub fn with_ledger(self, ledger: Arc<Mutex<Ledger>>) -> OwnMemory {
        OwnMemory { ledger, ..self }
    }
}

impl GpuMemory for OwnMemory {
    fn allocate(&mut self, request: &MemoryRequest) -> surfel::Result<Memory> {
        let mut ledger = self.ledger.lock().unwrap();
        ledger.calls += 1;
        let refused = ledger.fail_at.is_some_and(|n| ledger.calls == n || ledger.keep_failing && ledger.calls > n);
        if refused {
            return Err(surfel::Error::OutOfDeviceMemory {
                what: request.name.to_owned(),
                requested: request.requirements.size,
            });
        }
        use vk::MemoryPropertyFlags as P;
        let wanted = match request.location {
            Location::Device => P::DEVICE_LOCAL,
            Location::Upload | Location::Readback => P::HOST_VISIBLE | P::HOST_COHERENT,
        };
        let fits = |i: &usize| {
            request.requirements.memory_type_bits >> i & 1 == 1
                && self.types.memory_types[*i].property_flags.contains(wanted)
        };
        let index = (0..self.types.memory_type_count as usize).find(fits).expect("a memory type") as u32;
        let size = request.requirements.size;
        let info = vk::MemoryAllocateInfo::default().allocation_size(size).memory_type_index(index);
        // SAFETY: the device lives; the type is one of its own; host-visible memory is mapped once, for good.
        let (memory, mapped) = unsafe {
            let memory = self.device.allocate_memory(&info, None).expect("device memory");
            let mapped = (request.location != Location::Device)
                .then(|| self.device.map_memory(memory, 0, vk::WHOLE_SIZE, Default::default()).expect("a mapping"));
            (memory, mapped.and_then(std::ptr::NonNull::new))
        };
        ledger.live += 1;
        self.next += 1;
        self.held.insert(self.next, memory);
        Ok(Memory { memory, offset: 0, size, mapped, token: self.next })
    }

    fn free(&mut self, memory: Memory) {
        let held = self.held.remove(&memory.token).expect("a piece of this allocator, given back once");
        assert_eq!(held, memory.memory, "the token and the handle belong together");
        self.ledger.lock().unwrap().live -= 1;
        // SAFETY: what was bound to it was destroyed (the seam's promise); the mapping goes with it.
        unsafe { self.device.free_memory(held, None) };
    }
}
