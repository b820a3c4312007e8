//! Asking the question of a plan: one function runs all of them, with every engine, and writes
//! every simulation to a run file.

use std::ops::ControlFlow;
use std::sync::atomic::Ordering;

use mishandle_evaluation::{Corners, Repeats, ScreenedProgress};
use mishandle_falsification::{
    FalsificationOutcome, Margin, MarginSettings, Metamorphic, Narrowed, Repeated, ScreenedCounts,
    each_category, each_fault, margin, metamorphic, repeat, repeat_seeds,
};
use mishandle_random::Seed;
use mishandle_risk::{Report, ScreenedReport, ScreenedSettings, screened_risk};
use mishandle_rollout::{Request, Space};
use mishandle_store::{RANDOM_TRIAL, RunFile, RunKind, RunWriter, TrialStatus};
use mishandle_world::WorldDevice;

use crate::error::MishandleError;
use crate::plan::ScreeningPlan;
use crate::resolve::{
    MetamorphicCases, ResolvedPlan, depends_on_seed, metamorphic_cases, space_depends_on_seed,
};
use crate::run::evaluate::{self, EvaluationOutcome};
use crate::run::falsify;
use crate::run::journal::{Journal, JournalScreening, JournalSystem, Numbering};
use crate::run::screening::{self, ScreenedEvaluationOutcome};
use crate::run::{header, risk};

/// Trial of the simulations of a question that has no trials of its own, and of the repeats of a
/// witness.
const TRIAL: u32 = 1;
const REPEATS: u32 = 2;

/// The engine that computes the simulations of a question.
#[derive(Clone, Copy)]
pub enum Engine<'a> {
    /// The target's own system computes all of them.
    Direct,
    /// This device proposes, and the target's own system confirms: see [`ScreeningPlan`].
    Screening(&'a dyn WorldDevice),
}

/// Progress of a question.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Number of finished simulations.
    pub simulations: u64,
    /// Total number of simulations if all running trials spend their budgets.
    pub max_simulations: u64,
    /// Number of finished trials of a falsification.
    pub ended: u32,
    /// Number of trials that found a counterexample.
    pub falsified: u32,
}

/// The answer of a question.
#[derive(Debug)]
pub enum Answer {
    /// Rates of an evaluation.
    Evaluation(EvaluationOutcome),
    /// Rates of a screened evaluation.
    ScreenedEvaluation(ScreenedEvaluationOutcome),
    /// Trials of a falsification, with the counts of its screening.
    Falsification(FalsificationOutcome, Option<ScreenedCounts>),
    /// The smallest disturbance.
    Margin(MarginOutcome),
    /// Pairs of scenarios.
    Metamorphic(Metamorphic),
    /// The failure probability.
    Risk(Report),
    /// The failure probability by screening.
    ScreenedRisk(ScreenedReport),
}

impl Answer {
    /// Returns whether the question was not interrupted.
    pub fn is_complete(&self) -> bool {
        match self {
            Answer::Evaluation(found) => found.is_complete,
            Answer::ScreenedEvaluation(found) => found.report.is_complete,
            Answer::Falsification(found, _) => {
                !found.is_interrupted && found.trials.iter().all(|trial| trial.end.is_some())
            }
            Answer::Margin(found) => found.is_complete,
            Answer::Metamorphic(found) => found.is_complete,
            Answer::Risk(found) => found.is_complete,
            Answer::ScreenedRisk(found) => found.is_complete,
        }
    }
}

/// The smallest disturbance, with the repeats of its witness.
#[derive(Clone, Debug)]
pub struct MarginOutcome {
    /// The search; with a search for each combination of categories, the one with the smallest
    /// disturbance.
    pub margin: Margin,
    /// The searches for each combination of categories, if the plan asks for them. The categories
    /// are the fixed values of the space.
    pub each_category: Vec<(Space, Margin)>,
    /// Number of simulations of all searches.
    pub simulations: u64,
    /// Simulations of the witness with other seeds; `None` without a witness, or if the seed has no
    /// effect.
    pub repeats: Option<Repeats>,
    /// Whether search and repeats are finished.
    pub is_complete: bool,
}

/// Gets the progress now and then, and can end the question, which a later call continues.
pub type Watch<'w> = &'w mut (dyn FnMut(&Progress) -> ControlFlow<()> + Send);

