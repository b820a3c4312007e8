//! Delays and faults between an environment and a controller that other code steps.

use crate::disturbance::{ActiveDisturbances, AxisRouting, command};
use crate::fault::Side;
use crate::memory::Saved;
use crate::real::Real;
use crate::{Disturbance, Noise, RolloutError, Scenario, Seed, Space};

/// The disturbances between an environment and a controller that other code steps, for instance in
/// Python or in training.
#[derive(Clone, Debug)]
pub struct Interface {
    routing: AxisRouting,
    action_size: usize,
}

impl Interface {
    /// Makes the interface of the scenarios of `space`, all of whose axes belong to a disturbance.
    ///
    /// # Errors
    /// If the name of an axis is unknown.
    pub fn new(
        space: &Space,
        disturbances: &[Disturbance],
        action_size: usize,
    ) -> Result<Interface, RolloutError> {
        Interface::around(&Space::new(space.name(), Vec::new())?, space, disturbances, action_size)
    }

    /// Makes the interface of the scenarios of `space`. The other axes belong to an environment
    /// with the space `environment`.
    ///
    /// # Errors
    /// If the name of an axis is unknown, or an axis of the environment is missing from `space`.
    pub fn around(
        environment: &Space,
        space: &Space,
        disturbances: &[Disturbance],
        action_size: usize,
    ) -> Result<Interface, RolloutError> {
        Ok(Interface { routing: AxisRouting::new(space, environment, disturbances)?, action_size })
    }

    /// Returns whether the space has an axis of a disturbance.
    pub fn has_effects(&self) -> bool {
        self.routing.has_effects()
    }

    /// Returns the environment's part of a scenario.
    pub fn environment(&self, scenario: &Scenario) -> Scenario {
        self.routing.environment(scenario)
    }

    /// Starts an episode.
    pub fn start(&self, scenario: &Scenario, seed: Seed) -> ActiveInterface {
        ActiveInterface(ActiveDisturbances::new(&self.routing, scenario, seed, self.action_size))
    }
}

/// The disturbances of one simulation. Control steps count from 0 and must come in order, each with
/// its observation and then its action.
#[derive(Debug)]
pub struct ActiveInterface(ActiveDisturbances);

impl ActiveInterface {
    /// Replaces the observation of a control step by the one that the controller sees.
    pub fn observe<T: Real>(&mut self, step: usize, observation: &mut [T]) {
        self.0.observe(step, observation);
        self.0.fail(Side::Sensing, step, observation);
    }

    /// Returns whether a fault pauses the controller in a control step, so that its last action is
    /// held.
    pub fn is_paused(&self, step: usize) -> bool {
        self.0.is_paused(step)
    }

    /// Returns whether a fault pauses the controller in any control step.
    pub fn has_pause(&self) -> bool {
        self.0.has_pause()
    }

    /// Replaces the clipped action of a control step by the one that the environment gets: with
    /// its disturbances, if there are any, and noise from `seed`. `draws` is a scratch buffer of
    /// the same length.
    pub fn command(
        disturbed: Option<&mut ActiveInterface>,
        noise: Noise,
        seed: Seed,
        step: usize,
        action: &mut [f64],
        draws: &mut [f64],
    ) {
        command(disturbed.map(|active| &mut active.0), noise, seed, step, action, draws);
    }

    /// Appends what depends on earlier control steps to a list.
    pub fn save(&mut self, saved: &mut Vec<f64>) {
        self.0.visit_memory(saved);
    }

    /// Restores what [`save`](Self::save) appended. The scenario and the seed must be the same.
    pub fn restore(&mut self, saved: &[f64]) {
        self.0.visit_memory(&mut Saved(saved));
    }

    /// Replaces the clipped action of a control step by the one that the environment gets. Returns
    /// whether a disturbance acts in this step.
    pub fn act(&mut self, step: usize, action: &mut [f64]) -> bool {
        let before = self.0.disturbs_actions();
        self.0.act(step, action);
        self.0.fail(Side::Actuation, step, action) || before
    }
}
