use mishandle_results::{RunFacts, Seed};
use mishandle_store::{RunFile, TrialStatus};

use crate::error::MishandleError;
use crate::resolve::controller_name;
use crate::resolve::guard::recorded_guard;
use crate::run::unfinished;

/// Returns what a run file holds.
///
/// # Errors
/// If the run cannot be read.
pub fn run_facts(run: &RunFile) -> Result<RunFacts, MishandleError> {
    let header = run.header();
    let trials = run.trials()?;
    let counts = run.counts()?;
    let falsified = trials.iter().filter(|trial| trial.trial.status == TrialStatus::Falsified);
    let controller = header.components.iter().find(|component| component.role == "controller");
    let minimum = trials.iter().filter_map(|trial| trial.minimum_robustness).reduce(f64::min);
    Ok(RunFacts {
        kind: header.kind.name().to_string(),
        target: header.target.name.clone(),
        target_kind: header.target.kind.clone(),
        controller: controller.map_or(String::new(), |component| controller_name(&component.name)),
        guard: recorded_guard(header),
        space: header.space.clone(),
        formula: header.formula.clone(),
        search: header.search.clone(),
        seed: Seed(header.seed),
        simulations: counts.simulations,
        failures: counts.falsified,
        trials: trials.len() as u64,
        falsified_trials: falsified.count() as u64,
        is_complete: unfinished(run)?.is_none(),
        minimum_robustness: minimum.map(Into::into),
        commit: header.build.git_commit.clone(),
    })
}
