use std::borrow::Cow;
use std::sync::Arc;

use mishandle_stl::Trace;
use rayon::prelude::*;

use crate::disturbance::AxisRouting;
use crate::lane::{Lane, LaneRows, Progress, ROWS, SteeredRow};
use crate::sight::Sight;
use crate::{
    Controller, Disturbance, Environment, EnvironmentWorker, Episode, EpisodeEnd, Eyes, Noise, PerThread,
    Request, RolloutError, Scenario, Space, Specification, SpecificationMonitor, Steerable, SteeredEpisode,
    Steering, StepStatus, System, Verdict,
};

/// The [`System`] of a controller in an environment, with noise and a specification.
///
/// Simulations run on all threads of the current rayon pool. Each thread steps up to 16 simulations
/// in lockstep and computes their actions together. The bits of an episode do not depend on the
/// other episodes.
pub struct Rollout {
    pub(crate) environment: Arc<dyn Environment>,
    pub(crate) controller: Arc<dyn Controller>,
    /// Cameras of the controller; `None` if it sees nothing.
    pub(crate) eyes: Option<Arc<dyn Eyes>>,
    pub(crate) specification: Specification,
    pub(crate) noise: Noise,
    pub(crate) space: Space,
    pub(crate) routing: AxisRouting,
    /// Names of the signals of a trace: those of the environment, then those of the controller.
    pub(crate) signals: Arc<[String]>,
    workers: PerThread<RolloutWorker>,
}

impl Rollout {
    /// Makes a system from its parts.
    ///
    /// # Errors
    /// If the controller's sizes differ from the environment's, the environment does not have the
    /// cameras that the controller sees through, a formula does not fit the signals,
    /// or a noise level is not from 0 to [`Noise::MAX_STD`].
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
        let own = controller.signals().iter().map(|signal| signal.name.clone());
        let signals = environment.signals().iter().cloned().chain(own).collect();
        SpecificationMonitor::new(&specification, &signals, environment.control_dt())?;
        let space = environment.space().clone();
        let seen = controller.sees();
        let eyes = if seen.is_empty() { None } else { Some(environment.eyes(seen)?) };
        Ok(Rollout {
            routing: AxisRouting::new(&space, &space, &[])?,
            space,
            signals,
            environment,
            controller,
            eyes,
            specification,
            noise,
            workers: PerThread::new(),
        })
    }

    /// Replaces the space of scenarios. Each axis of `space` must have the name of an axis of the
    /// environment or of one of `disturbances`.
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

    /// Replaces the controller by one around it, for instance one that records what it does. It has
    /// the sizes and the signals of the controller.
    pub fn map_controller(self, wrap: impl FnOnce(Arc<dyn Controller>) -> Arc<dyn Controller>) -> Rollout {
        let controller = wrap(Arc::clone(&self.controller));
        Rollout { controller, ..self }
    }

    /// Returns the specification that is evaluated on the episodes.
    pub fn specification(&self) -> &Specification {
        &self.specification
    }

    /// Returns the lengths of an observation and an action.
    pub(crate) fn sizes(&self) -> (usize, usize) {
        (self.environment.observation_size(), self.environment.action_size())
    }

    /// Returns the part of a request's scenario that the environment sets.
    pub(crate) fn environment_scenario<'a>(&self, request: &'a Request) -> Cow<'a, Scenario> {
        if self.routing.has_effects() {
            Cow::Owned(self.routing.environment(&request.scenario))
        } else {
            Cow::Borrowed(&request.scenario)
        }
    }
}

impl System for Rollout {
    fn space(&self) -> &Space {
        &self.space
    }

    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        self.simulate(requests, |worker, this, chunk| worker.run(this, chunk, None))
    }

    fn steerable(&self) -> Option<Steerable> {
        let episode_steps = self.environment.episode_steps();
        Some(Steerable {
            axes: self.routing.steered(episode_steps),
            observation_size: self.environment.observation_size(),
            signals: self.signals.len(),
            episode_steps,
        })
    }

    fn rollout_steered(
        &mut self,
        requests: &[Request],
        steering: &dyn Steering,
    ) -> Result<Vec<SteeredEpisode>, RolloutError> {
        let steerable = self.steerable().unwrap_or_default();
        self.simulate(requests, |worker, this, chunk| {
            let mut steered = SteeredRows::new(steering, &steerable, chunk);
            let episodes = worker.run(this, chunk, Some(&mut steered))?;
            Ok(episodes.into_iter().zip(steered.rows).map(|(episode, row)| row.finish(episode)).collect())
        })
    }
}

