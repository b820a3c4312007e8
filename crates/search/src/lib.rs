//! Searches that propose points of `[0,1]^d` and are told what was observed there.
//!
//! A [`Search`] minimizes robustness. It knows no unit, no box and no physics: the caller maps a point of the unit cube
//! to a scenario, simulates it and tells the search an [`Observation`]. Every search is a plain state machine: it can
//! stop after any evaluation, and its points depend only on its coordinates' types, seed, options and observations.
//!
//! [`SEARCHES`] lists all searches with their options; [`by_name`] makes one.
//!
//! # Example
//! ```
//! use mishandle_search::{Coordinate, Observation, SearchOptions, by_name};
//!
//! let mut search = by_name("random", &[Coordinate::Continuous; 2], 7, &SearchOptions::default())?;
//! for _ in 0..300 {
//!     let Some(u) = search.ask() else { break };
//!     let value = (u[0] - 0.3).abs() + (u[1] - 0.8).abs();
//!     search.tell(&u, &Observation::from(value))?;
//! }
//! let (u, value) = search.best().expect("300 values were told");
//! assert!(value < 0.1 && (u[0] - 0.3).abs() < 0.1);
//! # Ok::<(), mishandle_search::SearchError>(())
//! ```

mod coordinate;
mod dual_annealing;
mod error;
pub mod functions;
mod lbfgsb;
mod ledger;
mod nelder_mead;
mod observation;
mod options;
mod random;
mod registry;
mod rounds;
mod search;

pub use coordinate::Coordinate;
pub use dual_annealing::{DualAnnealing, DualAnnealingOptions, VisitingDistribution};
pub use error::SearchError;
pub use lbfgsb::{Lbfgsb, LbfgsbOptions};
pub use nelder_mead::{NelderMead, NelderMeadOptions};
pub use observation::{Observation, SubformulaMinimum};
pub use options::{OptionSpec, OptionType, OptionValue, SearchOptions};
pub use random::Random;
pub use registry::{SEARCHES, SearchConstructor, SearchEntry, by_name, find_search};
pub use rounds::{AskTell, RoundBased};
pub use search::{Search, SearchEnd};
