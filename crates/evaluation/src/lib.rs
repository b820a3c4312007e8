//! Measures the success rate, dangerous behavior rate and task completion time of a controller, with confidence intervals.
//!
//! [`evaluate`] runs simulations from random initial states. They depend only on the seed and the number of the
//! simulation, so two controllers that are evaluated with the same seed have the same initial states and the same noise.
//! [`Metrics`] reduces the verdicts to an [`EvaluationReport`]. [`wilson`], [`bootstrap_mean`] and
//! [`bootstrap_fraction`] compute the confidence intervals.
//!
//! # Example
//! ```
//! use mishandle_evaluation::wilson;
//! let rate = wilson(85, 100);
//! assert_eq!((rate.value, rate.n), (Some(0.85), 100));
//! assert!((rate.low.unwrap() - 0.77).abs() < 0.005 && (rate.high.unwrap() - 0.91).abs() < 0.005);
//! ```

mod error;
mod interval;
mod metrics;
mod run;

pub use error::EvaluationError;
pub use interval::{Estimate, bootstrap_fraction, bootstrap_mean, wilson};
pub use metrics::{EvaluationReport, FormulaRoles, Metrics};
pub use run::{Evaluation, ScenarioFilter, evaluate};
