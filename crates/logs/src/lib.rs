//! Logs of robots and simulators, as samples for the monitors of `mishandle-stl`.
//!
//! - [`OpenLog`] opens CSV, JSON lines, NumPy and Parquet (`csv.rs`, `json_lines.rs`, `numpy.rs`,
//!   `parquet.rs`) and knows the names of the columns. [`OpenLog::read`] reads some of them as a
//!   [`Log`]: topics whose columns have the same times.
//! - [`Log::samples`] turns a log into [`Samples`]: even ones, resampled ones, or functions of
//!   time.
//! - A log whose clock starts again is several runs, each with samples of its own:
//!   [`Log::samples_of_runs`].
//! - [`Samples::verdict`] evaluates a formula: the robustness, when which part is violated, and the
//!   decisive predicate. [`document`] is the answer about [`Requirement`]s on several logs, worst
//!   first.
//! - [`Follow`] reads a log that is still written, sample by sample, and [`Watch`] says what the
//!   samples so far decide (`follow`).
//! - [`Options`] are the choices on this way. A choice that nobody stated is never guessed: the
//!   error names what decides it, see [`LogError::remedies`].
//! - [`Times`] keeps times exact, and finds the period of even ones, however they are rounded.
//!
//! # Example
//! ```
//! use mishandle_logs::{Interpolation, OpenLog, Options, Sampling, Signals};
//!
//! let csv = "time,d\n0,1\n0.1,2\n0.35,4\n";
//! let sampling = Sampling::Resampled(Interpolation::Hold);
//! let options = Options { sampling, period: Some(0.1), ..Options::default() };
//! let log = OpenLog::open_csv(Box::new(csv.as_bytes()), &options).unwrap();
//! let samples = log.read(&["d"]).unwrap().samples(&options).unwrap();
//! let Signals::Even { trace, .. } = samples.signals else { panic!("not resampled") };
//! assert_eq!(trace.signal("d").unwrap(), [1.0, 2.0, 2.0, 2.0]);
//! ```

mod cell;
mod csv;
mod curve;
mod date;
mod decimal;
mod error;
mod follow;
mod format;
mod half;
mod json_lines;
mod log;
mod memory;
mod numpy;
mod options;
#[cfg(feature = "parquet")]
mod parquet;
mod place;
mod requirement;
mod samples;
mod stamp;
mod table;
mod times;
mod unit_name;
mod verdict;

pub use date::offset as utc_offset;
pub use error::{LogError, Result};
pub use follow::{Answer, Follow, Following, Next, Violated, Watch, Watched};
pub use log::{Column, Log, OpenLog, Source, Topic};
pub use memory::TimeValues;
pub use mishandle_stl::{DenseSignal, Interpolation};
pub use options::{Duplicates, Format, Missing, Options, Sampling, Unit};
pub use requirement::{NamedSamples, Requirement, document, tell_apart, worst_first};
pub use samples::{Run, Samples, Signals, restarts};
pub use stamp::seconds_and_rest;
pub use times::Times;
pub use verdict::{At, Evaluation, Interval, Part, Predicate, Verdict};
