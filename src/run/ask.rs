//! Asking the question of a plan: one function runs all of them, with every engine, and writes
//! every simulation to a run file.

use std::ops::ControlFlow;
use std::sync::atomic::Ordering;

use mishandle_results::Answer;
use mishandle_rollout::Request;
use mishandle_store::{RunFile, RunHeader, RunKind, RunWriter, TrialStatus};
use mishandle_world::WorldDevice;

use crate::error::{Compared, MishandleError, RunError};
use crate::plan::Plan;
use crate::resolve::{Moved, ResolvedPlan, plan_without_program};
use crate::run::answer::add_recorded_parts;
use crate::run::facts::Facts;
use crate::run::file_target::possible_plans;
use crate::run::journal::Journal;
use crate::run::{evaluation, falsification, margin, metamorphic, risk, same_plan};

/// The engine that computes the simulations of a question.
#[derive(Clone, Copy)]
pub enum Engine<'a> {
    /// The target's own system computes all of them.
    Direct,
    /// This device proposes, and the target's own system confirms: see
    /// [`ScreeningPlan`](crate::plan::ScreeningPlan).
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

/// The answer of a question, and the statuses that its run file must have.
pub(crate) struct Found {
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
    same_plan::check_run(writer.file(), resolved)?;
    let engine = match (&resolved.plan.screening, engine) {
        (None, _) => None,
        (Some(plan), Engine::Screening(device)) => {
            Some(Box::new(crate::run::device::screening(resolved, device, plan.rows as usize)?) as _)
        }
        (Some(plan), Engine::Direct) => {
            return Err(MishandleError::NoDevice { device: plan.device.clone() });
        }
    };
    Ok(Journal::new(resolved, writer)?.with_engine(engine).with_known_arm(known_arm))
}

/// Writes what a question found about its trials, adds what the run file says besides, and closes
/// it.
pub(super) fn conclude(journal: Journal<'_>, found: Found) -> Result<Answer, MishandleError> {
    let Found { mut answer, ended, is_checked } = found;
    if !is_checked {
        journal.check(&ended, answer.is_complete())?;
    }
    journal.set_ended(&ended)?;
    let resolved = journal.resolved();
    // Before the file is closed: a second one would have to read its log.
    journal.read(|run| add_recorded_parts(&mut answer, run, &resolved.plan, resolved.target.can_fail))?;
    journal.close()?;
    Ok(answer)
}

/// Asks the question of a journal.
fn question(journal: &Journal<'_>, watch: Watch<'_>) -> Result<Found, MishandleError> {
    match journal.resolved().plan.kind() {
        RunKind::Evaluate => evaluation::ask(journal, watch),
        RunKind::Falsify => falsification::ask(journal, watch),
        RunKind::Margin => margin::ask(journal, watch),
        RunKind::Metamorphic => metamorphic::ask(journal, watch),
        RunKind::Risk => risk::ask(journal, watch),
    }
}

/// Returns the answer of a run from its records alone: that of the recorded simulations if the run
/// was interrupted.
///
/// With the plan of the run, every row is compared with what its question asks. Without it, the
/// answer follows from the file: no file of the plan is opened and no program is started. It then
/// lacks what only the target knows, such as axes outside of the space.
///
/// # Errors
/// If the run is of another plan, has no simulations, or has others than its question asks, or if
/// the target is needed.
pub fn recorded_answer(run: &RunFile, resolved: Option<&ResolvedPlan>) -> Result<Answer, MishandleError> {
    let header = run.header();
    if let Some(resolved) = resolved {
        same_plan::check(header, resolved)?;
        return answer_again(run, resolved);
    }
    if needs_target(header) {
        return answer_of_file(run);
    }
    let facts = Facts::recorded(header)?;
    let mut answer = match header.kind {
        RunKind::Evaluate => evaluation::progress::recorded(run, &facts)?,
        _ => falsification::recorded(run, &facts)?,
    };
    add_recorded_parts(&mut answer, run, &facts.plan, true)?;
    Ok(answer)
}

/// Returns the answer of a run as [`recorded_answer`] does, with the target if it is here and needs
/// no program: rows are compared with what it asks only if the answer depends on it, and it says
/// what else could be tested. `moved` has the present paths of moved files.
///
/// # Errors
/// The errors of [`recorded_answer`].
pub fn answer_of_run<'a>(run: &RunFile, moved: impl Into<Moved<'a>>) -> Result<Answer, MishandleError> {
    let header = run.header();
    let resolved = plan_without_program(header, moved);
    if needs_target(header) {
        return recorded_answer(run, resolved.as_ref());
    }
    let mut answer = recorded_answer(run, None)?;
    let offered = resolved
        .filter(|resolved| resolved.target.identity.hash == header.target.hash)
        .map(|r| r.subject().offered);
    match (&mut answer, offered) {
        (Answer::Evaluation(found), Some(offered)) => found.subject.offered = offered,
        (Answer::Falsification(found), Some(offered)) => found.subject.offered = offered,
        _ => {}
    }
    Ok(answer)
}

/// Returns whether the answer of a run depends on more than the numbers of its rows.
pub fn needs_target(header: &RunHeader) -> bool {
    let is_screened = Plan::from_toml(&header.plan).is_ok_and(|plan| plan.screening.is_some());
    is_screened || !matches!(header.kind, RunKind::Evaluate | RunKind::Falsify)
}

/// Asks the question of a run again with each target that its file can describe.
fn answer_of_file(run: &RunFile) -> Result<Answer, MishandleError> {
    let mut first = None;
    for resolved in possible_plans(run.header()) {
        match resolved.and_then(|resolved| answer_again(run, &resolved)) {
            Ok(answer) => return Ok(answer),
            Err(error) => first = first.or(Some(error)),
        }
    }
    Err(first.unwrap_or(RunError::NoEpisode.into()))
}

/// Asks the question of a run again.
fn answer_again(run: &RunFile, resolved: &ResolvedPlan) -> Result<Answer, MishandleError> {
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
            return Err(MishandleError::differs(Compared::Plan, differences));
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
            Err(error @ MishandleError::Run(RunError::OtherRequest { .. })) => Err(error),
            _ => Ok(None),
        },
    }
}