impl Rollout {
    /// Runs chunks of requests on all threads.
    fn simulate<T: Send>(
        &self,
        requests: &[Request],
        run: impl Fn(&mut RolloutWorker, &Rollout, &[Request]) -> Result<Vec<T>, RolloutError> + Sync,
    ) -> Result<Vec<T>, RolloutError> {
        for request in requests {
            self.space.check(&request.scenario)?;
        }
        let rows = requests.len().div_ceil(rayon::current_num_threads()).clamp(1, ROWS);
        let chunks = requests
            .par_chunks(rows)
            .map(|chunk| {
                let run = |worker: &mut RolloutWorker| run(worker, self, chunk);
                self.workers.with(|| RolloutWorker::new(self), run).flatten()
            })
            .collect::<Result<Vec<Vec<T>>, RolloutError>>()?;
        Ok(chunks.into_iter().flatten().collect())
    }
}

/// The steering of the simulations that a worker steps.
struct SteeredRows<'a> {
    steering: &'a dyn Steering,
    steerable: &'a Steerable,
    rows: Vec<SteeredValues>,
    /// Scratch buffers of the signals of a row, and of the values that are chosen for it.
    signals: Vec<f64>,
    chosen: Vec<f64>,
}

/// The memory of a steering of a simulation, and the values of its scenario so far.
struct SteeredValues {
    memory: Vec<f64>,
    values: Vec<Option<f64>>,
}

impl<'a> SteeredRows<'a> {
    fn new(steering: &'a dyn Steering, steerable: &'a Steerable, requests: &[Request]) -> SteeredRows<'a> {
        let row = |request: &Request| SteeredValues {
            memory: vec![0.0; steering.memory_size()],
            values: request.scenario.values().to_vec(),
        };
        let rows = requests.iter().map(row).collect();
        SteeredRows { steering, steerable, rows, signals: vec![0.0; steerable.signals], chosen: Vec::new() }
    }
}

impl SteeredValues {
    fn finish(self, episode: Episode) -> SteeredEpisode {
        let request = Request { scenario: Scenario::new(self.values), ..episode.request };
        SteeredEpisode { episode: Episode { request, ..episode }, memory: self.memory }
    }
}

/// Environment and lane of one thread.
struct RolloutWorker {
    environment: Box<dyn EnvironmentWorker>,
    sight: Option<Sight>,
    lane: Lane,
    rows: LaneRows,
    states: Vec<f64>,
    progress: Vec<Progress>,
}

impl RolloutWorker {
    fn new(rollout: &Rollout) -> Result<RolloutWorker, RolloutError> {
        let sees = rollout.controller.sees();
        Ok(RolloutWorker {
            environment: rollout.environment.worker(),
            sight: rollout.eyes.as_deref().map(|eyes| Sight::new(eyes, sees, ROWS)),
            lane: Lane::new(rollout)?,
            rows: LaneRows::new(rollout),
            states: vec![0.0; ROWS * rollout.environment.state_size()],
            progress: Vec::with_capacity(ROWS),
        })
    }

    fn run(
        &mut self,
        rollout: &Rollout,
        requests: &[Request],
        mut steered: Option<&mut SteeredRows<'_>>,
    ) -> Result<Vec<Episode>, RolloutError> {
        self.progress.clear();
        let reset = |(row, request)| self.reset(rollout, row, request, steered.is_some());
        let mut episodes: Vec<Episode> = requests.iter().enumerate().map(reset).collect();
        for _ in 0..rollout.environment.episode_steps() {
            if !self.progress.iter().any(Progress::is_running) {
                break;
            }
            self.look(rollout);
            self.lane.act(rollout, &mut self.rows, &mut self.progress);
            for (row, episode) in episodes.iter_mut().enumerate() {
                if self.progress[row].is_running() {
                    if let Some(steered) = &mut steered {
                        self.steer(row, &episode.trace, steered);
                    }
                    self.step(rollout, row, episode, steered.is_some());
                }
            }
        }
        for (episode, progress) in episodes.iter_mut().zip(&mut self.progress) {
            (episode.steps, episode.end) = (progress.steps, progress.end);
            episode.reason = std::mem::take(&mut progress.reason);
            let Episode { request, trace, end, .. } = episode;
            episode.verdict = self.lane.finish(rollout, request, trace, end)?;
        }
        Ok(episodes)
    }

