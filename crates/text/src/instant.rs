/// Formats a sample with its time, such as `step 30 (0.50 s)`. `control_dt` is the time between two
/// samples, in seconds. At 1 s, which systems without a time step have, the number of the step says
/// it all.
///
/// # Example
/// ```
/// assert_eq!(mishandle_text::instant(3, 0.1), "step 3 (0.30 s)");
/// assert_eq!(mishandle_text::instant(3, 1.0), "step 3");
/// ```
pub fn instant(sample: usize, control_dt: f64) -> String {
    if control_dt == 1.0 {
        return format!("step {sample}");
    }
    format!("step {sample} ({:.2} s)", sample as f64 * control_dt)
}

/// Formats the time of a sample, such as `0.50 s`; as a step where [`instant`] does.
///
/// # Example
/// ```
/// assert_eq!(mishandle_text::sample_time(3, 0.1), "0.30 s");
/// assert_eq!(mishandle_text::sample_time(3, 1.0), "step 3");
/// ```
pub fn sample_time(sample: usize, control_dt: f64) -> String {
    if control_dt == 1.0 { format!("step {sample}") } else { format!("{:.2} s", sample as f64 * control_dt) }
}
