//! An evaluation while it runs: its run file, and what its simulations say so far.

use std::ops::ControlFlow;
use std::path::Path;

use mishandle_evaluation::{
    CornerCounter, Corners, FormulaRoles, MetricCounter, complement, evaluate_corners,
};
use mishandle_results::{Answer, Evaluation};
use mishandle_rollout::{AxisKind, Episode, Request, Scenario, Seed};
use mishandle_store::{AxisRecord, RANDOM_TRIAL, RunFile, TrialStatus};

use crate::error::{Compared, MishandleError, RunError, other_request};
use crate::plan::{Plan, StartRegion};
use crate::run::ask::Found;
use crate::run::evaluation::arm::{self, ControlArm, Outcome, Pairs, copied};
use crate::run::evaluation::rule::RateRule;
use crate::run::evaluation::{Requests, check_trials, corner_counter, evaluation_simulations};
use crate::run::facts::Facts;
use crate::run::file_target::file_plan;
use crate::run::journal::{Journal, JournalSystem};
use crate::run::missing::unfinished;
use crate::run::result::evaluation_result;
use crate::run::rows;

/// The task preset whose completion times include failed episodes, as in the code of the original
/// benchmark.
const COUNTS_FAILURES: &str = "code";

/// Results of the simulations so far.
struct Counted {
    metrics: MetricCounter,
    corners: Option<CornerCounter>,
    rule: Option<RateRule>,
    pairs: Pairs,
    /// Number of simulations.
    done: u64,
}

impl Counted {
    /// Counts nothing yet.
    fn new(plan: &Plan, roles: FormulaRoles, corners: Option<CornerCounter>) -> Counted {
        let metrics = metric_counter(plan, roles);
        let rule = plan.evaluate.as_ref().and_then(RateRule::new);
        Counted { metrics, corners, rule, pairs: Pairs::default(), done: 0 }
    }

    /// Counts a recorded simulation, which must be the next one of its trial.
    fn add_recorded(&mut self, requests: &Requests<'_>, episode: &Episode) -> Result<(), MishandleError> {
        let Request { trial, number, seed, scenario, unit_point, .. } = &episode.request;
        let next = match (&self.corners, *trial) {
            (Some(report), Corners::TRIAL) => u64::from(report.simulations()) + 1,
            (_, arm::TRIAL) => self.pairs.control.len() as u64 + 1,
            _ => self.metrics.simulations() + 1,
        };
        let is_expected = requests.request(*trial, *number)?.is_some_and(|expected| {
            expected.seed == *seed && expected.scenario.is_same(scenario) && unit_point.is_empty()
        });
        // After its decision, a rule asks for no more.
        let is_surplus = *trial == RANDOM_TRIAL && self.rule.as_ref().is_some_and(RateRule::is_decided);
        if u64::from(*number) != next || !is_expected || is_surplus {
            return Err(other_request("simulation", next as u32));
        }
        self.add(episode);
        Ok(())
    }

    fn add(&mut self, episode: &Episode) {
        self.done += 1;
        match (&mut self.corners, episode.request.trial) {
            (Some(report), Corners::TRIAL) => report.add(episode),
            (None, Corners::TRIAL) => {}
            (_, arm::TRIAL) => self.pairs.control.push(Outcome::of(episode)),
            _ => {
                self.metrics.add(episode);
                add_random(&mut self.rule, &mut self.pairs, episode);
            }
        }
    }

    /// Returns the answer. `arm` are the axes that the control arm fixes, and whether all of its
    /// simulations are the same; `run` is the path of the run file.
    fn answer(self, facts: &Facts, arm: Option<(&[String], bool)>, run: &Path, is_complete: bool) -> Answer {
        let plan = &facts.plan;
        let mut metrics = self.metrics.report(Seed(plan.seed));
        if let Some(rule) = self.rule.as_ref().filter(|_| metrics.success_rate.value.is_some()) {
            metrics.success_rate = rule.estimate();
            // Earlier looks of the rule can narrow the interval.
            if metrics.violations + self.metrics.successes() == metrics.success_rate.n {
                metrics.violation_rate = complement(metrics.success_rate);
            }
        }
        let rule = self.rule.as_ref().zip(plan.evaluate.as_ref());
        Answer::Evaluation(Box::new(Evaluation {
            metrics,
            corners: self.corners.as_ref().map(CornerCounter::report),
            sequential: rule.map(|(rule, evaluate)| rule.result(evaluate)),
            control: arm.and_then(|(nominal, is_single)| {
                self.pairs.result(nominal, is_single, stops_by_itself(plan))
            }),
            ..evaluation_result(facts, run, is_complete)
        }))
    }
}

