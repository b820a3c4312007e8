//! The deviations of a squashed Gaussian policy, kept within bounds smoothly.
//!
//! ```text
//! log σ(h) = -5 + 3.5 (1 + tanh h),   h = 0: σ = 0.22
//! ```

/// Between which log σ lies: σ from 0.0067, which hardly moves an arm, to 7.4, with which tanh is almost a coin.
pub const LOG_STD_RANGE: (f64, f64) = (-5.0, 2.0);

/// log σ of a network's output.
///
/// # Example
/// ```
/// use mishandle_controllers::squashed::log_std;
/// assert_eq!((log_std(0.0), log_std(-100.0), log_std(100.0)), (-1.5, -5.0, 2.0));
/// ```
pub fn log_std(output: f64) -> f64 {
    let (low, high) = LOG_STD_RANGE;
    low + 0.5 * (high - low) * (1.0 + output.tanh())
}

/// Its derivative by the output.
pub fn log_std_slope(output: f64) -> f64 {
    let (low, high) = LOG_STD_RANGE;
    let tanh = output.tanh();
    0.5 * (high - low) * (1.0 - tanh * tanh)
}