/// A run file to which a question adds its simulations.
pub struct OpenRun {
    /// The file.
    pub writer: RunWriter,
    /// A run whose control arm has simulations of this one, which are copied instead of repeated:
    /// see [`CampaignRun::known_arm`](crate::campaign::CampaignRun::known_arm).
    pub known_arm: Option<RunFile>,
}

impl From<RunWriter> for OpenRun {
    fn from(writer: RunWriter) -> OpenRun {
        OpenRun { writer, known_arm: None }
    }
}

/// What a question found, and what its run file must say.
pub(super) struct Found {
    pub answer: Answer,
    /// The trials that have ended, with their statuses.
    pub ended: Vec<(u32, TrialStatus)>,
    /// Whether the question has compared every row and trial already.
    pub is_checked: bool,
}

/// Asks the question of a plan and stores every simulation in `run`, an open run file of the same
/// plan. The simulations that it already contains are not repeated.
///
/// # Errors
/// If the run is of another plan or contains other simulations, the engine is not that of the plan,
/// a simulation cannot be run or stored, or the first simulations of a search all fail.
pub fn ask(
    resolved: &ResolvedPlan,
    run: impl Into<OpenRun>,
    engine: Engine<'_>,
    watch: Watch<'_>,
) -> Result<Answer, MishandleError> {
    let journal = open(resolved, run.into(), engine)?;
    let found = question(&journal, watch)?;
    conclude(journal, found)
}

/// Opens the journal of a question.
pub(super) fn open<'a>(
    resolved: &'a ResolvedPlan,
    run: OpenRun,
    engine: Engine<'_>,
) -> Result<Journal<'a>, MishandleError> {
    let OpenRun { writer, known_arm } = run;
    header::check_run(writer.file(), resolved)?;
    let engine = match (&resolved.plan.screening, engine) {
        (None, _) => None,
        (Some(plan), Engine::Screening(device)) => {
            Some(Box::new(screening::screening(resolved, device, plan.rows as usize)?) as _)
        }
        (Some(plan), Engine::Direct) => {
            return Err(MishandleError::NoDevice { device: plan.device.clone() });
        }
    };
    Ok(Journal::new(resolved, writer)?.with_engine(engine).with_known_arm(known_arm))
}

/// Writes what a question found about its trials, and closes the run file.
pub(super) fn conclude(journal: Journal<'_>, found: Found) -> Result<Answer, MishandleError> {
    let Found { answer, ended, is_checked } = found;
    if !is_checked {
        journal.check(&ended, answer.is_complete())?;
    }
    journal.set_ended(&ended)?;
    journal.close()?;
    Ok(answer)
}

/// Asks the question of a journal.
fn question(journal: &Journal<'_>, watch: Watch<'_>) -> Result<Found, MishandleError> {
    let resolved = journal.resolved();
    let answer = match (&resolved.plan.screening, resolved.plan.kind()) {
        (Some(plan), _) => screened(journal, plan, journal.screening(), watch)?,
        (None, RunKind::Evaluate) => return evaluate::ask(journal, watch),
        (None, RunKind::Falsify) => return falsify::ask(journal, watch),
        (None, RunKind::Margin | RunKind::Metamorphic | RunKind::Risk) => recorded(journal, watch)?,
    };
    Ok(Found { ended: ended(&answer), answer, is_checked: false })
}

/// Asks a question whose system is the run file.
fn recorded(journal: &Journal<'_>, watch: Watch<'_>) -> Result<Answer, MishandleError> {
    let resolved = journal.resolved();
    let plan = &resolved.plan;
    let numbered = |trial| journal.system(Some(Numbering { trial, last: 0 }));
    if let Some(table) = &plan.risk {
        let max_simulations = table.simulations;
        let watch = |simulations| watch(&Progress { simulations, max_simulations, ..Progress::default() });
        let found = risk::risk(resolved, &mut numbered(TRIAL), watch);
        return Ok(Answer::Risk(journal.result(found)?));
    }
    if plan.metamorphic.is_some() {
        let MetamorphicCases { cases, relations, settings } = metamorphic_cases(resolved)?;
        let max_simulations = settings.max_simulations(relations.len());
        let watch = |simulations| watch(&Progress { simulations, max_simulations, ..Progress::default() });
        let found = metamorphic(&mut journal.system(None), &cases, &relations, settings, watch);
        return Ok(Answer::Metamorphic(journal.result(found)?));
    }
    let mut outcome = margins(journal, &mut numbered(TRIAL), &mut *watch)?;
    let max_simulations = outcome.simulations;
    let mut watch = |simulations| watch(&Progress { simulations, max_simulations, ..Progress::default() });
    let witness = outcome.margin.witness.as_ref().filter(|_| outcome.is_complete);
    if let Some(Request { scenario, seed, .. }) = witness.map(|witness| &witness.episode.request)
        && depends_on_seed(resolved, scenario)
    {
        let planned = Repeated::Counterexample.simulations();
        let seeds = repeat_seeds(*seed, planned);
        let done = outcome.simulations;
        let repeats = repeat(&mut numbered(REPEATS), scenario, seeds, |_| watch(done));
        let repeats = journal.result(repeats)?;
        outcome.is_complete = repeats.simulations == planned;
        outcome.repeats = Some(repeats);
    }
    Ok(Answer::Margin(outcome))
}

