//! Traces, temporal-logic formulas and their robustness.
//!
//! A [`Trace`] holds named signals, one value per sample. A [`Formula`] is read from text in the syntax of RTAMT. A
//! [`Monitor`] is a formula compiled for the signals of a trace and a [`Clock`]; it measures robustness: how far a trace
//! is from violating the formula, as a number whose sign is the verdict.
//!
//! # Where the reading is not RTAMT's
//! RTAMT 0.4.10 reads `a - b + c` as `a - (b + c)` and `a / b * c` as `a / (b * c)`. Here `+` and `-` bind alike and group
//! to the left, and so do `*` and `/`. [`Formula`] lists the other differences of reading, [`Monitor`] those of value.
//!
//! # Example
//! ```
//! use std::sync::Arc;
//! use mishandle_stl::{Clock, Formula, Monitor, Trace};
//!
//! let names: Arc<[String]> = Arc::from(["door_yaw_deg".to_owned()]);
//! let mut trace = Trace::new(Arc::clone(&names));
//! for angle in [0.0, 12.0, 26.0] {
//!     trace.push(&[angle]);
//! }
//! let formula = Formula::parse("eventually[0:300](door_yaw_deg >= 20)").unwrap();
//! let mut monitor = Monitor::new(&formula, &names, Clock::steps(1.0 / 60.0)).unwrap();
//! assert_eq!(monitor.robustness(&trace).unwrap(), 6.0); // 26 degrees are 6 more than 20
//! ```

mod clock;
mod error;
mod explain;
mod extremum;
mod formula;
mod lexer;
mod monitor;
mod operator;
mod parser;
mod pointwise;
mod program;
mod spelling;
mod subformula;
mod trace;
mod until;

pub use clock::{Clock, Unit};
pub use error::{MonitorError, ParseError, Position};
pub use explain::Moment;
pub use formula::Formula;
pub use monitor::Monitor;
pub use spelling::nearest;
pub use subformula::SubformulaMinimum;
pub use trace::Trace;