/// An evaluation while it runs.
pub(crate) struct Evaluating<'a> {
    journal: &'a Journal<'a>,
    requests: &'a Requests<'a>,
    system: JournalSystem<'a>,
    counted: Counted,
    /// Whether somebody else decided that there are enough random simulations.
    is_ended: bool,
}

/// Gets the number of simulations in the run file after each batch, and the random simulations of
/// the batch; can stop.
pub(crate) type OnBatch<'w> = &'w mut dyn FnMut(u64, &[Episode]) -> ControlFlow<()>;

impl<'a> Evaluating<'a> {
    /// Reads the simulations that the run file contains. `each` gets the random ones.
    pub(crate) fn open(
        journal: &'a Journal<'a>,
        requests: &'a Requests<'a>,
        mut each: impl FnMut(&Episode),
    ) -> Result<Evaluating<'a>, MishandleError> {
        let resolved = journal.resolved();
        journal.read(|run| check_trials(resolved, run))?;
        let plan = &resolved.plan;
        // A process that was killed here can have started the first of them alone.
        journal.start(requests.trials())?;
        let statuses = journal.read(trials)?;
        let corners = requests.corners.as_ref().map(|corners| corner_counter(resolved, corners));
        let mut counted = Counted::new(plan, FormulaRoles::of(&resolved.specification), corners);
        journal.rows(Some(RANDOM_TRIAL), |episode| {
            counted.add_recorded(requests, episode)?;
            if episode.request.trial == RANDOM_TRIAL {
                each(episode);
            }
            Ok(())
        })?;
        let is_ended = statuses.contains(&(RANDOM_TRIAL, TrialStatus::BudgetSpent));
        let found = Evaluating { journal, requests, system: journal.deferred(), counted, is_ended };
        if found.is_ended && !found.has_enough() && plan.compare.is_none() {
            let differences = vec![format!(
                "status of trial {RANDOM_TRIAL}: recorded as complete, but its rule does not end it after {} simulations",
                found.random()
            )];
            return Err(MishandleError::differs(Compared::Plan, differences));
        }
        Ok(found)
    }

    /// Returns the number of simulations in the run file.
    pub(crate) fn done(&self) -> u64 {
        self.counted.done
    }

    /// Returns the number of random simulations.
    pub(crate) fn random(&self) -> u64 {
        self.counted.metrics.simulations()
    }

    /// Returns whether there are enough random simulations.
    fn has_enough(&self) -> bool {
        let is_decided = self.counted.rule.as_ref().is_some_and(RateRule::is_decided);
        is_decided || self.random() >= self.requests.random.episodes
    }

    /// Returns whether the run file says that the random simulations are complete.
    pub(crate) fn is_ended(&self) -> bool {
        self.is_ended
    }

    /// Ends the random simulations, because another rule is satisfied.
    pub(crate) fn end(&mut self) {
        self.is_ended = true;
    }

    /// Runs random simulations until there are `number` of them, or enough. Breaks if `on_batch`
    /// does.
    pub(crate) fn advance(
        &mut self,
        number: u64,
        on_batch: OnBatch<'_>,
    ) -> Result<ControlFlow<()>, MishandleError> {
        if self.is_ended || self.has_enough() || self.random() >= number {
            return Ok(ControlFlow::Continue(()));
        }
        let Evaluating { journal, requests, system, counted, .. } = self;
        let Counted { metrics, rule, pairs, done, .. } = counted;
        let episodes = number.min(requests.random.episodes);
        let random = mishandle_evaluation::Evaluation { episodes, ..requests.random };
        let mut flow = ControlFlow::Continue(());
        let found = mishandle_evaluation::evaluate(system, &random, metrics, |episodes| {
            journal.keep(episodes, &[])?;
            episodes.iter().for_each(|episode| add_random(rule, pairs, episode));
            *done += episodes.len() as u64;
            flow = on_batch(*done, episodes);
            let is_decided = rule.as_ref().is_some_and(RateRule::is_decided);
            Ok::<_, MishandleError>(if is_decided { ControlFlow::Break(()) } else { flow })
        });
        journal.result(found)?;
        Ok(flow)
    }

    /// Runs the simulations of the corners and of the control arm.
    pub(crate) fn finish(mut self, on_batch: OnBatch<'_>) -> Result<Found, MishandleError> {
        if (self.is_ended || self.has_enough()) && self.run_corners(on_batch)?.is_continue() {
            self.run_control(on_batch)?;
        }
        Ok(self.found())
    }

    fn run_corners(&mut self, on_batch: OnBatch<'_>) -> Result<ControlFlow<()>, MishandleError> {
        let mut flow = ControlFlow::Continue(());
        let Evaluating { journal, requests, system, counted, .. } = self;
        let Counted { corners, done, .. } = counted;
        let Some((corners, report)) = requests.corners.as_ref().zip(corners.as_mut()) else {
            return Ok(flow);
        };
        if report.simulations() == corners.simulations() {
            return Ok(flow);
        }
        let found = evaluate_corners(system, corners, requests.random.batch, report, |episodes| {
            journal.keep(episodes, &[])?;
            *done += episodes.len() as u64;
            flow = on_batch(*done, &[]);
            Ok::<_, MishandleError>(flow)
        });
        journal.result(found)?;
        Ok(flow)
    }

    fn run_control(&mut self, on_batch: OnBatch<'_>) -> Result<(), MishandleError> {
        let Some(arm) = &self.requests.control else { return Ok(()) };
        let planned = arm.simulations(self.random());
        let mut system = None;
        while (self.counted.pairs.control.len() as u64) < planned {
            let first = self.counted.pairs.control.len() as u64 + 1;
            let last = planned
                .min(self.counted.pairs.control.len() as u64 + self.requests.random.batch.max(1) as u64);
            let mut requests = Vec::new();
            for number in first..=last {
                requests.extend(self.requests.request(arm::TRIAL, number as u32)?);
            }
            let episodes = if let Some(rows) = self.copied_rows(arm, &requests)? {
                self.journal.copy(&rows)?;
                rows.iter().map(rows::recorded_episode).collect()
            } else {
                let system = match &mut system {
                    Some(system) => system,
                    None => system.insert(arm.system(self.journal.resolved())?),
                };
                let episodes = system.rollout(&requests)?;
                if episodes.len() != requests.len() {
                    return Err(MishandleError::Run(RunError::NoEpisode));
                }
                self.journal.keep(&episodes, &[])?;
                episodes
            };
            self.counted.pairs.control.extend(episodes.iter().map(Outcome::of));
            self.counted.done += episodes.len() as u64;
            if on_batch(self.counted.done, &[]).is_break() {
                break;
            }
        }
        Ok(())
    }

    /// Returns the rows of a batch of the arm that another run has; `None` if it lacks one of them.
    fn copied_rows(
        &self,
        arm: &ControlArm,
        requests: &[Request],
    ) -> Result<Option<Vec<mishandle_store::Simulation>>, MishandleError> {
        let Some(other) = self.journal.known_arm() else { return Ok(None) };
        let mut rows = Vec::with_capacity(requests.len());
        for request in requests {
            match copied(arm, request, other)? {
                Some(row) => rows.push(row),
                None => return Ok(None),
            }
        }
        Ok(Some(rows))
    }

    /// Returns what the evaluation found, also before it is complete.
    pub(crate) fn found(self) -> Found {
        let is_random_done = self.is_ended || self.has_enough();
        let arm = self.requests.control.as_ref();
        let has_corners = match (&self.requests.corners, &self.counted.corners) {
            (Some(corners), Some(report)) => report.simulations() == corners.simulations(),
            _ => true,
        };
        let has_control =
            arm.is_none_or(|arm| self.counted.pairs.control.len() as u64 == arm.simulations(self.random()));
        let is_complete = is_random_done && has_corners && has_control;
        let spent = |trial| (trial, TrialStatus::BudgetSpent);
        let ended = if is_complete { self.requests.trials().map(spent).collect() } else { Vec::new() };
        let facts = Facts::of(self.journal.resolved());
        let arm = arm.map(|arm| (arm.nominal(), arm.is_single()));
        let answer = self.counted.answer(&facts, arm, &self.journal.path(), is_complete);
        Found { answer, ended, is_checked: true }
    }

    /// Returns the largest number of simulations.
    pub(crate) fn max_simulations(&self) -> Result<u64, MishandleError> {
        evaluation_simulations(self.journal.resolved())
    }
}

