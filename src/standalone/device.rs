//! Instance, device, queue.

use std::ffi::CStr;
use std::sync::{Arc, Mutex};

use ash::{ext, vk};
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};

use super::validation::{LAYER, Layers, Listener, Message};
use crate::error::{Error, Named, Result};
use crate::gpu::{Context, SharedAllocator};
use crate::host::{Enabled, Host, Interlock, Requirements};

/// What kind of device is wanted.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Part of its name; otherwise the fastest kind that can run the renderer.
    pub device: Option<String>,
    /// Validation.
    pub layers: Layers,
    /// Enable `VK_EXT_robustness2`: pictures must not change.
    pub robustness: bool,
    /// Optional features to do without, by the names that [`Requirements`] has for them: forces what stands in, so that
    /// tests cover it.
    pub without: Vec<String>,
    /// Take the interlock for granted where its extension is missing: see [`Interlock::Implicit`].
    pub implicit_interlock: bool,
}

/// A device of this machine.
#[derive(Debug, Clone)]
pub struct DeviceInfo {
    /// As the driver names it.
    pub name: String,
    /// Kind, such as `discrete` or `cpu`.
    pub kind: &'static str,
    /// Driver's name and version.
    pub driver: String,
    /// Vulkan version.
    pub api: String,
    /// Required items that it lacks; empty: the renderer runs on it.
    pub missing: Vec<String>,
    /// Optional items that it lacks.
    pub without: Vec<String>,
}

/// A Vulkan of our own. Fields are public so that tests can play the host.
pub struct Standalone {
    /// Instance.
    pub instance: ash::Instance,
    /// The chosen device.
    pub physical_device: vk::PhysicalDevice,
    /// Device.
    pub device: ash::Device,
    /// Its only queue: graphics and compute.
    pub queue: vk::Queue,
    /// The queue's family.
    pub family: u32,
    /// What was enabled.
    pub enabled: Enabled,
    /// About the chosen device.
    pub info: DeviceInfo,
    /// Allocator shared with renderers; taken apart before the device goes.
    pub allocator: Option<Arc<Mutex<Allocator>>>,
    pool: vk::CommandPool,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    listener: Box<Listener>,
    closed: bool,
    // Last: the library that everything above was loaded from.
    _entry: ash::Entry,
}

fn load() -> Result<ash::Entry> {
    // SAFETY: the system's Vulkan loader is trusted to initialise properly.
    unsafe { ash::Entry::load() }.map_err(|e| {
        Error::Unsupported(format!("no Vulkan loader ({e}): install libvulkan1 and a driver, or run ./x setup"))
    })
}

