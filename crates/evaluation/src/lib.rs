//! Success rate, dangerous behavior rate and task completion time, with intervals.
//!
//! [`evaluate`] runs simulations from starts that depend on the seed and their number only, so that two controllers
//! evaluated with one seed are compared on the same starts and the same noise. [`Metrics`] reduces their verdicts to
//! a [`Report`]; [`wilson`], [`bootstrap_mean`] and [`bootstrap_share`] give the intervals.
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
pub use interval::{Estimate, bootstrap_mean, bootstrap_share, wilson};
pub use metrics::{Metrics, Report, Roles};
pub use run::{Accepts, Evaluation, evaluate};
