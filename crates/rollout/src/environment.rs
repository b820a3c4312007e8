use std::sync::Arc;

use crate::{Scenario, Seed, Space};

/// Something a controller acts in: a shared description, from which each thread takes a [`EnvironmentWorker`].
///
/// One simulation is a *state row*: `state_size` numbers that hold all that the future depends on. A worker carries on
/// any row, and gives the same bits as any other worker would.
pub trait Environment: Send + Sync {
    /// Name, for messages and records.
    fn name(&self) -> &str;
    /// The axes of the scenarios that a reset takes.
    fn space(&self) -> &Space;
    /// Names of the signals, in the order of [`Sample::signals`].
    fn signals(&self) -> &Arc<[String]>;
    /// Names of the reward terms, in the order of [`Sample::rewards`]; the reward is their sum.
    fn reward_terms(&self) -> &[String];
    /// Length of an observation.
    fn observation_size(&self) -> usize;
    /// Number of actions; each is meant for [-1, 1].
    fn action_size(&self) -> usize;
    /// Length of a state row.
    fn state_size(&self) -> usize;
    /// Duration of a control step, s.
    fn control_dt(&self) -> f64;
    /// Control steps of a whole episode.
    fn episode_steps(&self) -> usize;
    /// What one thread needs to step rows.
    fn worker(&self) -> Box<dyn EnvironmentWorker>;
}

/// What one thread needs to reset and step state rows of an [`Environment`].
pub trait EnvironmentWorker: Send {
    /// Writes the row of a new simulation under `scenario` into `state`, and what is seen there into `sample`.
    ///
    /// Whatever the environment draws comes from [`Stream::Reset`](crate::Stream::Reset) of `seed`. The reward terms
    /// are set to 0.
    fn reset(&mut self, scenario: &Scenario, seed: Seed, state: &mut [f64], sample: Sample<'_>);

    /// Carries `state` on by one control step under `action`, which is not clipped, and writes what is seen after it.
    ///
    /// After [`StepStatus::Diverged`] neither the row nor the sample mean anything.
    fn step(&mut self, action: &[f64], state: &mut [f64], sample: Sample<'_>) -> StepStatus;
}

/// Where an environment writes what one sample shows. The lengths are the environment's.
#[derive(Debug)]
pub struct Sample<'a> {
    /// What the controller sees.
    pub observation: &'a mut [f32],
    /// What the formulas speak of.
    pub signals: &'a mut [f64],
    /// The reward, term by term.
    pub rewards: &'a mut [f64],
}

/// How a control step left a simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepStatus {
    /// It can go on.
    Running,
    /// The task is lost or over. This ends an episode in training only; measured episodes run on.
    Terminated,
    /// Its numbers are no longer finite.
    Diverged,
}
