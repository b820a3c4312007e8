//! The standard deviation of a squashed Gaussian policy, smoothly bounded.
//!
//! h is the network's output for an action. Formula and bounds are those of CleanRL's soft
//! actor-critic.
//!
//! ```text
//! log σ(h) = -5 + 3.5 (1 + tanh h),   h = 0: σ = 0.22
//! ```

/// Bounds of log σ: σ from 0.0067, with almost no exploration, to 7.4, with which tanh is almost
/// always near ±1.
pub const LOG_STD_RANGE: (f64, f64) = (-5.0, 2.0);

/// Returns log σ for a network output h.
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

/// Returns the derivative of [`log_std`] with respect to the network output.
pub fn log_std_slope(output: f64) -> f64 {
    let (low, high) = LOG_STD_RANGE;
    let tanh = output.tanh();
    0.5 * (high - low) * (1.0 - tanh * tanh)
}
