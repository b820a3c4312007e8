//! Processor time, for tests of costs: other programs share the machine.

/// Returns the time that this thread had a processor, s; 0 outside of Linux.
pub fn processor_secs() -> f64 {
    let counted = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    counted.split(' ').next().and_then(|text| text.parse::<f64>().ok()).unwrap_or(0.0) / 1e9
}