    /// Shows the controller the images of the rows whose episodes run.
    fn look(&mut self, rollout: &Rollout) {
        let Some(sight) = &mut self.sight else { return };
        let size = rollout.environment.state_size();
        for (row, progress) in self.progress.iter().enumerate().filter(|(_, row)| row.is_running()) {
            let is_needed = self.lane.needs_images(rollout, &self.rows, row);
            sight.look(row, progress.steps, &self.states[row * size..][..size], is_needed);
        }
        self.lane.look(self.progress.len(), sight.images(self.progress.len()));
    }

    fn reset(&mut self, rollout: &Rollout, row: usize, request: &Request, is_steered: bool) -> Episode {
        let state_size = rollout.environment.state_size();
        let state = &mut self.states[row * state_size..][..state_size];
        let scenario = rollout.environment_scenario(request);
        let status = self.environment.reset(&scenario, request.seed, state, self.lane.sample(row));
        if let (Some(sight), StepStatus::Running | StepStatus::Terminated) = (&mut self.sight, status) {
            sight.start(row, &scenario, request.seed, state);
        }
        self.lane.start(rollout, &mut self.rows, row, request);
        if is_steered {
            self.lane.watch(&mut self.rows, row);
        }
        self.lane.complete_sample(rollout, &mut self.rows, row);
        let mut progress = Progress::start(request);
        let samples = rollout.environment.episode_steps() + 1;
        let mut trace = Trace::with_capacity(rollout.signals.clone(), samples);
        match self.lane.end_of_start(status) {
            Some(end) => progress.end = end,
            None => {
                trace.push(&self.lane.signals);
                self.record(row, request, is_steered);
            }
        }
        self.progress.push(progress);
        Episode {
            request: request.clone(),
            trace,
            trace_digest: None,
            verdict: Verdict::default(),
            reason: String::new(),
            total_reward: 0.0,
            steps: 0,
            end: EpisodeEnd::Completed,
        }
    }

    /// Adds the last sample to the requirement of a row that may stop early or is steered.
    fn record(&mut self, row: usize, request: &Request, is_steered: bool) {
        if is_steered {
            self.lane.record_watched(&mut self.rows, row);
        } else {
            self.lane.record(&mut self.rows, row, request);
        }
    }

    /// Lets a steering choose values for the next control step of one episode.
    fn steer(&mut self, row: usize, trace: &Trace, steered: &mut SteeredRows<'_>) {
        let SteeredRows { steering, steerable, rows, signals, chosen } = steered;
        let last = |index: usize| trace.column(index).last().copied().unwrap_or(f64::NAN);
        signals.iter_mut().enumerate().for_each(|(index, signal)| *signal = last(index));
        let SteeredValues { memory, values } = &mut rows[row];
        let mut row_of = SteeredRow { steering: *steering, steerable, memory, values, chosen };
        self.lane.steer(&mut self.rows, row, &self.progress[row], signals, &mut row_of);
    }

    /// Runs the next control step of one episode.
    fn step(&mut self, rollout: &Rollout, row: usize, episode: &mut Episode, is_steered: bool) {
        let state_size = rollout.environment.state_size();
        let progress = &mut self.progress[row];
        let has_arrived = self.lane.action(rollout, &mut self.rows, row, progress);
        let state = &mut self.states[row * state_size..][..state_size];
        let (action, sample) = self.lane.action_and_sample(row);
        let status = if has_arrived {
            self.environment.step(action, state, sample)
        } else {
            self.environment.step_before_actions(action, state, sample)
        };
        self.lane.complete_sample(rollout, &mut self.rows, row);
        let step = progress.steps + 1;
        if let Some(end) = self.lane.end_of_step(status, step) {
            progress.end = end;
            return;
        }
        episode.trace.push(&self.lane.signals);
        progress.steps = step;
        episode.total_reward += self.lane.rewards.iter().sum::<f64>();
        self.record(row, &episode.request, is_steered);
        if self.rows.can_stop(row, &episode.request, step) {
            self.progress[row].end = EpisodeEnd::Stopped { step };
        }
    }
}
