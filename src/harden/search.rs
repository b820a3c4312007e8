//! The search for failures: several searches, random scenarios, and the corners of the box.

use std::path::{Path, PathBuf};

use mishandle_rollout::Seed;
use mishandle_text::path_text;

use super::folder::Asked;
use super::measure::path_of;
use super::{Hardener, Watch};
use crate::archive::{Modes, Simulated, simulated};
use crate::error::MishandleError;
use crate::plan::{EvaluatePlan, FalsifyPlan, HardenPlan, Plan};

/// Name of the run that samples the space and its corners.
const CORNERS: &str = "corners";

/// The runs of all searches.
pub(super) struct Searched {
    runs: Vec<Asked>,
}

/// Looks for failures of a controller in the space. The run files have names that begin with
/// `prefix`. Returns `None` if it was interrupted.
///
/// # Errors
/// If a search is unknown, or a simulation cannot be run or stored.
pub(super) fn search(
    hardener: &Hardener<'_>,
    controller: &Path,
    prefix: &Path,
    seed: Seed,
    phase: &str,
    watch: Watch<'_>,
) -> Result<Option<Searched>, MishandleError> {
    let Hardener { plan: base, table, folder, .. } = *hardener;
    let plan =
        |seed: Seed| Plan { controller: path_text(controller), seed: seed.0, harden: None, ..base.clone() };
    let evaluate = EvaluatePlan { episodes: table.budget.into(), control: false, ..EvaluatePlan::default() };
    let mut plans = vec![(CORNERS.to_string(), Plan { evaluate: Some(evaluate), ..plan(seed.child(0)) })];
    for (number, name) in (1..).zip(&table.searches) {
        let falsify = FalsifyPlan {
            search: name.clone(),
            trials: 1,
            budget: table.budget,
            keep_going: true,
            new_mode_rate: 0.0,
            isolate: Some(false),
            ..FalsifyPlan::default()
        };
        plans.push((name.clone(), Plan { falsify: Some(falsify), ..plan(seed.child(number)) }));
    }
    let mut runs = Vec::new();
    for (name, plan) in plans {
        let path = path_of(prefix, &name);
        match folder.ask(&plan, &path, &format!("{phase}: {name}"), &mut *watch)? {
            Some(asked) => runs.push(asked),
            None => return Ok(None),
        }
    }
    Ok(Some(Searched { runs }))
}

/// Returns the run files of all searches whose names begin with `prefix`.
pub(super) fn search_files(prefix: &Path, table: &HardenPlan) -> Vec<PathBuf> {
    let names = std::iter::once(CORNERS).chain(table.searches.iter().map(String::as_str));
    names.map(|name| path_of(prefix, name)).collect()
}

impl Searched {
    /// Returns all simulations with a verdict, and the failure modes with the numbers of their
    /// failures.
    ///
    /// # Errors
    /// If a run cannot be read.
    pub fn simulated(&self) -> Result<(Vec<Simulated>, Modes), MishandleError> {
        let runs = self.runs.iter().map(Asked::run).collect::<Result<Vec<_>, _>>()?;
        simulated(&runs)
    }

    /// Returns the number of simulations.
    ///
    /// # Errors
    /// If a run cannot be read.
    pub fn simulations(&self) -> Result<u64, MishandleError> {
        self.runs.iter().map(|asked| Ok(asked.run()?.counts()?.simulations)).sum()
    }
}