/// Counts no simulation of an evaluation yet.
pub fn metric_counter(plan: &Plan, roles: FormulaRoles) -> MetricCounter {
    MetricCounter::new(roles)
        .with_completion_times_of_failures(plan.preset == COUNTS_FAILURES)
        .with_intervals_at_any_time(stops_by_itself(plan))
}

/// Returns whether the results of an evaluation decide how many simulations it has.
pub fn stops_by_itself(plan: &Plan) -> bool {
    plan.compare.is_some() || plan.evaluate.as_ref().is_some_and(|evaluate| evaluate.until.is_some())
}

/// Returns the answer of a recorded evaluation without screening, from its file alone. No row is
/// compared with the plan.
pub(crate) fn recorded(run: &RunFile, facts: &Facts) -> Result<Answer, MishandleError> {
    let mut counted = Counted::new(&facts.plan, facts.roles, corners(run, facts)?);
    let mut at_nominal = None;
    for row in run.simulations().chain(run.derived_simulations(RANDOM_TRIAL)) {
        let row = row?;
        counted.add(&rows::recorded_episode(&row));
        if row.trial == arm::TRIAL {
            at_nominal.get_or_insert(row.scenario);
        }
    }
    let axes = run.header().axes.iter().zip(at_nominal.unwrap_or_default());
    let is_fixed_by_arm = |(axis, value): &(&AxisRecord, Option<f64>)| {
        axis.kind != AxisKind::Start.name() && !(axis.low == axis.high && Some(axis.low) == *value)
    };
    let nominal: Vec<String> = axes.filter(is_fixed_by_arm).map(|(axis, _)| axis.name.clone()).collect();
    // A complete arm has fewer simulations only if all of them would be the same.
    let is_ended =
        trials(run)?.into_iter().any(|(trial, status)| trial == arm::TRIAL && status != TrialStatus::Running);
    let is_single = is_ended && counted.pairs.control.len() == 1;
    let is_complete = unfinished(run)?.is_none();
    Ok(counted.answer(facts, Some((&nominal, is_single)), run.path(), is_complete))
}

