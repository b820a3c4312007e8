use std::sync::{Arc, Mutex};

use mishandle_stl::{MonitorError, Trace};
use rayon::prelude::*;

use crate::disturbance::{ActiveDisturbances, AxisRouting};
use crate::{
    Controller, ControllerWorker, Disturbance, Environment, EnvironmentWorker, Episode, EpisodeEnd, Noise,
    Request, RolloutError, Sample, Space, Specification, SpecificationMonitor, StepStatus, System, Verdict,
};

/// Maximum number of rows that one thread steps in lockstep. Sixteen rows share each read of the network's weights and
/// their states still fit into the cache.
const ROWS: usize = 16;

/// Number of control steps between two checks of the [stop threshold](Request::stop_threshold).
const CHECK_PERIOD: usize = 10;

/// The [`System`] of a controller in an environment, with noise and a specification.
///
/// Simulations run on all threads of the current rayon pool. Each thread steps up to 16 simulations in lockstep and
/// computes their actions together. The bits of an episode do not depend on the other episodes.
pub struct Rollout {
    environment: Arc<dyn Environment>,
    controller: Arc<dyn Controller>,
    specification: Specification,
    noise: Noise,
    space: Space,
    routing: AxisRouting,
    workers: Mutex<Vec<RolloutWorker>>,
}

impl Rollout {
    /// Makes a system from its parts.
    ///
    /// # Errors
    /// If the controller's sizes differ from the environment's, a formula does not fit the signals, or a noise level is
    /// not from 0 to [`Noise::MAX_STD`].
    pub fn new(
        environment: Arc<dyn Environment>,
        controller: Arc<dyn Controller>,
        specification: Specification,
        noise: Noise,
    ) -> Result<Rollout, RolloutError> {
        let expected = (environment.observation_size(), environment.action_size());
        let found = (controller.observation_size(), controller.action_size());
        if expected != found {
            return Err(RolloutError::Layout {
                environment: environment.name().to_string(),
                expected_observation: expected.0,
                expected_action: expected.1,
                found_observation: found.0,
                found_action: found.1,
            });
        }
        noise.check()?;
        SpecificationMonitor::new(&specification, environment.signals(), environment.control_dt())?;
        let space = environment.space().clone();
        Ok(Rollout {
            routing: AxisRouting::new(&space, &space, &[])?,
            space,
            environment,
            controller,
            specification,
            noise,
            workers: Mutex::new(Vec::new()),
        })
    }

    /// Replaces the space of scenarios. Each axis of `space` must have the name of an axis of the environment or of one
    /// of `disturbances`.
    ///
    /// # Errors
    /// If the name of an axis is unknown, or an axis of the environment is missing from `space`.
    pub fn with_disturbances(
        mut self,
        space: Space,
        disturbances: &[Disturbance],
    ) -> Result<Rollout, RolloutError> {
        self.routing = AxisRouting::new(&space, self.environment.space(), disturbances)?;
        self.space = space;
        Ok(self)
    }

    /// Returns the specification that is evaluated on the episodes.
    pub fn specification(&self) -> &Specification {
        &self.specification
    }

    fn take_worker(&self) -> Result<RolloutWorker, RolloutError> {
        let free = self.workers.lock().map(|mut workers| workers.pop()).unwrap_or(None);
        match free {
            Some(worker) => Ok(worker),
            None => RolloutWorker::new(self),
        }
    }

    fn run_chunk(&self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        let mut worker = self.take_worker()?;
        let episodes = worker.run(self, requests);
        if let Ok(mut workers) = self.workers.lock() {
            workers.push(worker);
        }
        episodes
    }
}