fn text(chars: &[std::ffi::c_char]) -> String {
    let bytes: Vec<u8> = chars.iter().map(|c| *c as u8).take_while(|b| *b != 0).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

fn version(v: u32) -> String {
    format!("{}.{}.{}", vk::api_version_major(v), vk::api_version_minor(v), vk::api_version_patch(v))
}

fn describe(instance: &ash::Instance, device: vk::PhysicalDevice) -> DeviceInfo {
    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    let mut chain = vk::PhysicalDeviceProperties2::default().push_next(&mut driver);
    // SAFETY: the device belongs to the instance; the struct is known to Vulkan 1.2 and ignored before.
    unsafe { instance.get_physical_device_properties2(device, &mut chain) };
    let properties = chain.properties;
    let requirements = Requirements::query(instance, device);
    let kind = match properties.device_type {
        vk::PhysicalDeviceType::DISCRETE_GPU => "discrete",
        vk::PhysicalDeviceType::INTEGRATED_GPU => "integrated",
        vk::PhysicalDeviceType::VIRTUAL_GPU => "virtual",
        vk::PhysicalDeviceType::CPU => "cpu",
        _ => "other",
    };
    let lacks = |required| {
        let items = requirements.items.iter().filter(|i| i.required == required && !i.present);
        items.map(|i| i.to_string()).collect()
    };
    DeviceInfo {
        name: text(&properties.device_name),
        kind,
        driver: format!("{} {}", text(&driver.driver_name), text(&driver.driver_info)).trim().to_owned(),
        api: version(properties.api_version),
        missing: lacks(true),
        without: lacks(false),
    }
}

/// Lower is better.
fn rank(info: &DeviceInfo) -> usize {
    ["discrete", "integrated", "virtual", "other", "cpu"].iter().position(|k| *k == info.kind).unwrap_or(9)
}

impl Standalone {
    /// All devices of this machine, best first.
    pub fn devices() -> Result<Vec<DeviceInfo>> {
        let entry = load()?;
        let listener = Box::<Listener>::default();
        let instance = make_instance(&entry, Layers::default(), &listener)?;
        // SAFETY: the instance lives.
        let devices = unsafe { instance.enumerate_physical_devices() }.named("vkEnumeratePhysicalDevices");
        let infos = devices.map(|all| {
            let mut infos: Vec<_> = all.into_iter().map(|d| describe(&instance, d)).collect();
            infos.sort_by_key(rank);
            infos
        });
        // SAFETY: nothing made from it is left.
        unsafe { instance.destroy_instance(None) };
        infos
    }

    /// Makes everything. Fails, saying what is there, where no device can run the renderer.
    pub fn new(options: &Options) -> Result<Standalone> {
        let entry = load()?;
        let listener = Box::<Listener>::default();
        let instance = make_instance(&entry, options.layers, &listener)?;
        let mut messenger = None;
        let made = (|| {
            if has_debug_utils(&entry)? {
                let functions = ext::debug_utils::Instance::new(&entry, &instance);
                // SAFETY: the listener is boxed and outlives the messenger, which `drop` destroys first.
                let handle = unsafe { functions.create_debug_utils_messenger(&listener.messenger(), None) }
                    .named("vkCreateDebugUtilsMessengerEXT")?;
                messenger = Some((functions, handle));
            }
            let (physical_device, info) = choose(&instance, options)?;
            make_device(&instance, physical_device, options, messenger.is_some()).map(|d| (physical_device, info, d))
        })();
        let (physical_device, info, (device, family, enabled)) = match made {
            Ok(made) => made,
            Err(e) => {
                // SAFETY: nothing else was made from the instance.
                unsafe {
                    if let Some((functions, handle)) = messenger {
                        functions.destroy_debug_utils_messenger(handle, None);
                    }
                    instance.destroy_instance(None);
                }
                return Err(e);
            }
        };
        // SAFETY: the family was enabled with one queue.
        let queue = unsafe { device.get_device_queue(family, 0) };
        let mut standalone = Standalone {
            instance,
            physical_device,
            device,
            queue,
            family,
            enabled,
            info,
            allocator: None,
            pool: vk::CommandPool::null(),
            messenger,
            listener,
            closed: false,
            _entry: entry,
        };
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: standalone.instance.clone(),
            device: standalone.device.clone(),
            physical_device,
            debug_settings: Default::default(),
            buffer_device_address: false,
            allocation_sizes: Default::default(),
        })
        .map_err(|e| Error::Unsupported(format!("allocator: {e}")))?;
        standalone.allocator = Some(Arc::new(Mutex::new(allocator)));
        let info = vk::CommandPoolCreateInfo::default()
            .queue_family_index(family)
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
        // SAFETY: the device lives.
        standalone.pool = unsafe { standalone.device.create_command_pool(&info, None) }.named("vkCreateCommandPool")?;
        Ok(standalone)
    }

    /// Lends the device to a renderer, as a host would.
    pub fn host(&self) -> Host {
        let allocator = self.allocator.as_ref().expect("there until drop");
        Host {
            instance: self.instance.clone(),
            physical_device: self.physical_device,
            device: self.device.clone(),
            enabled: self.enabled,
            memory: Box::new(SharedAllocator::new(Arc::clone(allocator))),
            pipeline_cache: vk::PipelineCache::null(),
        }
    }

    /// The device as `gpu` sees it, for targets of our own.
    pub(super) fn context(&self) -> Context {
        let host = self.host();
        Context::new(&host.instance, host.physical_device, host.device, host.enabled, host.pipeline_cache, host.memory)
    }

    /// Warnings and errors of the layers so far.
    pub fn messages(&self) -> Vec<Message> {
        self.listener.messages()
    }

    /// Forgets them, and returns them.
    pub fn take_messages(&self) -> Vec<Message> {
        self.listener.take()
    }

    /// Wanted checks that the layers do not say are on; empty: all run.
    pub fn lacking(&self, wanted: Layers) -> Vec<&'static str> {
        wanted.lacking(&self.enables())
    }

    /// What the layers said is enabled; empty where they are not loaded.
    pub fn enables(&self) -> String {
        self.listener.enables()
    }

    /// A new primary command buffer; freed with the device.
    pub fn command_buffer(&self) -> Result<vk::CommandBuffer> {
        let info = vk::CommandBufferAllocateInfo::default().command_pool(self.pool).command_buffer_count(1);
        // SAFETY: the pool lives and is used by this thread alone.
        let buffers = unsafe { self.device.allocate_command_buffers(&info) }.named("vkAllocateCommandBuffers")?;
        Ok(buffers[0])
    }

    /// Records, submits and waits.
    pub fn run(&self, cmd: vk::CommandBuffer, record: impl FnOnce(vk::CommandBuffer) -> Result<()>) -> Result<()> {
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the buffer is ours and not pending, since every run waits.
        unsafe { self.device.begin_command_buffer(cmd, &begin) }.named("vkBeginCommandBuffer")?;
        let recorded = record(cmd);
        // SAFETY: recording was begun above, and every pass was closed.
        unsafe { self.device.end_command_buffer(cmd) }.named("vkEndCommandBuffer")?;
        recorded?;
        let buffers = [vk::CommandBufferSubmitInfo::default().command_buffer(cmd)];
        let submit = [vk::SubmitInfo2::default().command_buffer_infos(&buffers)];
        // SAFETY: the device lives; the fence is destroyed after the wait.
        unsafe {
            let fence = self.device.create_fence(&Default::default(), None).named("vkCreateFence")?;
            let done = self
                .device
                .queue_submit2(self.queue, &submit, fence)
                .named("vkQueueSubmit2")
                .and_then(|()| self.device.wait_for_fences(&[fence], true, u64::MAX).named("vkWaitForFences"));
            self.device.destroy_fence(fence, None);
            done
        }
    }
}

