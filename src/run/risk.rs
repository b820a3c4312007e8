//! The probability that a system violates its requirement, under the distribution of a plan.

use mishandle_results::Answer;
use mishandle_risk::{
    Disagreement, FREQUENT, LARGEST_RATIO, Method, Refusal, Report, Scenarios, ScreenedSettings, Settings,
    Source, risk, screened_risk,
};
use mishandle_rollout::Seed;
use mishandle_store::TrialStatus;

use crate::error::MishandleError;
use crate::plan::RiskPlan;
use crate::resolve::{ResolvedPlan, space_depends_on_seed};
use crate::run::ask::{Found, Progress, Watch};
use crate::run::journal::{Journal, Numbering};
use crate::run::result::{risk_result, screened_risk_result};
use mishandle_text::{plural, probability_text};

/// Returns the distribution of the scenarios of a plan.
///
/// # Errors
/// If the plan has no table `[risk]`, or nothing is random.
pub fn risk_scenarios(resolved: &ResolvedPlan) -> Result<Scenarios, MishandleError> {
    let space = &resolved.space;
    let hours = resolved.target.episode_steps as f64 * resolved.target.control_dt / 3600.0;
    Ok(Scenarios::new(space, &table(resolved)?.marginals(hours)?, space_depends_on_seed(resolved))?)
}

/// Checks that the distribution of the scenarios of a plan fits, and its method the target.
///
/// # Errors
/// If the plan has no table `[risk]`, nothing is random, or the method `sequence` has no axis to
/// choose.
pub(crate) fn check_risk_method(resolved: &ResolvedPlan) -> Result<(), MishandleError> {
    let scenarios = risk_scenarios(resolved)?;
    if table(resolved)?.method()? == Method::Sequence {
        let steerable = resolved.system()?.steerable();
        mishandle_risk::check_steerable(steerable.as_ref(), &scenarios)?;
    }
    Ok(())
}

/// Trial of the simulations.
const TRIAL: u32 = 1;

/// Estimates the probability that a simulation violates the requirement of a plan.
pub(super) fn ask(journal: &Journal<'_>, watch: Watch<'_>) -> Result<Found, MishandleError> {
    let resolved = journal.resolved();
    let table = table(resolved)?;
    let scenarios = risk_scenarios(resolved)?;
    let max_simulations = table.simulations;
    let mut watch = |simulations| watch(&Progress { simulations, max_simulations, ..Progress::default() });
    let mut system = journal.system(Some(Numbering { trial: TRIAL, last: 0 }));
    let seed = Seed(resolved.plan.seed);
    let batch = table.batch as usize;
    let path = journal.path();
    let found = if let Some(screening) = &resolved.plan.screening {
        let settings =
            ScreenedSettings { simulations: table.simulations, sample_rate: screening.confirm, seed, batch };
        let mut screen = journal.screening();
        let report =
            screened_risk(&mut screen, &mut system, &scenarios, &settings, &mut |done| watch(done.screened));
        screened_risk_result(resolved, &scenarios, &journal.result(report)?, &path)
    } else {
        let settings = Settings { simulations: table.simulations, method: table.method()?, seed, batch };
        let report = risk(&mut system, &scenarios, &settings, watch);
        risk_result(resolved, &scenarios, &journal.result(report)?, &path)
    };
    let ended = if found.is_complete { vec![(TRIAL, TrialStatus::BudgetSpent)] } else { Vec::new() };
    Ok(Found { answer: Answer::Risk(Box::new(found)), ended, is_checked: false })
}

fn table(resolved: &ResolvedPlan) -> Result<&RiskPlan, MishandleError> {
    resolved.plan.risk.as_ref().ok_or(MishandleError::MissingPlanTable { table: "risk" })
}

/// The assumption of an estimate that counts simulations without a verdict as passed.
pub(super) const ALL_PASS: &str = "simulations without a verdict satisfy the requirement";

/// Describes what the interval of an estimate assumes; `None` if nothing.
pub fn risk_assumption(report: &Report) -> Option<String> {
    let own = match report.answer.source? {
        _ if !report.answer.has_assumption => None,
        Source::MonteCarlo => None,
        Source::Importance => Some("the failures outside of the regions found are negligible"),
        Source::Splitting => Some("the chains lost no failure mode"),
    };
    let all_pass = (report.monte_carlo.ends.total() > 0).then_some(ALL_PASS);
    let parts: Vec<&str> = own.into_iter().chain(all_pass).collect();
    (!parts.is_empty()).then(|| parts.join(", and "))
}

/// Describes why parts of an estimation have no estimate.
pub fn risk_refusals(report: &Report) -> Vec<String> {
    let chains = report.splitting.as_ref().map_or(0, |splitting| splitting.chains.len());
    let splitting = report.answer.splitting_refusal.as_ref().map(|refusal| match refusal {
        Refusal::Budget { simulations, needed } => format!(
            "multilevel splitting: its part of the budget is {}, too few for an estimate, which needs at least {} in all",
            plural(*simulations, "simulation"),
            plural(*needed, "simulation")
        ),
        Refusal::InvalidStarts => {
            "multilevel splitting: the target cannot start from some scenarios, and the chains cannot leave these out; Monte \
             Carlo does"
                .to_string()
        }
        Refusal::Chains(Disagreement::Incomplete { complete }) => format!(
            "multilevel splitting: {complete} of {chains} chains reached a failure within the budget; a larger budget lets all of them"
        ),
        Refusal::Chains(Disagreement::Extinct { extinct }) => format!(
            "multilevel splitting: {extinct} of {chains} chains found no failure, because all their particles have the same robustness"
        ),
        Refusal::Chains(Disagreement::Spread { ratio }) => format!(
            "multilevel splitting: the chains disagree by a factor of {ratio:.0}; more than {LARGEST_RATIO} is refused"
        ),
        Refusal::Chains(Disagreement::Small { population }) => format!(
            "multilevel splitting: the chains agree, but have only {}",
            plural(*population, "particle")
        ),
        Refusal::MonteCarlo => {
            "multilevel splitting: the exact interval of Monte Carlo (99 %) contradicts the chains".to_string()
        }
        Refusal::BelowImportance => {
            "multilevel splitting: the failures of importance sampling alone are more probable; the chains lost a failure mode"
                .to_string()
        }
        Refusal::AboveImportance => {
            "importance sampling and multilevel splitting: the chains agree on a larger probability than that of the regions, \
             so a failure mode was missed, or the chains are wrong"
                .to_string()
        }
    });
    let importance =
        report.importance.as_ref().filter(|importance| !importance.is_reliable()).map(|importance| {
            format!(
                "importance sampling: its failures are worth {:.0} equally weighted ones, and {} of the probability is \
                 estimated outside of the regions",
                importance.effective_failures,
                probability_text(importance.outside)
            )
        });
    let importance = if report.importance.is_some() && report.monte_carlo.ends.invalid_starts > 0 {
        Some(
            "importance sampling: the target cannot start from some scenarios, and the weights cannot leave these out; Monte \
             Carlo does"
                .to_string(),
        )
    } else {
        importance
    };
    let is_sequence = report.method == Method::Sequence && report.is_complete;
    let unreached = is_sequence && report.importance.is_none() && report.monte_carlo.failures < FREQUENT;
    let sequence = unreached.then(|| {
        "importance sampling: the fit of the proposal reached no failure, or too few of them to aim at; a larger budget \
         gives it larger rounds. Failures that the fit met count in no estimate"
            .to_string()
    });
    splitting.into_iter().chain(importance).chain(sequence).collect()
}
