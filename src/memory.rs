//! Whether a training fits into the memory that is free.

use mishandle_rollout::{Environment, EnvironmentSpec};
use mishandle_training::{Config, MemoryNeed};

use crate::MishandleError;

/// Checks that what a training takes is free now, where the system tells.
///
/// # Errors
/// If it is not: the process would be killed at some time, or end at once.
pub(crate) fn check(config: &Config, environment: &dyn Environment) -> Result<(), MishandleError> {
    // Without this file, as outside Linux, nothing is known.
    let free = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| available_bytes(&text));
    free.map_or(Ok(()), |free| check_fits(config.memory_needs(&EnvironmentSpec::of(environment)), free))
}

fn check_fits(mut needs: Vec<MemoryNeed>, free: f64) -> Result<(), MishandleError> {
    let all: f64 = needs.iter().map(|need| need.bytes).sum();
    if all <= free {
        return Ok(());
    }
    needs.sort_by(|a, b| b.bytes.total_cmp(&a.bytes));
    // What takes less than a tenth is not worth a change.
    let large = needs.iter().filter(|need| need.bytes >= 0.1 * all);
    let parts: Vec<String> =
        large.map(|need| format!("{} for {}", bytes(need.bytes), need.settings)).collect();
    Err(MishandleError::Memory { needed: bytes(all), free: bytes(free), parts })
}

/// `MemAvailable` of /proc/meminfo: what can be had without swapping.
fn available_bytes(meminfo: &str) -> Option<f64> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    Some(1024.0 * line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok()?)
}

/// A number of bytes, for people.
fn bytes(bytes: f64) -> String {
    if bytes < 1e9 { format!("{:.0} MB", bytes / 1e6) } else { format!("{:.1} GB", bytes / 1e9) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_memory_is_what_the_system_says_can_be_had() {
        let text = "MemTotal:       16384 kB\nMemFree:   1 kB\nMemAvailable:    2048 kB\n";
        assert_eq!(available_bytes(text), Some(2048.0 * 1024.0));
        assert_eq!(available_bytes("MemTotal: 1 kB\n"), None);
    }

    #[test]
    fn what_does_not_fit_is_told_by_its_largest_parts() {
        let need = |settings, bytes| MemoryNeed { settings, bytes };
        let needs = vec![need("small", 1e6), need("large", 3e9), need("larger", 5.5e9)];
        assert!(check_fits(needs.clone(), 8.502e9).is_ok());
        assert_eq!(
            check_fits(needs, 8.5e9).unwrap_err().to_string(),
            "the training run needs at least 8.5 GB of memory, 8.5 GB are free: 5.5 GB for larger, 3.0 GB for large"
        );
    }
}
