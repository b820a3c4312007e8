//! Controller, disturbances, noise and monitor of up to 16 simulations. The physics is elsewhere: a lane maps samples to actions.

use mishandle_stl::{MonitorError, Trace};

use crate::disturbance::ActiveDisturbances;
use crate::rollout::Rollout;
use crate::{
    ControllerWorker, Episode, EpisodeEnd, Request, RolloutError, SpecificationMonitor, StepStatus, Verdict,
};

/// Maximum number of rows that one thread steps in lockstep. Sixteen rows share each read of the network's weights and
/// their states still fit into the cache.
pub(crate) const ROWS: usize = 16;

/// Number of control steps between two checks of the [stop threshold](Request::stop_threshold).
const CHECK_PERIOD: usize = 10;

/// Buffers and workers of one thread. They are reused between calls, so that a control step does not allocate.
pub(crate) struct Lane {
    controller: Box<dyn ControllerWorker>,
    monitor: SpecificationMonitor,
    controller_states: Vec<f64>,
    /// Disturbances of each row; `None` if the space has no axis of a disturbance.
    disturbances: [Option<ActiveDisturbances>; ROWS],
    /// Observation of each row.
    pub observations: Vec<f32>,
    actions: Vec<f32>,
    /// Action of the row that is stepped.
    pub action: Vec<f64>,
    /// Signals of the row that is stepped.
    pub signals: Vec<f64>,
    /// Reward terms of the row that is stepped.
    pub rewards: Vec<f64>,
    draws: Vec<f64>,
}

impl Lane {
    pub(crate) fn new(rollout: &Rollout) -> Result<Lane, RolloutError> {
        let (environment, controller) = (&rollout.environment, &rollout.controller);
        let (observation_size, action_size) = (environment.observation_size(), environment.action_size());
        Ok(Lane {
            controller: controller.worker(),
            monitor: SpecificationMonitor::new(
                &rollout.specification,
                environment.signals(),
                environment.control_dt(),
            )?,
            controller_states: vec![0.0; ROWS * controller.state_size()],
            disturbances: Default::default(),
            observations: vec![0.0; ROWS * observation_size],
            actions: vec![0.0; ROWS * action_size],
            action: vec![0.0; action_size],
            signals: vec![0.0; environment.signals().len()],
            rewards: vec![0.0; environment.reward_terms().len()],
            draws: vec![0.0; observation_size.max(action_size)],
        })
    }

    /// Starts the episode of a row. The signals of its initial state are in the buffer.
    pub(crate) fn start(&mut self, rollout: &Rollout, row: usize, request: &Request) -> Episode {
        let samples = rollout.environment.episode_steps() + 1;
        self.disturbances[row] = rollout.routing.has_effects().then(|| {
            ActiveDisturbances::new(&rollout.routing, &request.scenario, request.seed, self.action.len())
        });
        let size = rollout.controller.state_size();
        self.controller.reset(&mut self.controller_states[row * size..][..size], request.seed);
        let mut trace = Trace::with_capacity(rollout.environment.signals().clone(), samples);
        let mut end = EpisodeEnd::Completed;
        match first_not_finite(&self.signals) {
            Some(index) => end = EpisodeEnd::InvalidSignal { step: 0, index },
            None => trace.push(&self.signals),
        }
        Episode {
            request: request.clone(),
            trace,
            trace_digest: None,
            verdict: Verdict::default(),
            total_reward: 0.0,
            steps: 0,
            end,
        }
    }

