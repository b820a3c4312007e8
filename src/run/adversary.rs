//! Falsification by an adversary: a small policy that PPO trains against the frozen controller.
//!
//! The simulations of a trial are the episodes of a training run. The adversary decides the offsets
//! of observations and actions while a simulation runs, and a search records what it did as the
//! scenario. The trial ends with the first violation, so that each simulation of the training
//! counts, and a counterexample is a scenario as that of any search.

use std::ops::ControlFlow;

use mishandle_controllers::Policy;
use mishandle_falsification::{FalsificationError, FalsificationOutcome, TrialEnd, TrialOutcome};
use mishandle_network::Activation;
use mishandle_rollout::{AdversaryEnvironment, BatchFactory, Episode, EpisodeEnd, Request, Scenario, Seed};
use mishandle_store::{RunWriter, Simulation, TrialStatus};
use mishandle_training::ppo::{LearningRateSchedule, PpoSettings};
use mishandle_training::{
    AlgorithmSettings, EpisodeSettings, Observer, Origin, PolicySettings, RunSettings, ScenarioDraw,
    TimeoutHandling, TrainingControl, TrainingProgress, Validation, episode_seed,
};

use crate::error::MishandleError;
use crate::plan::FalsifyPlan;
use crate::resolve::ResolvedPlan;
use crate::run::first_simulations::FirstSimulations;
use crate::run::{Progress, falsify, record};

/// Simulations that run together, from which the adversary learns before the next ones start.
pub(super) const ROWS: u32 = 10;

/// Interval, in iterations, of what no training of an adversary does.
const NEVER: u64 = 1_000_000_000_000;

/// Index of the child of the seed of a trial that is the seed of its training.
const TRAINING: u64 = 0;

/// Lets an adversary disturb the simulations of all trials, one trial after the other. A trial that
/// was interrupted trains again from its first simulation; its recorded ones must be the same.
pub(super) fn search(
    resolved: &ResolvedPlan,
    plan: &FalsifyPlan,
    run: &mut RunWriter,
    progress: &mut Progress,
    watch: &mut dyn FnMut(&Progress) -> ControlFlow<()>,
) -> Result<FalsificationOutcome, MishandleError> {
    let mut trials = recorded_trials(resolved, plan, run)?;
    for trial in trials.iter().filter(|trial| trial.simulations > 0) {
        progress.simulations += u64::from(trial.simulations);
        if trial.end.is_some() {
            progress.ended += 1;
            progress.max_simulations -= u64::from(plan.budget - trial.simulations);
        }
        progress.falsified += u32::from(trial.falsified());
    }
    let environment = environment(resolved, plan)?;
    let mut training = Training {
        resolved,
        plan,
        run,
        first: FirstSimulations::default(),
        environment,
        trial: TrialOutcome::new(0, Seed(0)),
        recorded: 0,
        surplus: 0,
        is_interrupted: false,
        error: None,
        progress,
        watch,
    };
    for trial in trials.iter_mut().filter(|trial| trial.end.is_none()) {
        *trial = training.run(trial)?;
        if training.is_interrupted {
            break;
        }
    }
    let surplus = training.surplus;
    trials.retain(|trial| trial.simulations > 0);
    Ok(FalsificationOutcome { surplus, ..FalsificationOutcome::new(trials, plan.budget) })
}

