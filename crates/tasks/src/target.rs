//! A task with a controller in it, as a target.

use std::sync::Arc;

use mishandle_rollout::{
    Axis, Component, Controller, Disturbance, Environment, Identity, Noise, ReachabilityCheck, Rollout,
    RolloutError, Scenario, Signal, Space, Specification, System, SystemFactory, Target,
};

use crate::axes;
use crate::definition::{Preset, Quantity, Reward, Task};
use crate::environment::{TaskEnvironment, TaskError};
use crate::identity::stated;
use crate::robot::{CONTROL_DT, EPISODE_STEPS};

/// A task, a controller in it, and the noise between them.
#[derive(Clone)]
pub struct TaskTarget {
    task: &'static dyn Task,
    preset: Preset,
    controller: Arc<dyn Controller>,
    component: Component,
    noise: Noise,
    /// The task over its initial box: compiled once, shared by all its systems.
    starts: Arc<TaskEnvironment>,
}

impl TaskTarget {
    /// Puts the parts together; `component` says what the controller is.
    ///
    /// # Errors
    /// If the scene does not compile or the task's data do not fit each other.
    pub fn new(
        task: &'static dyn Task,
        preset: Preset,
        (controller, component): (Arc<dyn Controller>, Component),
        noise: Noise,
    ) -> Result<TaskTarget, TaskError> {
        let starts = Arc::new(TaskEnvironment::new(task, preset, Reward::Original)?);
        Ok(TaskTarget { task, preset, controller, component, noise, starts })
    }

    /// The controller.
    pub fn controller(&self) -> &Arc<dyn Controller> {
        &self.controller
    }

    /// The target.
    ///
    /// # Errors
    /// If two axes have the same name, or the controller does not fit the task.
    pub fn target(&self) -> Result<Target, TaskError> {
        let definition = self.task.definition();
        let error = |source| TaskError::Data { task: definition.name, source };
        let settings = self.starts.settings();
        let loops = self.disturbances();
        let axes = settings.iter().map(|(axis, _)| axis).chain(loops.iter().map(|d| &d.axis));
        let signal = |q: &Quantity| Signal { name: q.name.to_string(), unit: q.unit.to_string() };
        let target = Target {
            identity: self.identity()?,
            components: vec![self.component.clone()],
            axes: axes.cloned().collect(),
            spaces: axes::spaces(settings, &loops).map_err(error)?,
            signals: definition.signals.iter().map(signal).collect(),
            formulas: definition.formulas(self.preset).named(),
            control_dt: CONTROL_DT,
            episode_steps: EPISODE_STEPS,
            is_deterministic: true,
            versions: vec![("MuJoCo".to_string(), mishandle_world::mujoco_version())],
            reachable: Some(self.reachable()),
            factory: self.clone().factory(),
        };
        // What does not fit is found now and not when a system is made.
        let all = target.space("all").map_err(error)?;
        let specification = definition.formulas(self.preset).specification().map_err(error)?;
        target.system(&all, &specification).map_err(error)?;
        Ok(target)
    }

    /// The environment over its initial box.
    pub fn starts(&self) -> &Arc<TaskEnvironment> {
        &self.starts
    }

    /// The environment for the axes of `space` that are the environment's.
    ///
    /// # Errors
    /// If the axes do not make a space.
    pub fn environment(&self, space: &Space) -> Result<TaskEnvironment, TaskError> {
        let known = |axis: &&Axis| self.starts.settings().iter().any(|(own, _)| own.name == axis.name);
        let own: Vec<Axis> = space.axes().iter().filter(known).cloned().collect();
        let space = Space::new(space.name(), own)
            .map_err(|source| TaskError::Data { task: self.task.definition().name, source })?;
        self.starts.with_space(space)
    }

    /// The system that runs the controller in `environment`, made by [`environment`](Self::environment) for `space` or a
    /// wrapper of that one.
    ///
    /// # Errors
    /// If the controller does not fit, or a formula does not fit the signals.
    pub fn system_in(
        &self,
        environment: Arc<dyn Environment>,
        space: &Space,
        specification: &Specification,
    ) -> Result<Rollout, RolloutError> {
        Rollout::new(environment, self.controller.clone(), specification.clone(), self.noise)?
            .with_disturbances(space.clone(), &self.disturbances())
    }

    fn disturbances(&self) -> Vec<Disturbance> {
        axes::disturbances(self.task.definition(), self.noise.action_std > 0.0)
    }

    fn identity(&self) -> Result<Identity, TaskError> {
        let Noise { action_std, observation_std } = self.noise;
        let text = format!(
            "{}controller {}\naction noise {action_std}\nobservation noise {observation_std}\n",
            stated(self.task, self.preset)?,
            self.component.hash
        );
        Ok(Identity::new("task", self.task.definition().name, &text))
    }

    fn reachable(&self) -> Arc<ReachabilityCheck> {
        let (task, starts) = (self.task, self.starts.space().clone());
        let nominal = starts.nominal();
        Arc::new(move |space: &Space, scenario: &Scenario| {
            let value = |(index, axis): (usize, &Axis)| {
                let place = space.axes().iter().position(|own| own.name == axis.name);
                place.map_or(nominal.get(index), |place| scenario.get(place)).unwrap_or_default()
            };
            let x0: Vec<f64> = starts.axes().iter().enumerate().map(value).collect();
            task.reachable(&x0)
        })
    }

    fn factory(self) -> Arc<SystemFactory> {
        Arc::new(move |space: &Space, specification: &Specification| {
            let failed = |error: TaskError| RolloutError::System(error_text(&error));
            let environment = self.environment(space).map_err(failed)?;
            let system = self.system_in(Arc::new(environment), space, specification)?;
            Ok(Box::new(system) as Box<dyn System>)
        })
    }
}

/// An error with its causes, on one line.
fn error_text(error: &dyn std::error::Error) -> String {
    let causes = std::iter::successors(Some(error), |error| error.source());
    causes.map(ToString::to_string).collect::<Vec<_>>().join(": ")
}
