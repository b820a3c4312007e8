//! Archives of failures: what searches found, as scenarios to train on.

mod recorded;
mod simulated;
mod table;
mod weights;

pub use recorded::recorded_failures;
pub(crate) use recorded::simulated_in;
pub(crate) use simulated::{ModeKey, Modes, mode_key, simulated};
pub(crate) use table::{TABLE, given_scenarios};
pub(crate) use weights::{Simulated, csv, shows_nan, weighted};
