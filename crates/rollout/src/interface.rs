//! Delays and faults of an environment that this crate does not step.

use crate::disturbance::{ActiveDisturbances, AxisRouting};
use crate::fault::Side;
use crate::real::Real;
use crate::{Disturbance, RolloutError, Scenario, Seed, Space};

/// The disturbances between an environment and a controller that other code steps, for instance in
/// Python.
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
        let nothing = Space::new(space.name(), Vec::new())?;
        Ok(Interface { routing: AxisRouting::new(space, &nothing, disturbances)?, action_size })
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

    /// Replaces the clipped action of a control step by the one that the environment gets. Returns
    /// whether a disturbance acts in this step.
    pub fn act(&mut self, step: usize, action: &mut [f64]) -> bool {
        let before = self.0.disturbs_actions();
        self.0.act(step, action);
        self.0.fail(Side::Actuation, step, action) || before
    }
}
