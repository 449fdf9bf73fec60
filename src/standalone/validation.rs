//! The validation layers: switched on, listened to, and asked whether they are really on.

use std::ffi::{CStr, c_void};
use std::sync::{Mutex, PoisonError};

use ash::vk;

/// Name of the layer.
pub const LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Switches on the search for hazards between submits, which has no switch in the API: only the environment
/// (`VK_LAYER_ENABLES`, which is added to) or a settings file in the working directory reaches it.
///
/// # Safety
/// No other thread reads or writes the environment meanwhile: call it first in `main`.
pub unsafe fn check_across_submits() {
    const NAME: &str = "VK_LAYER_ENABLES";
    const CHECK: &str = "VALIDATION_CHECK_ENABLE_SYNCHRONIZATION_VALIDATION_QUEUE_SUBMIT";
    let value = std::env::var(NAME).unwrap_or_default();
    if !value.contains(CHECK) {
        let separator = if value.is_empty() { "" } else { ":" };
        // SAFETY: nobody else uses the environment now (a precondition).
        unsafe { std::env::set_var(NAME, format!("{value}{separator}{CHECK}")) };
    }
}

/// Which checks run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Layers {
    /// Core, parameters, threads, lifetimes.
    pub core: bool,
    /// Hazards within and across submits.
    pub sync: bool,
    /// Checks in the shaders.
    pub gpu_assisted: bool,
}

impl Layers {
    /// Core and synchronisation: what every test runs with.
    pub const CORE_SYNC: Layers = Layers { core: true, sync: true, gpu_assisted: false };

    /// Parses `core,sync,gpu-av`; unknown names are returned as the error.
    pub fn parse(list: &str) -> Result<Layers, String> {
        let mut layers = Layers::default();
        for name in list.split(',').map(str::trim).filter(|n| !n.is_empty()) {
            match name {
                "core" => layers.core = true,
                "sync" => layers.sync = true,
                "gpu-av" => layers.gpu_assisted = true,
                other => return Err(format!("unknown layer check {other:?}: core, sync, gpu-av")),
            }
        }
        if !layers.any() {
            return Err("no layer check named: core, sync, gpu-av".into());
        }
        Ok(layers)
    }

    /// Whether the layer is loaded at all.
    pub fn any(self) -> bool {
        self.core || self.sync || self.gpu_assisted
    }

    /// Which of these checks the layer's own account (see [`Listener::enables`]) does not name.
    ///
    /// Hazards between submits have no switch in the API, only in the settings (`vk_layer_settings.txt`, or the variable
    /// `VK_LAYER_ENABLES`), so a process in another folder may well lack them.
    pub fn lacking(self, enables: &str) -> Vec<&'static str> {
        // The layer leaves the enums' `_EXT` out, other versions may not.
        let words = |w: &str| w.trim_end_matches("_EXT").to_owned();
        let on = |name: &str| enables.split([' ', ',', ':', '.', '\n']).any(|word| words(word) == name);
        let checks = [
            (self.any(), "core", enables.contains("Current Enables") && enables.contains("Current Disables: None")),
            (self.sync, "sync", on("VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION")),
            (self.sync, "sync across submits", on("VALIDATION_CHECK_ENABLE_SYNCHRONIZATION_VALIDATION_QUEUE_SUBMIT")),
            (self.gpu_assisted, "gpu-av", on("VK_VALIDATION_FEATURE_ENABLE_GPU_ASSISTED")),
        ];
        checks.into_iter().filter(|(wanted, _, there)| *wanted && !there).map(|(_, name, _)| name).collect()
    }

    /// What to enable in the instance.
    pub fn features(self) -> Vec<vk::ValidationFeatureEnableEXT> {
        let mut features = Vec::new();
        if self.sync {
            features.push(vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION);
        }
        if self.gpu_assisted {
            features.push(vk::ValidationFeatureEnableEXT::GPU_ASSISTED);
            features.push(vk::ValidationFeatureEnableEXT::GPU_ASSISTED_RESERVE_BINDING_SLOT);
        }
        features
    }
}

/// One message of the layers, warning or error.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// Such as `VUID-VkBufferCreateInfo-size-00912`.
    pub id: String,
    /// The whole text.
    pub text: String,
}

/// Collects what the layers say. Its address is given to Vulkan, so it lives in a `Box` as long as the instance.
#[derive(Debug, Default)]
pub struct Listener {
    messages: Mutex<Vec<Message>>,
    enables: Mutex<String>,
}

/// Id of the message by which the layer says what is on.
const STATUS: &str = "UNASSIGNED-khronos-validation-createinstance-status-message";

impl Listener {
    /// Warnings and errors so far.
    pub fn messages(&self) -> Vec<Message> {
        self.messages.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Forgets them, and returns them.
    pub fn take(&self) -> Vec<Message> {
        std::mem::take(&mut self.messages.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// What the layer said is enabled, as it said it; empty where the layer is not loaded.
    pub fn enables(&self) -> String {
        self.enables.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The messenger that reports to this listener, which must outlive it and stay where it is.
    pub fn messenger(&self) -> vk::DebugUtilsMessengerCreateInfoEXT<'_> {
        use vk::DebugUtilsMessageSeverityFlagsEXT as Severity;
        use vk::DebugUtilsMessageTypeFlagsEXT as Type;
        vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(Severity::ERROR | Severity::WARNING | Severity::INFO)
            .message_type(Type::VALIDATION | Type::PERFORMANCE | Type::GENERAL)
            .pfn_user_callback(Some(callback))
            .user_data(std::ptr::from_ref(self).cast_mut().cast())
    }

    fn hear(&self, severity: vk::DebugUtilsMessageSeverityFlagsEXT, id: String, text: String) {
        if id == STATUS {
            *self.enables.lock().unwrap_or_else(PoisonError::into_inner) = text;
        } else if severity > vk::DebugUtilsMessageSeverityFlagsEXT::INFO {
            self.messages.lock().unwrap_or_else(PoisonError::into_inner).push(Message { id, text });
        }
    }
}

unsafe extern "system" fn callback(
    severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: `user` is the listener given in `messenger`, which outlives the messenger; `data` and its strings are
    // valid during the call. Panics do not cross: the locks recover from poisoning and nothing else can fail.
    unsafe {
        let text = |p: *const std::ffi::c_char| {
            if p.is_null() { String::new() } else { CStr::from_ptr(p).to_string_lossy().into_owned() }
        };
        let (id, message) = (text((*data).p_message_id_name), text((*data).p_message));
        // The loader speaks as GENERAL: about manifests and drivers of the machine, not about our calls.
        if kind != vk::DebugUtilsMessageTypeFlagsEXT::GENERAL || id == STATUS {
            (*user.cast::<Listener>()).hear(severity, id, message);
        }
    }
    vk::FALSE
}
