//! What the system says about memory. Everything is `None` where it says nothing.

/// The most memory that this process held so far [bytes].
pub fn peak_rss() -> Option<u64> {
    field("/proc/self/status", "VmHWM:")
}

/// Memory that could be had without swapping [bytes].
pub fn available() -> Option<u64> {
    field("/proc/meminfo", "MemAvailable:")
}

fn field(file: &str, name: &str) -> Option<u64> {
    kib(&std::fs::read_to_string(file).ok()?, name)
}

/// The bytes of a line such as `VmHWM:   123 kB`.
fn kib(text: &str, name: &str) -> Option<u64> {
    let rest = text.lines().find_map(|line| line.strip_prefix(name))?;
    rest.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// Refuses what needs more memory than there is, before the system kills somebody for it.
pub fn ensure(what: &str, bytes: u64) -> anyhow::Result<()> {
    match available() {
        Some(free) if bytes > free => {
            anyhow::bail!("{what} needs about {} of memory, and {} are free", human(bytes), human(free))
        }
        _ => Ok(()),
    }
}

/// Bytes for people.
pub fn human(bytes: u64) -> String {
    let mib = bytes as f64 / (1 << 20) as f64;
    if mib < 1024.0 { format!("{mib:.1} MiB") } else { format!("{:.1} GiB", mib / 1024.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_proc() {
        let text = "Name:\tx\nVmHWM:\t   12 kB\nVmRSS:\t 7 kB\n";
        assert_eq!(kib(text, "VmHWM:"), Some(12 << 10));
        assert_eq!(kib(text, "VmSwap:"), None);
        assert_eq!(kib("VmHWM: 99999999999999999999 kB", "VmHWM:"), None);
        assert_eq!(human(3 << 30), "3.0 GiB");
    }
}
