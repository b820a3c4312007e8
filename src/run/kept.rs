//! Simulations that a page takes, kept in a file beside the run.

use std::hash::{BuildHasher, RandomState};
use std::path::Path;
use std::sync::atomic::Ordering;

use mishandle_rollout::{Request, System};
use mishandle_store::{IfExists, RunFile, RunHeader, RunWriter, Simulation};

use crate::error::MishandleError;
use crate::resolve::ResolvedPlan;
use crate::run::header::header;
use crate::run::journal::{Journal, Numbering};
use crate::run::rows;

/// The trial of all kept simulations.
const TRIAL: u32 = 1;

/// Number of kept simulations that are simulated again.
const REPEATED: usize = 16;

/// The system of a run whose simulations a file keeps. A page that was interrupted continues: what
/// the file has is not simulated again.
///
/// The file is a run file with one trial, in the order in which the page asked. It can come from
/// somebody else, together with the run: some of its simulations, which nobody can foresee, are
/// simulated again, and a file with another result begins again.
pub struct KeptSimulations<'a>(Journal<'a>);

impl<'a> KeptSimulations<'a> {
    /// Opens the file, or begins it. `asks` stands for all that decides what is asked in which
    /// order: a file with another target, build, plan or `asks` begins again. If the target is not
    /// deterministic, nothing is simulated again to check it.
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
        let known = known.filter(|run| *run.file().header() == header);
        let checked =
            known.map(|run| Ok::<_, MishandleError>(is_repeatable(run.file(), resolved)?.then_some(run)));
        // A file that is not used is closed here, before another one takes its place.
        let run = match checked.transpose()?.flatten() {
            Some(run) => run,
            None => RunWriter::create(path, &header, IfExists::Replace)?,
        };
        Ok(KeptSimulations(Journal::new(resolved, run)?.with_failing_starts()))
    }

    /// Returns the system.
    pub fn system(&self) -> Box<dyn System + '_> {
        Box::new(self.0.system(Some(Numbering { trial: TRIAL, last: 0 })))
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

/// Returns whether kept simulations, drawn by a number that no file can know, have the same result
/// again.
fn is_repeatable(run: &RunFile, resolved: &ResolvedPlan) -> Result<bool, MishandleError> {
    if !resolved.target.is_deterministic {
        return Ok(true);
    }
    let Ok(mut chosen) = run.trial_simulations(TRIAL).collect::<Result<Vec<Simulation>, _>>() else {
        return Ok(false);
    };
    let state = RandomState::new();
    chosen.sort_by_key(|row| state.hash_one(row.number));
    chosen.truncate(REPEATED);
    let requests: Vec<Request> = chosen.iter().map(|row| rows::request(row, false)).collect();
    if requests.is_empty() {
        return Ok(true);
    }
    // A request that no page asks, such as one without a scenario, is an error of the system.
    let Ok(episodes) = resolved.system()?.rollout(&requests) else { return Ok(false) };
    let bits = |values: &[Option<f64>]| -> Vec<Option<u64>> {
        values.iter().map(|value| value.map(f64::to_bits)).collect()
    };
    let result = |row: &Simulation| {
        let Simulation { robustness, robustness_low, robustness_high, .. } = row;
        let bounds = bits(&[*robustness, *robustness_low, *robustness_high]);
        (bounds, bits(&row.verdicts), row.end, row.steps, row.trace_digest)
    };
    let again = episodes.iter().map(|episode| rows::row(episode, resolved));
    Ok(again.zip(&chosen).all(|(again, row)| result(&again) == result(row)))
}
