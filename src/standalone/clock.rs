//! What a thread has used of the processor.

/// Processor time of this thread so far \[ms\]; `None` where the system does not tell. What others did meanwhile is not in it.
pub fn thread_ms() -> Option<f64> {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        Some(1e3 * time.tv_sec as f64 + 1e-6 * time.tv_nsec as f64)
    }
    #[cfg(not(unix))]
    None
}
