use std::sync::{Arc, Mutex};

use mishandle_stl::{MonitorError, Trace};
use rayon::prelude::*;

use crate::disturbance::{Disturbed, Wiring};
use crate::{
    Controller, ControllerWorker, Disturbance, Environment, EnvironmentWorker, Episode, EpisodeEnd, Noise,
    Request, RolloutError, Sample, Space, Specification, SpecificationMonitor, StepStatus, System, Verdict,
};

/// Most rows that are stepped in lockstep by one thread: enough to share the reading of a network's weights among
/// them, few enough to keep their states in its cache.
const ROWS: usize = 16;

/// Decides, from the control step and the sample's signals, whether an episode may end here.
pub type StopCondition = dyn Fn(usize, &[f64]) -> bool + Send + Sync;

/// A controller in an environment, with noise and a specification: the [`System`] that our tasks are.
///
/// Simulations run on all threads of the current rayon pool, up to 16 at a time on each, their observations inferred
/// together. An episode is the same to the bit whatever it runs beside.
pub struct Rollout {
    environment: Arc<dyn Environment>,
    controller: Arc<dyn Controller>,
    specification: Specification,
    noise: Noise,
    space: Space,
    wiring: Wiring,
    stop: Option<Box<StopCondition>>,
    seats: Mutex<Vec<Seat>>,
}

impl Rollout {
    /// Puts the parts together.
    ///
    /// # Errors
    /// If the controller's layout is not the environment's, a formula does not fit the signals, or a noise level is
    /// not a finite number of at least 0.
    pub fn new(
        environment: Arc<dyn Environment>,
        controller: Arc<dyn Controller>,
        specification: Specification,
        noise: Noise,
    ) -> Result<Rollout, RolloutError> {
        let wanted = (environment.observation_size(), environment.action_size());
        let found = (controller.observation_size(), controller.action_size());
        if wanted != found {
            return Err(RolloutError::Layout {
                environment: environment.name().to_string(),
                wanted_observation: wanted.0,
                wanted_action: wanted.1,
                found_observation: found.0,
                found_action: found.1,
            });
        }
        noise.check()?;
        SpecificationMonitor::new(&specification, environment.signals(), environment.control_dt())?;
        let space = environment.space().clone();
        Ok(Rollout {
            wiring: Wiring::new(&space, &space, &[])?,
            space,
            environment,
            controller,
            specification,
            noise,
            stop: None,
            seats: Mutex::new(Vec::new()),
        })
    }

    /// Takes scenarios of `space`: each of its axes is one of the environment's or one of `disturbances`, by name.
    ///
    /// # Errors
    /// If an axis of the space is neither, or one of the environment's is not in the space.
    pub fn with_disturbances(
        mut self,
        space: Space,
        disturbances: &[Disturbance],
    ) -> Result<Rollout, RolloutError> {
        self.wiring = Wiring::new(&space, self.environment.space(), disturbances)?;
        self.space = space;
        Ok(self)
    }

    /// Ends episodes early where `stop` says so; formulas that the shorter trace does not cover are undecided.
    pub fn with_stop(mut self, stop: Box<StopCondition>) -> Rollout {
        self.stop = Some(stop);
        self
    }

    /// The specification that judges the episodes.
    pub fn specification(&self) -> &Specification {
        &self.specification
    }

    fn take_seat(&self) -> Result<Seat, RolloutError> {
        let free = self.seats.lock().map(|mut seats| seats.pop()).unwrap_or(None);
        match free {
            Some(seat) => Ok(seat),
            None => Seat::new(self),
        }
    }

