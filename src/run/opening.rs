use mishandle_store::RunWriter;

use crate::error::MishandleError;
use crate::resolve::ResolvedPlan;
use crate::run::{admit_build, unfinished};

/// How run files are opened for writing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Opening {
    /// Whether each batch is synced to the disk.
    pub durable: bool,
    /// Whether this build may continue a run that another one started.
    pub any_build: bool,
}

impl Opening {
    /// Prepares a run file for the rows of its plan.
    ///
    /// # Errors
    /// If the file cannot be read or written.
    pub fn apply(self, run: &mut RunWriter, resolved: &ResolvedPlan) -> Result<(), MishandleError> {
        if self.durable {
            run.set_durable()?;
        }
        // A complete run gets no rows.
        if self.any_build && unfinished(run.file())?.is_some() {
            admit_build(run, resolved)?;
        }
        Ok(())
    }
}
