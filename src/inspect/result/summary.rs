use std::collections::BTreeMap;

use mishandle_falsification::{MetamorphicSettings, OutputRelation};
use mishandle_results::{RelationCounts, RunFacts, Seed};
use mishandle_store::{RunFile, RunKind, TrialStatus};

use crate::error::MishandleError;
use crate::plan::Plan;
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
        relations: relations(run)?,
        is_complete: unfinished(run)?.is_none(),
        minimum_robustness: minimum.map(Into::into),
        commit: header.build.git_commit.clone(),
    })
}

/// Counts the relations of a metamorphic run; `None` for other questions. The rows suffice, so the
/// target need not be there.
fn relations(run: &RunFile) -> Result<Option<RelationCounts>, MishandleError> {
    let header = run.header();
    let plan = Plan::from_toml(&header.plan).ok().filter(|_| header.kind == RunKind::Metamorphic);
    let Some(table) = plan.and_then(|plan| plan.metamorphic) else { return Ok(None) };
    let robustness = |trial: u32| -> Result<BTreeMap<u32, f64>, MishandleError> {
        let mut found = BTreeMap::new();
        for row in run.trial_simulations(trial) {
            let row = row?;
            found.extend(row.robustness.map(|robustness| (row.number, robustness)));
        }
        Ok(found)
    };
    let sources = robustness(MetamorphicSettings::SOURCES)?;
    let mut counts = RelationCounts { asked: table.relations.len() as u64, broken: 0 };
    for (trial, relation) in (MetamorphicSettings::SOURCES + 1..).zip(table.relations.values()) {
        let holds: OutputRelation = relation.holds.parse()?;
        let breaks = |(number, follow_up): (&u32, &f64)| {
            sources.get(number).is_some_and(|source| holds.is_broken(*source, *follow_up))
        };
        counts.broken += u64::from(robustness(trial)?.iter().any(breaks));
    }
    Ok(Some(counts))
}
