//! Measures the success rate, dangerous behavior rate and task completion time of a controller, with confidence intervals.
//!
//! [`evaluate`] runs simulations from random initial states. They depend only on the seed and the number of the
//! simulation, so two controllers that are evaluated with the same seed have the same initial states and the same noise.
//! [`Metrics`] reduces the verdicts to an [`EvaluationReport`]. [`wilson`], [`betting_mean`] and [`bootstrap_mean`]
//! compute the confidence intervals; `tests/coverage.rs` measures how often they contain the true value.
//!
//! Random initial states hardly ever meet a corner of the initial box. [`Corners`] are its corners and its center, which
//! [`evaluate_corners`] simulates separately.
//!
//! # Example
//! ```
//! use mishandle_evaluation::wilson;
//! let rate = wilson(85, 100);
//! assert_eq!((rate.value, rate.n), (Some(0.85), 100));
//! assert!((rate.low.unwrap() - 0.77).abs() < 0.005 && (rate.high.unwrap() - 0.91).abs() < 0.005);
//! ```

mod betting;
mod corners;
mod error;
mod interval;
mod metrics;
mod repeats;
mod run;

pub use betting::betting_mean;
pub use corners::{CornerReport, CornerResult, Corners, evaluate_corners};
pub use error::EvaluationError;
pub use interval::{Estimate, bootstrap_mean, wilson};
pub use metrics::{EvaluationReport, FormulaRoles, Metrics};
pub use repeats::{QUANTILES, RepeatReport, variance_share};
pub use run::{Evaluation, ScenarioFilter, evaluate};
