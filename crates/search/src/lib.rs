//! Searches that propose points of `[0,1]^d` and are told their value.
//!
//! A [`Search`] minimises. It knows no unit, no box and no physics: whoever evaluates maps a point of the unit
//! cube to what is simulated and tells one number back. Every search is a plain state machine, so it can be
//! stopped after any evaluation, and its points depend only on its seed, its options and the values told.
//!
//! [`SEARCHES`] lists what there is; [`by_name`] makes one.
//!
//! # Example
//! ```
//! use mishandle_search::{SearchOptions, by_name};
//!
//! let mut search = by_name("random", 2, 7, &SearchOptions::default())?;
//! for _ in 0..300 {
//!     let Some(u) = search.ask() else { break };
//!     let value = (u[0] - 0.3).abs() + (u[1] - 0.8).abs();
//!     search.tell(&u, value)?;
//! }
//! let (u, value) = search.best().expect("300 values were told");
//! assert!(value < 0.1 && (u[0] - 0.3).abs() < 0.1);
//! # Ok::<(), mishandle_search::SearchError>(())
//! ```

mod dual_annealing;
mod error;
pub mod functions;
mod lbfgsb;
mod ledger;
mod nelder_mead;
mod random;
mod random_stream;
mod registry;
mod rounds;
mod search;

pub use dual_annealing::{DualAnnealing, DualAnnealingOptions, VisitingDistribution};
pub use error::SearchError;
pub use lbfgsb::{Lbfgsb, LbfgsbOptions};
pub use nelder_mead::{NelderMead, NelderMeadOptions};
pub use random::Random;
pub use random_stream::{RandomStream, philox4x32};
pub use registry::{Make, SEARCHES, SearchEntry, SearchOptions, by_name};
pub use rounds::{AskTell, RoundBased};
pub use search::{Finish, Search};