impl Standalone {
    /// Destroys everything, and returns the messages until after the end: what was left alive is among them.
    pub fn close(mut self) -> Vec<Message> {
        self.tear_down();
        self.listener.take()
    }

    fn tear_down(&mut self) {
        if std::mem::replace(&mut self.closed, true) {
            return;
        }
        // SAFETY: everything that was made from the device is gone or waited for: renderers and targets are destroyed
        // by their owners first, and the queue is idle after the wait. The allocator goes before its device.
        unsafe {
            let _ = self.device.device_wait_idle();
            self.device.destroy_command_pool(self.pool, None);
            self.allocator = None;
            self.device.destroy_device(None);
            if let Some((functions, handle)) = self.messenger.take() {
                functions.destroy_debug_utils_messenger(handle, None);
            }
            self.instance.destroy_instance(None);
        }
    }
}

impl Drop for Standalone {
    fn drop(&mut self) {
        self.tear_down();
    }
}

fn has_debug_utils(entry: &ash::Entry) -> Result<bool> {
    // SAFETY: no precondition.
    let extensions = unsafe { entry.enumerate_instance_extension_properties(None) }
        .named("vkEnumerateInstanceExtensionProperties")?;
    Ok(extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(ext::debug_utils::NAME)))
}

fn make_instance(entry: &ash::Entry, layers: Layers, listener: &Listener) -> Result<ash::Instance> {
    // SAFETY: no precondition.
    let api = unsafe { entry.try_enumerate_instance_version() }.named("vkEnumerateInstanceVersion")?;
    if api.unwrap_or(vk::API_VERSION_1_0) < vk::API_VERSION_1_3 {
        return Err(Error::Unsupported("this Vulkan loader is older than 1.3".into()));
    }
    let mut extensions = Vec::new();
    let debug_utils = has_debug_utils(entry)?;
    if debug_utils {
        extensions.push(ext::debug_utils::NAME.as_ptr());
    }
    let mut layer_names = Vec::new();
    if layers.any() {
        // SAFETY: no precondition.
        let there =
            unsafe { entry.enumerate_instance_layer_properties() }.named("vkEnumerateInstanceLayerProperties")?;
        if !there.iter().any(|l| l.layer_name_as_c_str() == Ok(LAYER)) {
            return Err(Error::Unsupported(
                "validation was asked for, and the layer VK_LAYER_KHRONOS_validation is not installed".into(),
            ));
        }
        layer_names.push(LAYER.as_ptr());
        extensions.push(ext::validation_features::NAME.as_ptr());
    }
    let application = vk::ApplicationInfo::default()
        .application_name(c"surfel")
        .engine_name(c"surfel")
        .api_version(vk::API_VERSION_1_3);
    let features = layers.features();
    let mut validation = vk::ValidationFeaturesEXT::default().enabled_validation_features(&features);
    let mut messenger = listener.messenger();
    let mut info = vk::InstanceCreateInfo::default()
        .application_info(&application)
        .enabled_layer_names(&layer_names)
        .enabled_extension_names(&extensions);
    if layers.any() {
        info = info.push_next(&mut validation);
    }
    if debug_utils {
        info = info.push_next(&mut messenger);
    }
    // SAFETY: the description and all that it points to live until the call returns; the listener longer.
    unsafe { entry.create_instance(&info, None) }.named("vkCreateInstance")
}

