//! `surfel devices`: what could render here.

use anyhow::Result;

use surfel::standalone::Standalone;

use super::Outcome;

/// Lists them, the one that would be taken first.
pub fn run() -> Result<Outcome> {
    let devices = Standalone::devices()?;
    if devices.is_empty() {
        anyhow::bail!("no Vulkan device: install a driver, or run ./x setup for lavapipe");
    }
    let mut text = String::new();
    for d in &devices {
        text += &format!("{}\n  kind      {}\n  driver    {}\n  vulkan    {}\n", d.name, d.kind, d.driver, d.api);
        text += match d.missing.is_empty() {
            true => "  usable    yes\n",
            false => "  usable    no\n",
        };
        d.missing.iter().for_each(|m| text += &format!("  lacks     {m}\n"));
        d.without.iter().for_each(|m| text += &format!("  without   {m}\n"));
    }
    super::print(&text)?;
    Ok(Outcome::Done)
}