/// Returns all trials of a plan with their recorded simulations.
fn recorded_trials(
    resolved: &ResolvedPlan,
    plan: &FalsifyPlan,
    run: &mut RunWriter,
) -> Result<Vec<TrialOutcome>, MishandleError> {
    let seed = |number| falsify::settings(&resolved.plan, plan).trial_seed(number);
    let mut trials: Vec<TrialOutcome> =
        (1..=plan.trials).map(|number| TrialOutcome::new(number, seed(number))).collect();
    for simulation in run.file().simulations() {
        let episode = record::episode(&simulation?, resolved)?;
        let Request { trial, number, .. } = episode.request;
        let known = trials.get_mut((trial as usize).wrapping_sub(1));
        let Some(known) = known.filter(|known| known.end.is_none() && known.simulations + 1 == number) else {
            let differences =
                vec![format!("simulation {number} of trial {trial}: the plan has no such simulation")];
            return Err(MishandleError::RunMismatch { differences });
        };
        known.add(&episode);
        known.end = end(known, plan);
    }
    let recorded = FalsificationOutcome::new(trials.clone(), plan.budget);
    for trial in run.file().trials()? {
        falsify::check_trial(resolved, &trial.trial, &recorded)?;
        // The process can have been killed before it recorded the end.
        let found = recorded.trials.iter().find(|found| found.trial == trial.trial.number);
        let ended = found.filter(|found| found.end.is_some());
        if let (Some(found), TrialStatus::Running) = (ended, trial.trial.status) {
            run.end_trial(found.trial, falsify::status(found))?;
        }
    }
    Ok(trials)
}

/// Returns the end of a trial with these simulations; `None` if it continues.
fn end(trial: &TrialOutcome, plan: &FalsifyPlan) -> Option<TrialEnd> {
    match trial.falsified() {
        true => Some(TrialEnd::Falsified),
        false => (trial.simulations == plan.budget).then_some(TrialEnd::BudgetSpent),
    }
}

/// Returns the environment of the adversary.
fn environment(resolved: &ResolvedPlan, plan: &FalsifyPlan) -> Result<AdversaryEnvironment, MishandleError> {
    let environment =
        resolved.adversary.clone().ok_or(MishandleError::MissingPlanTable { table: "falsify" })?;
    // A lower bound above 0 says that nothing is violated.
    let environment = environment.with_stop_threshold(plan.early_stopping.then_some(0.0));
    Ok(environment.with_fixed_seed(plan.fixed_seed.map(Seed)))
}

/// Returns the settings of a training with these decisions in an episode and at most `budget`
/// simulations.
fn settings(decisions: usize, budget: u32) -> PpoSettings {
    let generations = u64::from(budget.div_ceil(ROWS));
    PpoSettings {
        rollout_steps: decisions,
        epochs: 10,
        minibatch_size: 64,
        // The return is the robustness at the end, whenever it is decided.
        gamma: 1.0,
        gae_lambda: 0.95,
        learning_rate: 3e-3,
        learning_rate_schedule: LearningRateSchedule::Constant,
        run: RunSettings {
            total_steps: generations * u64::from(ROWS) * decisions as u64,
            validation_interval: NEVER,
            checkpoint_interval: NEVER,
            ..RunSettings::default()
        },
        episodes: EpisodeSettings {
            environments: ROWS as usize,
            timeouts: TimeoutHandling::Terminal,
            staggered: false,
            ..EpisodeSettings::default()
        },
        policy: PolicySettings {
            hidden: vec![32, 32],
            activation: Activation::Tanh,
            initial_log_std: 0.5,
            ..PolicySettings::default()
        },
        ..PpoSettings::default()
    }
}

/// Returns the request of a recorded simulation that the plan implies: its seed and the axes that
/// the adversary does not decide follow from the seed of the trial, and the other axes from the
/// record.
pub(crate) fn expected_request(
    resolved: &ResolvedPlan,
    recorded: &Request,
) -> Result<Option<Request>, MishandleError> {
    let plan = resolved.plan.falsify.as_ref().ok_or(MishandleError::MissingPlanTable { table: "falsify" })?;
    let Request { trial, number, .. } = *recorded;
    if !(1..=plan.trials).contains(&trial) || !(1..=plan.budget).contains(&number) {
        return Ok(None);
    }
    let environment = environment(resolved, plan)?;
    let training = falsify::settings(&resolved.plan, plan).trial_seed(trial).child(TRAINING);
    let (row, generation) = ((number - 1) % ROWS, (number - 1) / ROWS);
    let seed = episode_seed(training, row as usize, generation.into());
    let settings = settings(environment.decisions(), plan.budget);
    let (_, others) = ScenarioDraw::new(environment.scenarios(), &settings.scenarios).draw(seed);
    let mut values = environment.undecided(&others).values().to_vec();
    for axis in environment.decided_axes() {
        values[axis] = recorded.scenario.get(axis);
    }
    Ok(Some(Request {
        trial,
        number,
        stop_threshold: plan.early_stopping.then_some(0.0),
        ..Request::new(Scenario::new(values), plan.fixed_seed.map_or(seed, Seed))
    }))
}

