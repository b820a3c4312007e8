//! Controller, disturbances, noise and monitor of up to 16 simulations. The physics is elsewhere: a
//! lane maps samples to actions.

use mishandle_stl::Trace;

use crate::disturbance::{ActiveDisturbances, command};
use crate::fault::Side;
use crate::rollout::Rollout;
use crate::{
    ControllerWorker, EarlyStop, EpisodeEnd, Request, RolloutError, Sample, Seed, Seen, SpecificationMonitor,
    Steerable, Steering, StepStatus, Verdict,
};

/// Maximum number of rows that one thread steps in lockstep. Sixteen rows share each read of the
/// network's weights and their states still fit into the cache.
pub(crate) const ROWS: usize = 16;

/// Position of a simulation in its episode.
#[derive(Clone, Debug)]
pub(crate) struct Progress {
    pub seed: Seed,
    /// Number of control steps taken.
    pub steps: usize,
    /// [`EpisodeEnd::Completed`] while the simulation runs.
    pub end: EpisodeEnd,
    /// Why the controller failed; empty if it did not.
    pub reason: String,
}

impl Progress {
    /// Returns the position at the start of a request's episode.
    pub(crate) fn start(request: &Request) -> Progress {
        Progress { seed: request.seed, steps: 0, end: EpisodeEnd::Completed, reason: String::new() }
    }

    /// The position of a row without a simulation.
    pub(crate) const IDLE: Progress =
        Progress { seed: Seed(0), steps: 0, end: EpisodeEnd::Stopped { step: 0 }, reason: String::new() };

    pub(crate) fn is_running(&self) -> bool {
        self.end == EpisodeEnd::Completed
    }
}

/// The steering of a simulation, what it remembers, and the values of the scenario so far.
pub(crate) struct SteeredRow<'a> {
    pub steering: &'a dyn Steering,
    pub steerable: &'a Steerable,
    pub memory: &'a mut [f64],
    pub values: &'a mut [Option<f64>],
    /// Scratch buffer of the values that are chosen in one control step.
    pub chosen: &'a mut Vec<f64>,
}

/// State of up to 16 rows between two control steps, besides that of their environment.
pub(crate) struct LaneRows {
    controller_states: Vec<f64>,
    /// Disturbances of each row; `None` if the space has no axis of a disturbance.
    disturbances: [Option<ActiveDisturbances>; ROWS],
    /// Last answer and state of the controller of each row that a fault can pause.
    answers: [Option<Answer>; ROWS],
    /// Requirement of each row that has had a simulation which may stop early.
    stops: [Option<EarlyStop>; ROWS],
}

/// Last action of a controller, and its state after it.
struct Answer {
    action: Vec<f32>,
    state: Vec<f64>,
}

impl LaneRows {
    pub(crate) fn new(rollout: &Rollout) -> LaneRows {
        LaneRows {
            controller_states: vec![0.0; ROWS * rollout.controller.state_size()],
            disturbances: Default::default(),
            answers: Default::default(),
            stops: Default::default(),
        }
    }

    /// Returns whether the episode of a row may end after `steps` control steps: see
    /// [`Request::stop_threshold`].
    pub(crate) fn can_stop(&mut self, row: usize, request: &Request, steps: usize) -> bool {
        let (Some(threshold), Some(stop)) = (request.stop_threshold, &mut self.stops[row]) else {
            return false;
        };
        request.may_stop_after(steps) && stop.can_stop(threshold)
    }
}

/// Buffers and workers of one thread. They are reused between calls, so that a control step does
/// not allocate.
pub(crate) struct Lane {
    controller: Box<dyn ControllerWorker>,
    monitor: SpecificationMonitor,
    /// The early stop that every row starts with.
    stop: EarlyStop,
    /// Observation of each row.
    observations: Vec<f32>,
    actions: Vec<f32>,
    /// Action of the row that is stepped.
    pub action: Vec<f64>,
    /// Signals of the row that is stepped.
    pub signals: Vec<f64>,
    /// Reward terms of the row that is stepped.
    pub rewards: Vec<f64>,
    draws: Vec<f64>,
    /// Number of signals of the environment. Those of the controller follow.
    environment_signals: usize,
}

impl Lane {
    pub(crate) fn new(rollout: &Rollout) -> Result<Lane, RolloutError> {
        let environment = &rollout.environment;
        let controller = &rollout.controller;
        let (observation_size, action_size) = rollout.sizes();
        Ok(Lane {
            controller: controller.worker(),
            monitor: SpecificationMonitor::new(
                &rollout.specification,
                &rollout.signals,
                environment.control_dt(),
            )?,
            stop: EarlyStop::new(
                &rollout.specification,
                &rollout.signals,
                environment.control_dt(),
                environment.episode_steps() + 1,
            )?,
            observations: vec![0.0; ROWS * observation_size],
            actions: vec![0.0; ROWS * action_size],
            action: vec![0.0; action_size],
            signals: vec![0.0; rollout.signals.len()],
            rewards: vec![0.0; environment.reward_terms().len()],
            draws: vec![0.0; observation_size.max(action_size)],
            environment_signals: environment.signals().len(),
        })
    }