/// Counts no simulation of the corners of a recorded evaluation yet: with one or with several seeds
/// for each corner, as the last recorded simulation says. Only the task knows which corners count
/// if the starts must be reachable.
fn corners(run: &RunFile, facts: &Facts) -> Result<Option<CornerCounter>, MishandleError> {
    let evaluate = facts.plan.evaluate.as_ref().filter(|evaluate| evaluate.corners);
    let Some(starts) = evaluate.map(|evaluate| evaluate.starts) else { return Ok(None) };
    let last = run.last_simulation_number(Corners::TRIAL)?;
    let planned = [false, true].map(|is_random| Corners::new(&facts.space, is_random, Seed(facts.plan.seed)));
    let Some(row) = run.recorded(Corners::TRIAL, last)? else { return Ok(None) };
    let place = Scenario::new(row.scenario);
    let is_last = |request: Request| request.scenario.is_same(&place);
    let planned = planned.into_iter().flatten().find(|corners| corners.request(last).is_some_and(is_last));
    Ok(planned.and_then(|corners| match starts {
        StartRegion::Whole => Some(corners.counter(facts.roles, false, |_| None)),
        StartRegion::Reachable => {
            let resolved = file_plan(run.header()).ok().filter(|found| found.target.reachable.is_some())?;
            Some(corner_counter(&resolved, &corners))
        }
    }))
}

fn add_random(rule: &mut Option<RateRule>, pairs: &mut Pairs, episode: &Episode) {
    pairs.random.push(Outcome::of(episode));
    if let Some(rule) = rule {
        rule.add(episode);
    }
}

/// Returns the numbers and statuses of all trials, that of the control arm too.
fn trials(run: &RunFile) -> Result<Vec<(u32, TrialStatus)>, MishandleError> {
    let found = run.trials()?.into_iter().chain(run.derived_trials()?);
    Ok(found.map(|summary| (summary.trial.number, summary.trial.status)).collect())
}