/// Searches for the smallest disturbance, once for each kind of a fault, or for each combination of
/// categories if the plan asks for that.
fn margins(
    journal: &Journal<'_>,
    system: &mut JournalSystem<'_>,
    watch: Watch<'_>,
) -> Result<MarginOutcome, MishandleError> {
    let resolved = journal.resolved();
    let table = resolved.plan.margin.as_ref().ok_or(MishandleError::MissingPlanTable { table: "margin" })?;
    let settings = MarginSettings {
        seed: Seed(resolved.plan.seed),
        budget: table.budget,
        is_random: space_depends_on_seed(resolved),
    };
    let spaces =
        if table.each_category { each_category(&resolved.space)? } else { each_fault(&resolved.space)? };
    let max_simulations = table.budget.saturating_mul(spaces.len() as u64);
    let mut found = Vec::new();
    let mut simulations = 0;
    let mut is_complete = true;
    for space in &spaces {
        let mut part = Narrowed { system: &mut *system, space };
        let result = margin(&mut part, settings, |done| {
            watch(&Progress { simulations: simulations + done, max_simulations, ..Progress::default() })
        });
        let margin = journal.result(result)?;
        simulations += margin.simulations;
        is_complete = margin.is_complete;
        found.push(margin);
        if !is_complete {
            break;
        }
    }
    // Of equal amplitudes, the last one counts, as in a run file.
    let order = |margin: &Margin| {
        let witness = margin.witness.as_ref().map(|witness| witness.norms.amplitude);
        let passed = margin.largest_without_violation().map_or(0.0, |level| level.amplitude);
        (witness.unwrap_or(f64::INFINITY), passed)
    };
    let smallest = found.iter().rev().min_by(|a, b| {
        let (a, a_passed) = order(a);
        let (b, b_passed) = order(b);
        a.total_cmp(&b).then(a_passed.total_cmp(&b_passed))
    });
    let smallest = smallest.cloned().ok_or(MishandleError::MissingPlanTable { table: "margin" })?;
    let margin = Margin { is_complete, ..smallest };
    let each_category = if table.each_category || spaces.len() > 1 {
        spaces.into_iter().zip(found).collect()
    } else {
        Vec::new()
    };
    Ok(MarginOutcome { margin, each_category, simulations, repeats: None, is_complete })
}

