//! Dense time: robustness over signals with samples at any times, without resampling.
//!
//! Signals are piecewise constant or piecewise linear; the robustness is computed exactly, at all
//! times. Values, limits and breakpoints follow from the breakpoints of the operands: samples,
//! crossings of two lines, zeros of `abs`, and ends of windows. See [`DenseMonitor`].

mod arithmetic;
mod decisive;
mod error;
mod evaluation;
mod log;
mod monitor;
mod pick;
mod piecewise;
mod robustness;
mod signal;
mod time;
mod until;
mod window;

pub use decisive::{DenseDiagnosis, DensePredicate};
pub use error::DenseError;
pub use monitor::DenseMonitor;
pub use robustness::{Breakpoint, DenseRobustness, Violation};
pub use signal::{DenseSignal, Interpolation};