impl System for Rollout {
    fn space(&self) -> &Space {
        &self.space
    }

    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        for request in requests {
            self.space.check(&request.scenario)?;
        }
        let rows = requests.len().div_ceil(rayon::current_num_threads()).clamp(1, ROWS);
        let this = &*self;
        let chunks = requests
            .par_chunks(rows)
            .map(|chunk| this.run_chunk(chunk))
            .collect::<Result<Vec<Vec<Episode>>, RolloutError>>()?;
        Ok(chunks.into_iter().flatten().collect())
    }
}

/// Workers and buffers of one thread. They are reused between calls, so that a control step does not allocate.
struct RolloutWorker {
    environment: Box<dyn EnvironmentWorker>,
    controller: Box<dyn ControllerWorker>,
    monitor: SpecificationMonitor,
    states: Vec<f64>,
    controller_states: Vec<f64>,
    /// Disturbances of each row; empty if the space has no axis of a disturbance.
    disturbances: Vec<ActiveDisturbances>,
    observations: Vec<f32>,
    actions: Vec<f32>,
    action: Vec<f64>,
    signals: Vec<f64>,
    rewards: Vec<f64>,
    draws: Vec<f64>,
}

impl RolloutWorker {
    fn new(rollout: &Rollout) -> Result<RolloutWorker, RolloutError> {
        let (environment, controller) = (&rollout.environment, &rollout.controller);
        let (observation_size, action_size) = (environment.observation_size(), environment.action_size());
        Ok(RolloutWorker {
            environment: environment.worker(),
            controller: controller.worker(),
            monitor: SpecificationMonitor::new(
                &rollout.specification,
                environment.signals(),
                environment.control_dt(),
            )?,
            states: vec![0.0; ROWS * environment.state_size()],
            controller_states: vec![0.0; ROWS * controller.state_size()],
            disturbances: Vec::new(),
            observations: vec![0.0; ROWS * observation_size],
            actions: vec![0.0; ROWS * action_size],
            action: vec![0.0; action_size],
            signals: vec![0.0; environment.signals().len()],
            rewards: vec![0.0; environment.reward_terms().len()],
            draws: vec![0.0; observation_size.max(action_size)],
        })
    }

    fn run(&mut self, rollout: &Rollout, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        let steps = rollout.environment.episode_steps();
        let mut episodes = self.reset(rollout, requests);
        for step in 0..steps {
            self.act(rollout, &mut episodes, step);
            for (row, episode) in episodes.iter_mut().enumerate() {
                if episode.end == EpisodeEnd::Completed {
                    self.step(rollout, row, step, episode);
                }
            }
            if episodes.iter().all(|episode| episode.end != EpisodeEnd::Completed) {
                break;
            }
        }
        for episode in &mut episodes {
            if episode.end.has_verdict() {
                match self.monitor.verdict(&episode.trace, steps + 1) {
                    Err(RolloutError::Monitor { source: MonitorError::Undefined { step, .. }, .. }) => {
                        episode.end = EpisodeEnd::Undefined { step };
                    }
                    verdict => episode.verdict = verdict?,
                }
                if episode.request.needs_subformulas && episode.verdict.robustness.is_some() {
                    episode.verdict.subformulas = self.monitor.subformulas(&episode.trace)?;
                }
            }
        }
        Ok(episodes)
    }

