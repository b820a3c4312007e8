//! The paper's tables of performance and falsification: published values, results of campaigns, and the pages that compare
//! them. The command `mishandle reproduce` is a thin layer above.
//!
//! - [`Results`] are those of campaigns, read from their run files or from compressed rows.
//! - [`pages()`](pages()) compares them with the values that the paper of the benchmark prints.

mod error;
mod falsification;
mod notes;
mod page;
mod pages;
mod performance;
mod published;
mod raw_rows;
mod results;
mod training_time;

pub use error::PaperError;
pub use page::{Block, Page, Table};
pub use pages::{NamedPage, pages};
pub use published::{
    PAPER_BUDGET, PAPER_STARTS, PAPER_TRIALS, PaperFalsification, PaperPerformance, paper_falsification,
    paper_performance, paper_training_time,
};
pub use results::{CampaignResults, Results, RunFacts, RunResults};
pub use training_time::training_steps;