/// Asks a question whose simulations a device proposes.
fn screened(
    journal: &Journal<'_>,
    plan: &ScreeningPlan,
    mut screening: JournalScreening<'_>,
    watch: Watch<'_>,
) -> Result<Answer, MishandleError> {
    let resolved = journal.resolved();
    let own = |max_simulations| {
        move |progress: ScreenedProgress| Progress {
            simulations: progress.screened,
            max_simulations,
            ..Progress::default()
        }
    };
    match resolved.plan.kind() {
        RunKind::Evaluate => {
            let progress = own(resolved.plan.evaluate.as_ref().map_or(0, |evaluate| evaluate.episodes));
            let engines = (&mut screening as &mut _, &mut journal.system(None) as &mut _);
            let found =
                screening::evaluate(resolved, engines, plan.confirm, &mut |done| watch(&progress(done)));
            Ok(Answer::ScreenedEvaluation(journal.result(found)?))
        }
        RunKind::Falsify => {
            let falsify = resolved.plan.falsify.clone().unwrap_or_default();
            let max_simulations = u64::from(falsify.trials) * u64::from(falsify.budget);
            let engines = (&mut screening as &mut _, &mut journal.system(None) as &mut _);
            let found = falsify::screened(resolved, engines, plan.confirm, &mut |outcome| {
                watch(&Progress {
                    simulations: outcome.simulations,
                    max_simulations,
                    ended: outcome.trials.iter().filter(|trial| trial.end.is_some()).count() as u32,
                    falsified: outcome.falsified_trials,
                })
            });
            let (outcome, counts) = journal.result(found)?;
            Ok(Answer::Falsification(outcome, Some(counts)))
        }
        RunKind::Risk | RunKind::Margin | RunKind::Metamorphic => {
            let table =
                resolved.plan.risk.as_ref().ok_or(MishandleError::MissingPlanTable { table: "risk" })?;
            let settings = ScreenedSettings {
                simulations: table.simulations,
                sample_rate: plan.confirm,
                seed: Seed(resolved.plan.seed),
                batch: table.batch as usize,
            };
            let scenarios = risk::risk_scenarios(resolved)?;
            let progress = own(table.simulations);
            let mut system = journal.system(Some(Numbering { trial: TRIAL, last: 0 }));
            let found = screened_risk(&mut screening, &mut system, &scenarios, &settings, &mut |done| {
                watch(&progress(done))
            });
            Ok(Answer::ScreenedRisk(journal.result(found)?))
        }
    }
}

/// Returns the trials that have ended, with their statuses.
fn ended(answer: &Answer) -> Vec<(u32, TrialStatus)> {
    let is_complete = answer.is_complete();
    let spent = |trial| (trial, TrialStatus::BudgetSpent);
    match answer {
        Answer::Falsification(found, _) => falsify::ended(&found.trials),
        Answer::Margin(found) => {
            let has_witness = found.margin.witness.is_some();
            let status = if has_witness { TrialStatus::Falsified } else { TrialStatus::BudgetSpent };
            let search = found.margin.is_complete.then_some((TRIAL, status));
            let repeats = found.repeats.as_ref().filter(|_| is_complete).map(|_| spent(REPEATS));
            search.into_iter().chain(repeats).collect()
        }
        Answer::ScreenedEvaluation(found) if is_complete => {
            let corners = found.corners.as_ref().map(|_| Corners::TRIAL);
            std::iter::once(RANDOM_TRIAL).chain(corners).map(spent).collect()
        }
        Answer::Metamorphic(found) if is_complete => found.trials().map(spent).collect(),
        Answer::Risk(_) | Answer::ScreenedRisk(_) if is_complete => vec![spent(TRIAL)],
        _ => Vec::new(),
    }
}

/// Returns the answer of a run from its records alone: that of the recorded simulations if the run
/// was interrupted.
///
/// # Errors
/// If the run is of another plan, has no simulations, or has others than its question asks.
pub fn recorded_answer(resolved: &ResolvedPlan, run: &RunFile) -> Result<Answer, MishandleError> {
    header::check(run.header(), resolved)?;
    let mut journal = Journal::again(resolved, run);
    let mut found = question(&journal, &mut |_| ControlFlow::Continue(()));
    if found.is_err() && journal.is_missing() {
        // An interrupted run has whole batches.
        let end = journal.answered().load(Ordering::Relaxed);
        journal = Journal::again(resolved, run);
        let answered = journal.answered();
        found = question(&journal, &mut |_| {
            if answered.load(Ordering::Relaxed) == end {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        });
        if journal.is_missing() {
            let differences = vec!["simulations: some are missing".to_string()];
            return Err(MishandleError::RunMismatch { differences });
        }
    }
    conclude(journal, found?)
}

/// Returns the request that the question of a run asks as simulation `number` of `trial`, from the
/// recorded answers of the earlier ones; `None` if it does not ask it.
///
/// # Errors
/// If an earlier record is not what the question asks.
pub(crate) fn asked(
    resolved: &ResolvedPlan,
    run: &RunFile,
    sought: (u32, u32),
) -> Result<Option<Request>, MishandleError> {
    let journal = Journal::until(resolved, run, sought);
    let mut watch = |_: &Progress| ControlFlow::Continue(());
    let end = question(&journal, &mut watch);
    match journal.found() {
        Some(request) => Ok(Some(request)),
        // The question came to its end, or to a simulation that is not recorded.
        None => match end {
            Err(
                error
                @ (MishandleError::SimulationMismatch { .. } | MishandleError::ScreeningMismatch { .. }),
            ) => Err(error),
            _ => Ok(None),
        },
    }
}