/// The training of the adversary of a trial.
struct Training<'a> {
    resolved: &'a ResolvedPlan,
    plan: &'a FalsifyPlan,
    run: &'a mut RunWriter,
    first: FirstSimulations,
    environment: AdversaryEnvironment,
    trial: TrialOutcome,
    /// Number of simulations of the trial that the run file has.
    recorded: u32,
    surplus: u64,
    is_interrupted: bool,
    error: Option<MishandleError>,
    progress: &'a mut Progress,
    watch: &'a mut dyn FnMut(&Progress) -> ControlFlow<()>,
}

impl Training<'_> {
    /// Runs a trial with the simulations that are recorded of it.
    fn run(&mut self, recorded: &TrialOutcome) -> Result<TrialOutcome, MishandleError> {
        let (number, seed) = (recorded.trial, recorded.seed);
        self.recorded = recorded.simulations;
        self.trial = TrialOutcome::new(number, seed);
        self.environment = self.environment.clone().of_trial(number, self.plan.budget);
        let settings = AlgorithmSettings::from(settings(self.environment.decisions(), self.plan.budget));
        let environment = self.environment.clone();
        settings.train(&environment, seed.child(TRAINING), Origin::New, self)?;
        match self.error.take() {
            Some(error) => Err(error),
            None => Ok(self.trial.clone()),
        }
    }

    /// Adds the simulations that have ended to trial and run file.
    fn add(&mut self, mut episodes: Vec<Episode>) -> Result<(), MishandleError> {
        let violation = episodes.iter().position(Episode::is_violated);
        let kept = violation.map_or(episodes.len(), |violation| violation + 1);
        self.surplus += (episodes.len() - kept) as u64;
        episodes.truncate(kept);
        let mut new = Vec::new();
        for episode in &episodes {
            let Request { trial, number, .. } = episode.request;
            if episode.robustness().is_none() && episode.end == EpisodeEnd::Completed {
                return Err(FalsificationError::Undecidable { trial, number }.into());
            }
            self.trial.add(episode);
            self.first.add(episode);
            let simulated = record::record(episode, self.resolved);
            if number > self.recorded {
                new.push(simulated);
                continue;
            }
            let plain = |row: Simulation| Simulation { trace: None, reason: String::new(), ..row };
            if self.run.file().recorded(trial, number)?.map(plain) != Some(plain(simulated)) {
                return Err(MishandleError::SimulationMismatch { number });
            }
        }
        if self.recorded == 0 && self.trial.simulations as usize == episodes.len() {
            self.run.start_trial(self.trial.trial, self.trial.seed.0)?;
        }
        self.run.record(&new)?;
        self.progress.simulations += new.len() as u64;
        self.trial.end = end(&self.trial, self.plan);
        if self.trial.end.is_some() {
            self.run.end_trial(self.trial.trial, falsify::status(&self.trial))?;
            self.progress.ended += 1;
            self.progress.falsified += u32::from(self.trial.falsified());
            self.progress.max_simulations -= u64::from(self.plan.budget - self.trial.simulations);
        }
        self.first.check(self.resolved, self.run.file())
    }
}

impl Observer for Training<'_> {
    fn validate(&mut self, _: &Policy, _: usize) -> Option<Validation> {
        None
    }

    fn iteration_finished(&mut self, _: &TrainingProgress) -> TrainingControl {
        self.error = self.add(self.environment.take_finished()).err();
        let has_ended = self.error.is_some() || self.trial.end.is_some();
        self.is_interrupted = (self.watch)(self.progress).is_break();
        match self.is_interrupted || has_ended {
            true => TrainingControl::Stop,
            false => TrainingControl::Continue,
        }
    }
}