    /// Returns the buffers of the next sample of a row.
    pub(crate) fn sample(&mut self, row: usize) -> Sample<'_> {
        self.action_and_sample(row).1
    }

    /// Returns the action of a row, and the buffers of the sample after it.
    pub(crate) fn action_and_sample(&mut self, row: usize) -> (&[f64], Sample<'_>) {
        let Lane { observations, signals, rewards, action, environment_signals, .. } = self;
        let signals = &mut signals[..*environment_signals];
        let size = observations.len() / ROWS;
        (action, Sample { observation: &mut observations[row * size..][..size], signals, rewards })
    }

    /// Resets the controller, the disturbances and the requirement of a row.
    pub(crate) fn start(&mut self, rollout: &Rollout, rows: &mut LaneRows, row: usize, request: &Request) {
        rows.disturbances[row] = rollout.routing.has_effects().then(|| {
            ActiveDisturbances::new(&rollout.routing, &request.scenario, request.seed, self.action.len())
        });
        let size = rollout.controller.state_size();
        let state = &mut rows.controller_states[row * size..][..size];
        self.controller.reset(state, request.seed);
        let can_pause = rows.disturbances[row].as_ref().is_some_and(ActiveDisturbances::has_pause);
        let action = vec![0.0; if can_pause { self.action.len() } else { 0 }];
        rows.answers[row] = can_pause.then(|| Answer { action, state: state.to_vec() });
        if request.stop_threshold.is_some() {
            self.watch(rows, row);
        }
    }

    /// Starts the requirement of a row's running episode.
    pub(crate) fn watch(&self, rows: &mut LaneRows, row: usize) {
        rows.stops[row].get_or_insert_with(|| self.stop.clone()).start();
    }

    /// Shows a steering the observation of a row and its signals, of which the buffer contains the
    /// last ones, and replaces the values of the axes that begin to act in this control step.
    pub(crate) fn steer(
        &mut self,
        rows: &mut LaneRows,
        row: usize,
        progress: &Progress,
        signals: &[f64],
        steered: &mut SteeredRow<'_>,
    ) {
        let axes = steered.steerable.beginning(progress.steps);
        let (Some(disturbed), false) = (&mut rows.disturbances[row], axes.is_empty()) else {
            return;
        };
        let size = self.observations.len() / ROWS;
        let seen = Seen {
            seed: progress.seed,
            step: progress.steps,
            observation: &self.observations[row * size..][..size],
            signals,
            bound: rows.stops[row].as_mut().map_or(f64::INFINITY, EarlyStop::bound),
        };
        steered.chosen.clear();
        steered.chosen.extend(axes.iter().map(|axis| steered.values[axis.axis].unwrap_or(0.0)));
        steered.steering.steer(seen, axes, steered.memory, steered.chosen);
        for (axis, &value) in axes.iter().zip(&*steered.chosen) {
            steered.values[axis.axis] = Some(value);
            disturbed.set(axis.axis, value, self.action.len());
        }
    }

    /// Shows the controller the signals of a row's sample, and adds its own to them.
    pub(crate) fn complete_sample(&mut self, rollout: &Rollout, rows: &mut LaneRows, row: usize) {
        let size = rollout.controller.state_size();
        let state = &mut rows.controller_states[row * size..][..size];
        let (signals, own) = self.signals.split_at_mut(self.environment_signals);
        if !own.is_empty() {
            self.controller.signals(state, own);
            self.controller.see_signals(state, signals);
        }
    }

    /// Returns whether the controller needs the images of the next control step of a row.
    pub(crate) fn needs_images(&self, rollout: &Rollout, rows: &LaneRows, row: usize) -> bool {
        let size = rollout.controller.state_size();
        self.controller.needs_images(&rows.controller_states[row * size..][..size])
    }

    /// Shows the controller the images of the next control step of each row.
    pub(crate) fn look(&mut self, rows: usize, images: &[u8]) {
        self.controller.look(rows, images);
    }

    /// Computes the actions of the next control step of each row. Ends the simulations with an
    /// invalid input or action.
    pub(crate) fn act(&mut self, rollout: &Rollout, rows: &mut LaneRows, progress: &mut [Progress]) {
        let (observation_size, action_size) = rollout.sizes();
        let count = progress.len();
        let observations = self.observations.chunks_mut(observation_size);
        for ((observation, disturbed), progress) in
            observations.zip(&mut rows.disturbances).zip(&mut *progress)
        {
            let step = progress.steps;
            let measured = observation_size - rollout.environment.exact_size();
            let draws = &mut self.draws[..measured];
            // Before the delays: a late or repeated observation has the noise of its measurement.
            rollout.noise.on_observation(progress.seed, step as u64, &mut observation[..measured], draws);
            if let Some(disturbed) = disturbed {
                disturbed.observe(step, &mut observation[..measured]);
            }
            let invalid = observation.iter().position(|value| !value.is_finite());
            if let (Some(index), true) = (invalid, progress.is_running()) {
                progress.end = EpisodeEnd::InvalidObservation { step, index };
            }
            // After the check: a fault may show NaN to the controller.
            if let Some(disturbed) = disturbed {
                disturbed.fail(Side::Sensing, step, &mut observation[..measured]);
            }
        }
        self.controller.act(
            count,
            &self.observations[..count * observation_size],
            &mut rows.controller_states[..count * rollout.controller.state_size()],
            &mut self.actions[..count * action_size],
        );
        for (row, progress) in progress.iter_mut().enumerate().filter(|(_, progress)| progress.is_running()) {
            let step = progress.steps + 1;
            if let Some(failure) = self.controller.failure(row) {
                progress.end = failure.end(step);
                progress.reason.clone_from(&failure.reason);
            }
        }
        self.hold_paused(rollout, rows, progress);
        for (actions, progress) in self.actions.chunks(action_size).zip(progress) {
            let invalid = actions.iter().position(|action| !action.is_finite());
            if let (Some(index), true) = (invalid, progress.is_running()) {
                progress.end = EpisodeEnd::InvalidAction { step: progress.steps + 1, index };
            }
        }
    }

    /// Takes back the answers of controllers that a fault pauses, as if they had not been asked.
    fn hold_paused(&mut self, rollout: &Rollout, rows: &mut LaneRows, progress: &[Progress]) {
        let action_size = self.action.len();
        let state_size = rollout.controller.state_size();
        let LaneRows { controller_states, disturbances, answers, .. } = rows;
        for (row, ((answer, disturbed), progress)) in
            answers.iter_mut().zip(disturbances).zip(progress).enumerate()
        {
            let (Some(answer), Some(disturbed)) = (answer, disturbed) else { continue };
            let action = &mut self.actions[row * action_size..][..action_size];
            let state = &mut controller_states[row * state_size..][..state_size];
            if disturbed.is_paused(progress.steps) {
                action.copy_from_slice(&answer.action);
                state.copy_from_slice(&answer.state);
            } else {
                answer.action.copy_from_slice(action);
                answer.state.copy_from_slice(state);
            }
        }
    }

    /// Computes the action of a row with its disturbances and noise. Returns whether an action has
    /// arrived; before the first one of a delay, it is 0.
    pub(crate) fn action(
        &mut self,
        rollout: &Rollout,
        rows: &mut LaneRows,
        row: usize,
        progress: &Progress,
    ) -> bool {
        let action_size = self.action.len();
        let limit = rollout.environment.action_limit();
        for (clipped, action) in self.action.iter_mut().zip(&self.actions[row * action_size..]) {
            *clipped = f64::from(*action).clamp(-limit, limit);
        }
        let disturbed = rows.disturbances[row].as_mut();
        let draws = &mut self.draws[..action_size];
        command(disturbed, rollout.noise, progress.seed, progress.steps, &mut self.action, draws)
    }

    /// Returns how a reset with this status and the signals after it end an episode; `None` if it
    /// runs.
    pub(crate) fn end_of_start(&self, status: StepStatus) -> Option<EpisodeEnd> {
        match status {
            StepStatus::InvalidStart => Some(EpisodeEnd::InvalidScenario),
            StepStatus::Diverged => Some(EpisodeEnd::Diverged { step: 0 }),
            StepStatus::Running | StepStatus::Terminated => {
                first_not_finite(&self.signals).map(|index| EpisodeEnd::InvalidSignal { step: 0, index })
            }
        }
    }

    /// Returns how the sample after control step `step` ends an episode; `None` if it continues.
    /// The signals and reward terms are in the buffers.
    pub(crate) fn end_of_step(&self, status: StepStatus, step: usize) -> Option<EpisodeEnd> {
        if status == StepStatus::Diverged {
            return Some(EpisodeEnd::Diverged { step });
        }
        first_not_finite(&self.signals).map(|index| EpisodeEnd::InvalidSignal { step, index }).or_else(|| {
            first_not_finite(&self.rewards).map(|index| EpisodeEnd::InvalidReward { step, index })
        })
    }

    /// Adds the sample in the buffers to the requirement of a row, if its episode may stop early.
    pub(crate) fn record(&self, rows: &mut LaneRows, row: usize, request: &Request) {
        if request.stop_threshold.is_some() {
            self.record_watched(rows, row);
        }
    }

    /// Adds the sample in the buffers to the requirement of a row.
    pub(crate) fn record_watched(&self, rows: &mut LaneRows, row: usize) {
        if let Some(stop) = &mut rows.stops[row] {
            stop.push(&self.signals);
        }
    }

    /// Evaluates the formulas on the trace of an episode that has ended. The end may become
    /// [`EpisodeEnd::Undefined`].
    pub(crate) fn finish(
        &mut self,
        rollout: &Rollout,
        request: &Request,
        trace: &Trace,
        end: &mut EpisodeEnd,
    ) -> Result<Verdict, RolloutError> {
        self.monitor.judge(request, trace, rollout.environment.episode_steps() + 1, end)
    }
}

/// Returns the index of the first NaN or infinity.
fn first_not_finite(values: &[f64]) -> Option<usize> {
    values.iter().position(|value| !value.is_finite())
}
