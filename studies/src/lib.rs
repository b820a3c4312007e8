//! Our own studies with Mishandle: the tables of the benchmark's paper, and the controllers that
//! come with the repository.
//!
//! - [`paper`]: published values, results of campaigns, the pages that compare them.
//! - [`zoo`]: the plan, the measurements, the records and the pages of the shipped controllers.
//! - [`Generation`]: the protocols by which they were trained.
//!
//! The program `studies` is a thin layer above. `notebook` holds the pages of the studies,
//! `experiments` their plans, scripts and results.

mod generation;
pub mod paper;
pub mod zoo;

pub use generation::{GENERATIONS, Generation};