    fn reset(&mut self, rollout: &Rollout, requests: &[Request]) -> Vec<Episode> {
        let (state_size, observation_size) =
            (rollout.environment.state_size(), rollout.environment.observation_size());
        let controller_state_size = rollout.controller.state_size();
        let samples = rollout.environment.episode_steps() + 1;
        self.disturbances.clear();
        let mut episodes = Vec::with_capacity(requests.len());
        for (row, request) in requests.iter().enumerate() {
            let Request { scenario, seed, .. } = request;
            let observation = &mut self.observations[row * observation_size..][..observation_size];
            let sample = Sample { observation, signals: &mut self.signals, rewards: &mut self.rewards };
            let state = &mut self.states[row * state_size..][..state_size];
            if rollout.routing.has_effects() {
                let action_size = self.action.len();
                self.disturbances.push(ActiveDisturbances::new(
                    &rollout.routing,
                    scenario,
                    *seed,
                    action_size,
                ));
                self.environment.reset(&rollout.routing.environment(scenario), *seed, state, sample);
            } else {
                self.environment.reset(scenario, *seed, state, sample);
            }
            self.controller.reset(
                &mut self.controller_states[row * controller_state_size..][..controller_state_size],
                *seed,
            );
            let mut trace = Trace::with_capacity(rollout.environment.signals().clone(), samples);
            let mut end = EpisodeEnd::Completed;
            match first_not_finite(&self.signals) {
                Some(index) => end = EpisodeEnd::InvalidSignal { step: 0, index },
                None => trace.push(&self.signals),
            }
            episodes.push(Episode {
                request: request.clone(),
                trace,
                trace_digest: None,
                verdict: Verdict::default(),
                total_reward: 0.0,
                steps: 0,
                end,
            });
        }
        episodes
    }

    /// Computes the actions of control step `step`, counted from 0. Ends the episodes with an invalid input or action.
    fn act(&mut self, rollout: &Rollout, episodes: &mut [Episode], step: usize) {
        let (observation_size, action_size) =
            (rollout.environment.observation_size(), rollout.environment.action_size());
        let rows = episodes.len();
        let observations = self.observations.chunks_mut(observation_size);
        for (row, (observation, episode)) in observations.zip(&mut *episodes).enumerate() {
            if let Some(disturbed) = self.disturbances.get_mut(row) {
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
                episode.end = EpisodeEnd::InvalidAction { step: step + 1, index };
            }
        }
    }

    /// Runs control step `step`, counted from 0, of one episode.
    fn step(&mut self, rollout: &Rollout, row: usize, step: usize, episode: &mut Episode) {
        let (state_size, observation_size) =
            (rollout.environment.state_size(), rollout.environment.observation_size());
        let action_size = self.action.len();
        for (clipped, action) in self.action.iter_mut().zip(&self.actions[row * action_size..]) {
            *clipped = f64::from(*action).clamp(-1.0, 1.0);
        }
        let mut disturbed = self.disturbances.get_mut(row);
        if let Some(disturbed) = &mut disturbed {
            disturbed.act(step, &mut self.action);
        }
        let (seed, draws) = (episode.request.seed, &mut self.draws[..action_size]);
        rollout.noise.on_action(seed, step as u64, &mut self.action, draws, |draws| {
            if let Some(disturbed) = disturbed {
                disturbed.draw(step, draws);
            }
        });
        let sample = Sample {
            observation: &mut self.observations[row * observation_size..][..observation_size],
            signals: &mut self.signals,
            rewards: &mut self.rewards,
        };
        let status =
            self.environment.step(&self.action, &mut self.states[row * state_size..][..state_size], sample);
        if status == StepStatus::Diverged {
            episode.end = EpisodeEnd::Diverged { step: step + 1 };
            return;
        }
        if let Some(index) = first_not_finite(&self.signals) {
            episode.end = EpisodeEnd::InvalidSignal { step: step + 1, index };
            return;
        }
        if let Some(index) = first_not_finite(&self.rewards) {
            episode.end = EpisodeEnd::InvalidReward { step: step + 1, index };
            return;
        }
        episode.trace.push(&self.signals);
        episode.steps = step + 1;
        episode.total_reward += self.rewards.iter().sum::<f64>();
        if let Some(threshold) = episode.request.stop_threshold
            && (step + 1).is_multiple_of(CHECK_PERIOD)
            && self.monitor.can_stop(&episode.trace, rollout.environment.episode_steps() + 1, threshold)
        {
            episode.end = EpisodeEnd::Stopped { step: step + 1 };
        }
    }
}

/// Returns the index of the first NaN or infinity.
fn first_not_finite(values: &[f64]) -> Option<usize> {
    values.iter().position(|value| !value.is_finite())
}
