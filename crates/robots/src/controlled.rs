//! A robot of a file with a controller in the loop.

use std::sync::Arc;

use mishandle_rollout::{
    Controller, Disturbance, Environment, Noise, Rollout, RolloutError, SolverVariant, Space, Specification,
    System, SystemFactory,
};

use crate::environment::{Robot, RobotEnvironment};

/// A robot with a controller and noise.
#[derive(Clone)]
pub struct ControlledRobot {
    pub(crate) robot: Arc<Robot>,
    pub(crate) controller: Arc<dyn Controller>,
    pub(crate) noise: Noise,
    pub(crate) disturbances: Vec<Disturbance>,
}

impl ControlledRobot {
    /// Returns the controller.
    pub fn controller(&self) -> &Arc<dyn Controller> {
        &self.controller
    }

    /// Returns the environment over the axes of `space` that belong to it. Other axes of `space`
    /// belong to disturbances.
    ///
    /// # Errors
    /// If two axes have the same name.
    pub fn environment(&self, space: &Space) -> Result<RobotEnvironment, RolloutError> {
        RobotEnvironment::over(self.robot.clone(), space)
    }

    /// Makes the system of the controller in `environment`, which must come from
    /// [`environment`](Self::environment) for `space` or wrap such an environment.
    ///
    /// # Errors
    /// If the controller does not fit the environment, or a formula does not fit the signals.
    pub fn system_in(
        &self,
        environment: Arc<dyn Environment>,
        space: &Space,
        specification: &Specification,
    ) -> Result<Rollout, RolloutError> {
        Rollout::new(environment, self.controller.clone(), specification.clone(), self.noise)?
            .with_disturbances(space.clone(), &self.disturbances)
    }

    /// Returns the factories of the robot under changes of its physics.
    pub(crate) fn solver_variants(&self) -> Vec<SolverVariant> {
        SolverVariant::all(|change| {
            let controlled = self.clone();
            Arc::new(move |space: &Space, specification: &Specification| {
                let robot = Arc::new(controlled.robot.with_solver_change(change));
                (ControlledRobot { robot, ..controlled.clone() }.factory())(space, specification)
            })
        })
    }

    pub(crate) fn factory(self) -> Arc<SystemFactory> {
        Arc::new(move |space: &Space, specification: &Specification| {
            let environment = Arc::new(self.environment(space)?);
            Ok(Box::new(self.system_in(environment, space, specification)?) as Box<dyn System>)
        })
    }
}