    /// Computes the actions of the next control step of each episode. Ends the episodes with an invalid input or action.
    pub(crate) fn act(&mut self, rollout: &Rollout, episodes: &mut [Episode]) {
        let (observation_size, action_size) = rollout.sizes();
        let rows = episodes.len();
        let observations = self.observations.chunks_mut(observation_size);
        for ((observation, disturbed), episode) in
            observations.zip(&mut self.disturbances).zip(&mut *episodes)
        {
            let step = episode.steps;
            if let Some(disturbed) = disturbed {
                disturbed.observe(step, observation);
            }
            let draws = &mut self.draws[..observation_size];
            rollout.noise.on_observation(episode.request.seed, step as u64, observation, draws);
            let invalid = observation.iter().position(|value| !value.is_finite());
            if let (Some(index), EpisodeEnd::Completed) = (invalid, episode.end) {
                episode.end = EpisodeEnd::InvalidObservation { step, index };
            }
        }
        self.controller.act(
            rows,
            &self.observations[..rows * observation_size],
            &mut self.controller_states[..rows * rollout.controller.state_size()],
            &mut self.actions[..rows * action_size],
        );
        for (actions, episode) in self.actions.chunks(action_size).zip(episodes) {
            let invalid = actions.iter().position(|action| !action.is_finite());
            if let (Some(index), EpisodeEnd::Completed) = (invalid, episode.end) {
                episode.end = EpisodeEnd::InvalidAction { step: episode.steps + 1, index };
            }
        }
    }

    /// Computes the action of a row with its disturbances and noise.
    pub(crate) fn action(&mut self, rollout: &Rollout, row: usize, episode: &Episode) {
        let action_size = self.action.len();
        for (clipped, action) in self.action.iter_mut().zip(&self.actions[row * action_size..]) {
            *clipped = f64::from(*action).clamp(-1.0, 1.0);
        }
        let step = episode.steps;
        let mut disturbed = self.disturbances[row].as_mut();
        if let Some(disturbed) = &mut disturbed {
            disturbed.act(step, &mut self.action);
        }
        let (seed, draws) = (episode.request.seed, &mut self.draws[..action_size]);
        rollout.noise.on_action(seed, step as u64, &mut self.action, draws, |draws| {
            if let Some(disturbed) = disturbed {
                disturbed.draw(step, draws);
            }
        });
    }

    /// Adds a control step to an episode. Its signals and reward terms are in the buffers.
    pub(crate) fn record(&mut self, rollout: &Rollout, status: StepStatus, episode: &mut Episode) {
        let step = episode.steps + 1;
        if status == StepStatus::Diverged {
            episode.end = EpisodeEnd::Diverged { step };
            return;
        }
        if let Some(index) = first_not_finite(&self.signals) {
            episode.end = EpisodeEnd::InvalidSignal { step, index };
            return;
        }
        if let Some(index) = first_not_finite(&self.rewards) {
            episode.end = EpisodeEnd::InvalidReward { step, index };
            return;
        }
        episode.trace.push(&self.signals);
        episode.steps = step;
        episode.total_reward += self.rewards.iter().sum::<f64>();
        if let Some(threshold) = episode.request.stop_threshold
            && step.is_multiple_of(CHECK_PERIOD)
            && self.monitor.can_stop(&episode.trace, rollout.environment.episode_steps() + 1, threshold)
        {
            episode.end = EpisodeEnd::Stopped { step };
        }
    }

    /// Evaluates the formulas on an episode that has ended.
    pub(crate) fn finish(&mut self, rollout: &Rollout, episode: &mut Episode) -> Result<(), RolloutError> {
        if !episode.end.has_verdict() {
            return Ok(());
        }
        match self.monitor.verdict(&episode.trace, rollout.environment.episode_steps() + 1) {
            Err(RolloutError::Monitor { source: MonitorError::Undefined { step, .. }, .. }) => {
                episode.end = EpisodeEnd::Undefined { step };
            }
            verdict => episode.verdict = verdict?,
        }
        if episode.request.needs_subformulas && episode.verdict.robustness.is_some() {
            episode.verdict.subformulas = self.monitor.subformulas(&episode.trace)?;
        }
        Ok(())
    }
}

/// Returns the index of the first NaN or infinity.
fn first_not_finite(values: &[f64]) -> Option<usize> {
    values.iter().position(|value| !value.is_finite())
}
