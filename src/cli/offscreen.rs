//! A device and a target for commands that draw: opened, used, and closed so that the layers can tell what was left alive.

use std::io::{self, Write};

use anyhow::{Result, bail};
use clap::Args;

use surfel::ash::vk;
use surfel::standalone::{DeviceInfo, Layers, Offscreen, Options, Standalone};

use super::memory;

/// Which device, and how.
#[derive(Debug, Args)]
pub struct DeviceArgs {
    /// Part of the name of the device to use [default: the fastest kind].
    #[arg(long, value_name = "NAME")]
    pub device: Option<String>,
    /// Optional features of the device to do without, by Vulkan's names (`surfel devices` lists them): draws what stands in.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    pub without: Vec<String>,
    /// Runs with Vulkan's validation layers; exit code 3 if they say anything.
    #[arg(long)]
    pub validate: bool,
}

/// Runs `body` with a target of this size, and tells on stderr what the layers said. Returns what it made, and the number of those
/// messages.
pub fn with<T>(
    args: &DeviceArgs,
    size: [u32; 2],
    depth: bool,
    body: impl FnOnce(DeviceInfo, &mut Offscreen) -> Result<T>,
) -> Result<(T, usize)> {
    let layers = if args.validate { Layers::CORE_SYNC } else { Layers::default() };
    let options = Options { device: args.device.clone(), layers, without: args.without.clone(), ..Default::default() };
    let standalone = Standalone::new(&options)?;
    let lacking = standalone.lacking(layers);
    if !lacking.is_empty() {
        bail!("--validate: checks that the layers do not switch on: {}", lacking.join(", "));
    }
    let device = standalone.info.clone();
    fits(&device, size)?;
    let [width, height] = size;
    let mut offscreen = Offscreen::new(standalone, vk::Extent2D { width, height }, depth)?;
    let done = body(device, &mut offscreen);
    // Whatever happened: destroyed in order, so that the layers can tell what was left alive.
    let messages = offscreen.destroy().close();
    for message in &messages {
        // Nothing is left to do where stderr is closed.
        let _ = writeln!(io::stderr(), "validation: {}: {}", message.id, message.text);
    }
    Ok((done?, messages.len()))
}

/// Targets lie in this machine's memory where the device is its processor; what is read back always does.
fn fits(device: &DeviceInfo, [width, height]: [u32; 2]) -> Result<()> {
    // Read back: as copied, as bytes, as floats, encoded. Targets: three of four floats, and a depth.
    let a_pixel = 16 + 16 + 16 + 8 + if device.kind == "cpu" { 3 * 16 + 4 } else { 0 };
    let pixels = width as u64 * height as u64;
    memory::ensure(&format!("a picture of {width}x{height}"), pixels.saturating_mul(a_pixel))
}
