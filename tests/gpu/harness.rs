//! The harness is tested too: what it must catch is provoked.

use std::panic::{AssertUnwindSafe, catch_unwind};

use surfel::ash::vk;
use surfel::readback::Picture;
use surfel::standalone::{Layers, Standalone};

use crate::vulkan;

fn panic_text(run: impl FnOnce()) -> String {
    let panic = catch_unwind(AssertUnwindSafe(run)).expect_err("it must panic");
    match panic.downcast::<String>() {
        Ok(text) => *text,
        Err(other) => other.downcast::<&str>().map(|s| s.to_string()).unwrap_or_default(),
    }
}

/// Core checks alone, whatever the run asks for: these tests need a layer that speaks.
fn with_core(test: impl FnOnce(Standalone) -> Standalone) {
    let options =
        surfel::standalone::Options { layers: Layers { core: true, ..vulkan::layers() }, ..vulkan::options() };
    vulkan::run_with(&options, test);
}

#[test]
fn a_clean_test_passes() {
    with_core(|standalone| standalone);
}

#[test]
fn a_provoked_error_fails_the_test() {
    let text = panic_text(|| {
        with_core(|standalone| {
            let info = vk::BufferCreateInfo::default().size(0).usage(vk::BufferUsageFlags::TRANSFER_SRC);
            // SAFETY: misuse is the purpose: the layer refuses a size of zero before the driver sees it.
            if let Ok(buffer) = unsafe { standalone.device.create_buffer(&info, None) } {
                // SAFETY: just made.
                unsafe { standalone.device.destroy_buffer(buffer, None) };
            }
            standalone
        });
    });
    assert!(text.contains("VUID-VkBufferCreateInfo-size-00912"), "{text}");
}

#[test]
fn what_is_left_alive_fails_the_test() {
    let text = panic_text(|| {
        with_core(|standalone| {
            // SAFETY: the device lives. It is left alive on purpose.
            unsafe { standalone.device.create_fence(&Default::default(), None) }.expect("a fence");
            standalone
        });
    });
    assert!(text.contains("VUID-vkDestroyDevice-device-00378"), "{text}");
}

#[test]
fn a_check_that_is_not_on_is_noticed() {
    let only_core = Layers { core: true, sync: false, gpu_assisted: false };
    let options = surfel::standalone::Options { layers: only_core, ..vulkan::options() };
    vulkan::run_with(&options, |standalone| {
        let all = Layers { core: true, sync: true, gpu_assisted: true };
        let lacking = standalone.lacking(all);
        assert!(lacking.contains(&"sync") && lacking.contains(&"gpu-av"), "{lacking:?}: {}", standalone.enables());
        assert!(!lacking.contains(&"core"), "{lacking:?}");
        standalone
    });
    // Without the layer, nothing is on.
    assert_eq!(Layers::CORE_SYNC.lacking(""), ["core", "sync", "sync across submits"]);
}

#[test]
fn the_hash_sees_every_bit() {
    let picture = Picture { width: 2, height: 1, rgba: vec![[0.0; 4], [0.5; 4]], depth: Some(vec![0.0, 1.0]) };
    let mut others = vec![picture.clone(); 4];
    others[0].rgba[0][3] = -0.0;
    others[1].depth = None;
    others[2].rgba.swap(0, 1);
    (others[3].width, others[3].height) = (1, 2);
    for other in &others {
        assert_ne!(vulkan::digest(other), vulkan::digest(&picture));
    }
    assert_eq!(vulkan::digest(&picture.clone()), vulkan::digest(&picture));
}
