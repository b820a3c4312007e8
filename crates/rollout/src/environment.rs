use std::sync::Arc;

use crate::{Eyes, Image, RolloutError, Scenario, Seed, Space};

/// Facts of an [`Environment`].
#[derive(Clone, Debug)]
pub struct EnvironmentFacts {
    /// The name, for messages and records.
    pub name: String,
    /// The space of the scenarios that a reset accepts.
    pub space: Space,
    /// The names of the signals, in the order of [`Sample::signals`].
    pub signals: Arc<[String]>,
    /// The names of the reward terms, in the order of [`Sample::rewards`]. The reward is their sum.
    pub reward_terms: Vec<String>,
    /// Length of an observation.
    pub observation_size: usize,
    /// Length of the last part of an observation, on which no noise and no disturbance acts: what a
    /// controller knows exactly, such as its own past commands.
    pub exact_size: usize,
    /// Number of actions.
    pub action_size: usize,
    /// Largest absolute value of an action. Actions of a controller are clipped to it.
    pub action_limit: f64,
    /// Length of a state row.
    pub state_size: usize,
    /// Duration of a control step, s.
    pub control_dt: f64,
    /// Number of control steps of an episode.
    pub episode_steps: usize,
}

/// An environment in which a controller acts.
///
/// An environment is shared and immutable. Each thread makes its own [`EnvironmentWorker`]. The
/// state of one simulation is a *state row* of `state_size` numbers, which determine its future.
/// Any worker can step any row, with the same bits.
pub trait Environment: Send + Sync {
    /// Returns the facts, which do not change.
    fn facts(&self) -> &EnvironmentFacts;
    /// Returns [`EnvironmentFacts::name`].
    fn name(&self) -> &str {
        &self.facts().name
    }
    /// Returns [`EnvironmentFacts::space`].
    fn space(&self) -> &Space {
        &self.facts().space
    }
    /// Returns [`EnvironmentFacts::signals`].
    fn signals(&self) -> &Arc<[String]> {
        &self.facts().signals
    }
    /// Returns [`EnvironmentFacts::reward_terms`].
    fn reward_terms(&self) -> &[String] {
        &self.facts().reward_terms
    }
    /// Returns [`EnvironmentFacts::observation_size`].
    fn observation_size(&self) -> usize {
        self.facts().observation_size
    }
    /// Returns [`EnvironmentFacts::exact_size`].
    fn exact_size(&self) -> usize {
        self.facts().exact_size
    }
    /// Returns [`EnvironmentFacts::action_size`].
    fn action_size(&self) -> usize {
        self.facts().action_size
    }
    /// Returns [`EnvironmentFacts::action_limit`].
    fn action_limit(&self) -> f64 {
        self.facts().action_limit
    }
    /// Returns [`EnvironmentFacts::state_size`].
    fn state_size(&self) -> usize {
        self.facts().state_size
    }
    /// Returns [`EnvironmentFacts::control_dt`].
    fn control_dt(&self) -> f64 {
        self.facts().control_dt
    }
    /// Returns [`EnvironmentFacts::episode_steps`].
    fn episode_steps(&self) -> usize {
        self.facts().episode_steps
    }
    /// Returns the cameras of these images.
    ///
    /// # Errors
    /// If the environment has no such camera; by default, it has none.
    fn eyes(&self, images: &[Image]) -> Result<Arc<dyn Eyes>, RolloutError> {
        let camera = images.first().map(|image| image.camera.clone()).unwrap_or_default();
        Err(RolloutError::NoCamera { environment: self.name().to_string(), camera, known: Vec::new() })
    }
    /// Makes a worker for one thread.
    fn worker(&self) -> Box<dyn EnvironmentWorker>;
    /// Makes a worker for one thread that steps this number of rows in turn, so that it can keep
    /// something for each of them. The rows have the same bits with any worker.
    fn worker_of(&self, rows: usize) -> Box<dyn EnvironmentWorker> {
        let _ = rows;
        self.worker()
    }
}

/// Resets and steps state rows of an [`Environment`] on one thread.
pub trait EnvironmentWorker: Send {
    /// Writes the initial state under `scenario` into `state`, and its sample into `sample`. Sets
    /// the reward terms to 0.
    ///
    /// Returns [`StepStatus::Running`], or why no episode starts from the state: the contents of
    /// `sample` are meaningless then. Random draws must come from
    /// [`Stream::Reset`](crate::Stream::Reset) of `seed`.
    fn reset(&mut self, scenario: &Scenario, seed: Seed, state: &mut [f64], sample: Sample<'_>)
    -> StepStatus;

    /// Advances `state` by one control step under `action`, which is not clipped, and writes the
    /// sample after the step.
    ///
    /// After [`StepStatus::Diverged`] the contents of `state` and `sample` are meaningless.
    fn step(&mut self, action: &[f64], state: &mut [f64], sample: Sample<'_>) -> StepStatus;

    /// Advances `state` by one control step in which no action has arrived yet, because of a delay.
    /// By default, the action of this step is 0, as given.
    fn step_before_actions(&mut self, action: &[f64], state: &mut [f64], sample: Sample<'_>) -> StepStatus {
        self.step(action, state, sample)
    }
}

/// Output buffers for one sample of an episode. The environment determines their lengths.
#[derive(Debug)]
pub struct Sample<'a> {
    /// The observation, input of the controller.
    pub observation: &'a mut [f32],
    /// The signals, input of the formulas.
    pub signals: &'a mut [f64],
    /// The reward terms.
    pub rewards: &'a mut [f64],
}

/// Status of a simulation after a reset or a control step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepStatus {
    /// The simulation continues.
    Running,
    /// The simulation reached a terminal state. This ends training episodes; evaluated episodes
    /// continue.
    Terminated,
    /// A state value is no longer finite.
    Diverged,
    /// The environment rejects the scenario. Only a reset returns it.
    InvalidStart,
}
