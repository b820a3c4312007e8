//! The paper's tables of performance and falsification: published values, results of campaigns, and
//! the pages that compare them. The command `reproduce` is a thin layer above.
//!
//! - [`Results`] are those of campaigns, read from their run files or from collected summaries.
//! - [`Unit`] is a part of a run that can be run again, with its digest.
//! - [`pages()`](pages()) compares them with the values that the paper of the benchmark prints.

mod error;
mod falsification;
mod notes;
mod pages;
mod performance;
mod published;
mod results;
mod side_by_side;
mod summaries;
mod unit;
mod verification;

pub use error::PaperError;
pub use pages::{NamedPage, pages};
pub use published::{
    PAPER_BUDGET, PAPER_STARTS, PAPER_TRIALS, PaperFalsification, PaperPerformance, paper_falsification,
    paper_performance, paper_training_time,
};
pub use results::{CampaignResults, EvaluationSummary, Results, RunFacts, RunResults};
pub use unit::{Evaluated, Unit};
pub use verification::SampledUnit;
