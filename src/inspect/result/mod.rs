//! Findings about the simulations of a run, as results.

mod explanation;
mod modes;
mod summary;

pub use modes::counterexamples_result;
pub use summary::run_facts;
