//! Relations between the results of pairs of scenarios.

use mishandle_falsification::metamorphic;
use mishandle_results::Answer;
use mishandle_store::TrialStatus;

use crate::error::MishandleError;
use crate::resolve::{MetamorphicCases, metamorphic_cases};
use crate::run::ask::{Found, Progress, Watch};
use crate::run::journal::Journal;
use crate::run::result::metamorphic_result;

/// Compares pairs of scenarios.
pub(super) fn ask(journal: &Journal<'_>, watch: Watch<'_>) -> Result<Found, MishandleError> {
    let resolved = journal.resolved();
    let MetamorphicCases { cases, relations, settings } = metamorphic_cases(resolved)?;
    let max_simulations = settings.max_simulations(relations.len());
    let watch = |simulations| watch(&Progress { simulations, max_simulations, ..Progress::default() });
    let found = metamorphic(&mut journal.system(None), &cases, &relations, settings, watch);
    let found = journal.result(found)?;
    let spent = |trial| (trial, TrialStatus::BudgetSpent);
    let ended = if found.is_complete { found.trials().map(spent).collect() } else { Vec::new() };
    let answer = Answer::Metamorphic(Box::new(metamorphic_result(resolved, &found, &journal.path())?));
    Ok(Found { answer, ended, is_checked: false })
}