    fn run_rows(&self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        let mut seat = self.take_seat()?;
        let episodes = seat.run(self, requests);
        if let Ok(mut seats) = self.seats.lock() {
            seats.push(seat);
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
            .map(|chunk| this.run_rows(chunk))
            .collect::<Result<Vec<Vec<Episode>>, RolloutError>>()?;
        Ok(chunks.into_iter().flatten().collect())
    }
}

/// What one thread works with: kept between calls, so that a control step allocates nothing.
struct Seat {
    worker: Box<dyn EnvironmentWorker>,
    actor: Box<dyn ControllerWorker>,
    judge: SpecificationMonitor,
    states: Vec<f64>,
    memories: Vec<f64>,
    /// What acts in the loop of each row; empty where the space has no such axis.
    disturbed: Vec<Disturbed>,
    observations: Vec<f32>,
    actions: Vec<f32>,
    action: Vec<f64>,
    signals: Vec<f64>,
    rewards: Vec<f64>,
    draws: Vec<f64>,
}

impl Seat {
    fn new(rollout: &Rollout) -> Result<Seat, RolloutError> {
        let (environment, controller) = (&rollout.environment, &rollout.controller);
        let (observation_size, action_size) = (environment.observation_size(), environment.action_size());
        Ok(Seat {
            worker: environment.worker(),
            actor: controller.worker(),
            judge: SpecificationMonitor::new(
                &rollout.specification,
                environment.signals(),
                environment.control_dt(),
            )?,
            states: vec![0.0; ROWS * environment.state_size()],
            memories: vec![0.0; ROWS * controller.state_size()],
            disturbed: Vec::new(),
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
            self.act(rollout, &mut episodes, step)?;
            for (row, episode) in episodes.iter_mut().enumerate() {
                if episode.end == EpisodeEnd::Completed {
                    self.step(rollout, row, step, episode)?;
                }
            }
            if episodes.iter().all(|episode| episode.end != EpisodeEnd::Completed) {
                break;
            }
        }
        for episode in &mut episodes {
            if !matches!(episode.end, EpisodeEnd::Diverged { .. }) {
                let whole = episode.end == EpisodeEnd::Completed;
                match self.judge.verdict(&episode.trace, whole) {
                    Err(RolloutError::Monitor { source: MonitorError::Undefined { step, .. }, .. }) => {
                        episode.end = EpisodeEnd::Undefined { step };
                    }
                    verdict => episode.verdict = verdict?,
                }
                if episode.request.wants_subformulas && episode.verdict.robustness.is_some() {
                    episode.verdict.subformulas = self.judge.subformulas(&episode.trace)?;
                }
            }
        }
        Ok(episodes)
    }

    fn reset(&mut self, rollout: &Rollout, requests: &[Request]) -> Vec<Episode> {
        let (state_size, observation_size) =
            (rollout.environment.state_size(), rollout.environment.observation_size());
        let memory_size = rollout.controller.state_size();
        let samples = rollout.environment.episode_steps() + 1;
        self.disturbed.clear();
        let mut episodes = Vec::with_capacity(requests.len());
        for (row, request) in requests.iter().enumerate() {
            let Request { scenario, seed, .. } = request;
            let observation = &mut self.observations[row * observation_size..][..observation_size];
            let sample = Sample { observation, signals: &mut self.signals, rewards: &mut self.rewards };
            let state = &mut self.states[row * state_size..][..state_size];
            if rollout.wiring.has_effects() {
                let action_size = self.action.len();
                self.disturbed.push(Disturbed::new(&rollout.wiring, scenario, *seed, action_size));
                self.worker.reset(&rollout.wiring.environment(scenario), *seed, state, sample);
            } else {
                self.worker.reset(scenario, *seed, state, sample);
            }
            self.actor.reset(&mut self.memories[row * memory_size..][..memory_size], *seed);
            let mut trace = Trace::with_capacity(rollout.environment.signals().clone(), samples);
            trace.push(&self.signals);
            episodes.push(Episode {
                request: request.clone(),
                trace,
                verdict: Verdict::default(),
                total_reward: 0.0,
                steps: 0,
                end: EpisodeEnd::Completed,
            });
        }
        episodes
    }

    fn act(&mut self, rollout: &Rollout, episodes: &mut [Episode], step: usize) -> Result<(), RolloutError> {
        let (observation_size, action_size) =
            (rollout.environment.observation_size(), rollout.environment.action_size());
        let rows = episodes.len();
        let observations = self.observations.chunks_mut(observation_size);
        for (row, (observation, episode)) in observations.zip(&*episodes).enumerate() {
            if let Some(disturbed) = self.disturbed.get_mut(row) {
                disturbed.observe(step, observation);
            }
            let draws = &mut self.draws[..observation_size];
            rollout.noise.on_observation(episode.request.seed, step as u64, observation, draws);
        }
        self.actor.act(
            rows,
            &self.observations[..rows * observation_size],
            &mut self.memories[..rows * rollout.controller.state_size()],
            &mut self.actions[..rows * action_size],
        );
        for (actions, episode) in self.actions.chunks(action_size).zip(episodes) {
            if episode.end != EpisodeEnd::Completed {
                continue;
            }
            if let Some(component) = actions.iter().position(|a| !a.is_finite()) {
                let value = f64::from(actions[component]);
                return Err(RolloutError::Action {
                    component,
                    value,
                    step: step + 1,
                    scenario: episode.request.scenario.clone(),
                });
            }
        }
        Ok(())
    }

    fn step(
        &mut self,
        rollout: &Rollout,
        row: usize,
        step: usize,
        episode: &mut Episode,
    ) -> Result<(), RolloutError> {
        let (state_size, observation_size) =
            (rollout.environment.state_size(), rollout.environment.observation_size());
        let action_size = self.action.len();
        for (a, wanted) in self.action.iter_mut().zip(&self.actions[row * action_size..]) {
            *a = f64::from(*wanted).clamp(-1.0, 1.0);
        }
        let mut disturbed = self.disturbed.get_mut(row);
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
            self.worker.step(&self.action, &mut self.states[row * state_size..][..state_size], sample);
        if status == StepStatus::Diverged {
            episode.end = EpisodeEnd::Diverged { step: step + 1 };
            return Ok(());
        }
        episode.trace.push(&self.signals);
        episode.steps = step + 1;
        episode.total_reward += self.rewards.iter().sum::<f64>();
        if rollout.stop.as_ref().is_some_and(|stop| stop(step + 1, &self.signals)) {
            episode.end = EpisodeEnd::Stopped { step: step + 1 };
        }
        Ok(())
    }
}
