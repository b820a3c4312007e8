//! Simulations that a page takes, kept in a file beside the run.

use std::path::Path;
use std::sync::atomic::Ordering;

use mishandle_rollout::System;
use mishandle_store::{IfExists, RunHeader, RunWriter};

use crate::error::MishandleError;
use crate::resolve::ResolvedPlan;
use crate::run::header::header;
use crate::run::journal::{Journal, Numbering};

/// The system of a run whose simulations a file keeps. A page that was interrupted continues: what
/// the file has is not simulated again.
///
/// The file is a run file with one trial, in the order in which the page asked.
pub struct KeptSimulations<'a>(Journal<'a>);

impl<'a> KeptSimulations<'a> {
    /// Opens the file, or begins it. `asks` stands for all that decides what is asked in which
    /// order: a file with another target, build, plan or `asks` begins again.
    ///
    /// # Errors
    /// If the file cannot be written, another process writes it, or it is not a run file.
    pub fn open(
        resolved: &'a ResolvedPlan,
        path: &Path,
        asks: String,
    ) -> Result<KeptSimulations<'a>, MishandleError> {
        let mut header: RunHeader = header(resolved);
        header.versions.push(("page".to_string(), asks));
        let known = path.exists().then(|| RunWriter::resume(path)).and_then(Result::ok);
        let run = match known.filter(|run| *run.file().header() == header) {
            Some(run) => run,
            None => RunWriter::create(path, &header, IfExists::Replace)?,
        };
        Ok(KeptSimulations(Journal::new(resolved, run)?.with_failing_starts()))
    }

    /// Returns the system.
    pub fn system(&self) -> Box<dyn System + '_> {
        Box::new(self.0.system(Some(Numbering { trial: 1, last: 0 })))
    }

    /// Returns the number of simulations that the file had.
    pub fn answered(&self) -> u64 {
        self.0.answered().load(Ordering::Relaxed)
    }

    /// Closes the file.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn close(self) -> Result<(), MishandleError> {
        self.0.close()
    }
}