fn choose(instance: &ash::Instance, options: &Options) -> Result<(vk::PhysicalDevice, DeviceInfo)> {
    // SAFETY: the instance lives.
    let devices = unsafe { instance.enumerate_physical_devices() }.named("vkEnumeratePhysicalDevices")?;
    let mut all: Vec<_> = devices.into_iter().map(|d| (d, describe(instance, d))).collect();
    all.sort_by_key(|(_, info)| rank(info));
    let names = || all.iter().map(|(_, i)| i.name.as_str()).collect::<Vec<_>>().join(", ");
    if all.is_empty() {
        return Err(Error::Unsupported("no Vulkan device: install a driver, or run ./x setup for lavapipe".into()));
    }
    let wanted = |info: &DeviceInfo| {
        options.device.as_ref().is_none_or(|d| info.name.to_lowercase().contains(&d.to_lowercase()))
    };
    let named: Vec<_> = all.iter().filter(|(_, info)| wanted(info)).collect();
    if named.is_empty() {
        return Err(Error::Unsupported(format!("no device of that name; there are: {}", names())));
    }
    match named.iter().find(|(_, info)| info.missing.is_empty()) {
        Some((device, info)) => Ok((*device, info.clone())),
        None => {
            let (_, info) = named[0];
            Err(Error::Unsupported(format!("{} lacks {}", info.name, info.missing.join(", "))))
        }
    }
}

fn make_device(
    instance: &ash::Instance,
    physical_device: vk::PhysicalDevice,
    options: &Options,
    debug_utils: bool,
) -> Result<(ash::Device, u32, Enabled)> {
    // SAFETY: the physical device belongs to the instance.
    let families = unsafe { instance.get_physical_device_queue_family_properties(physical_device) };
    let both = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    let family = families
        .iter()
        .position(|f| f.queue_flags.contains(both))
        .ok_or_else(|| Error::Unsupported("no queue family with graphics and compute".into()))? as u32;

    let mut requirements = Requirements::query(instance, physical_device);
    requirements.without(&options.without)?;
    let mut enabled = requirements.enabled(debug_utils);
    enabled.timestamps &= families[family as usize].timestamp_valid_bits > 0;
    let mut core = requirements.features;
    if options.implicit_interlock && enabled.interlock == Interlock::Absent {
        enabled.interlock = Interlock::Implicit;
        core = core.fragment_stores_and_atomics(true).shader_storage_image_extended_formats(true);
    }
    let mut extensions: Vec<&CStr> = requirements.extensions.clone();
    if options.layers.gpu_assisted {
        // SAFETY: as above.
        let there = unsafe { instance.get_physical_device_features(physical_device) };
        core = core
            .vertex_pipeline_stores_and_atomics(there.vertex_pipeline_stores_and_atomics == vk::TRUE)
            .fragment_stores_and_atomics(there.fragment_stores_and_atomics == vk::TRUE)
            // For the canary whose shader picks a descriptor.
            .shader_storage_buffer_array_dynamic_indexing(
                there.shader_storage_buffer_array_dynamic_indexing == vk::TRUE,
            );
    }
    let mut robustness = vk::PhysicalDeviceRobustness2FeaturesEXT::default();
    if options.robustness {
        core = core.robust_buffer_access(true);
        robustness = robustness.robust_buffer_access2(true).robust_image_access2(true);
        extensions.push(ext::robustness2::NAME);
    }
    let priorities = [1.0];
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&priorities)];
    let extensions: Vec<_> = extensions.iter().map(|e| e.as_ptr()).collect();
    let mut info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&extensions)
        .enabled_features(&core);
    info = requirements.chain(info);
    if options.robustness {
        info = info.push_next(&mut robustness);
    }
    // SAFETY: the description and all that it points to live until the call returns.
    let device = unsafe { instance.create_device(physical_device, &info, None) }.named("vkCreateDevice")?;
    Ok((device, family, enabled))
}
