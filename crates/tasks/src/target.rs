//! A task with a controller, as a target of evaluation and falsification.

use std::sync::Arc;

use mishandle_controllers::Fitted;
use mishandle_rollout::{
    Axis, Component, Controller, Disturbance, Environment, Identity, Noise, ReachabilityCheck, Rollout,
    RolloutError, Scenario, Signal, SolverChange, SolverVariant, Space, Specification, System, SystemFactory,
    Target,
};

use crate::axes::random_axes;
use crate::definition::{Preset, Quantity, Reward, Task};
use crate::environment::{TaskEnvironment, TaskError};
use crate::identity::target_identity;
use crate::manner::MANNER;
use crate::robot::{CONTROL_DT, EPISODE_STEPS};
use crate::sight::sight;

/// A task with a controller and noise.
#[derive(Clone)]
pub struct TaskTarget {
    task: &'static dyn Task,
    preset: Preset,
    controller: Arc<dyn Controller>,
    /// The controller, and further parts such as its guard.
    components: Vec<Component>,
    noise: Noise,
    /// The environment over the initial box. It is compiled once and shared by all systems.
    starts: Arc<TaskEnvironment>,
}

impl TaskTarget {
    /// Makes a target. The components are the controller and its further parts.
    ///
    /// # Errors
    /// If the scene does not compile or the definition of the task is inconsistent.
    pub fn new(
        task: &'static dyn Task,
        preset: Preset,
        controller: Arc<dyn Controller>,
        components: Vec<Component>,
        noise: Noise,
    ) -> Result<TaskTarget, TaskError> {
        let starts = TaskEnvironment::new(task, preset, Reward::Original)?;
        let starts = Arc::new(starts.with_further_parts(controller.further_parts())?);
        Ok(TaskTarget { task, preset, controller, components, noise, starts })
    }

    /// Returns the controller.
    pub fn controller(&self) -> &Arc<dyn Controller> {
        &self.controller
    }

    /// Returns the task and controller as a [`Target`].
    ///
    /// # Errors
    /// If the scene does not compile, two axes have the same name, or the controller does not fit
    /// the task.
    pub fn target(&self) -> Result<Target, TaskError> {
        let definition = self.task.definition();
        let error = |source| TaskError::Data { task: definition.name, source };
        let disturbances = self.disturbances();
        let (axes, spaces) = self.starts.axes_and_spaces(&disturbances, self.controller.sees())?;
        let signal = |q: &Quantity| Signal { name: q.name.to_string(), unit: q.unit.to_string() };
        let target = Target {
            identity: self.identity()?,
            components: self.components.clone(),
            axes,
            spaces,
            signals: definition.signals.iter().map(signal).collect(),
            signals_on_request: MANNER.iter().map(signal).collect(),
            controller_signals: self.controller.signals().to_vec(),
            formulas: definition.formulas(self.preset).named(),
            control_dt: CONTROL_DT,
            episode_steps: EPISODE_STEPS,
            is_deterministic: true,
            can_fail: false,
            depends_on_seed: definition.start_noise > 0.0
                || self.noise.action_std > 0.0
                || self.noise.observation_std > 0.0,
            random_axes: self.random_axes(&disturbances),
            versions: vec![("MuJoCo".to_string(), mishandle_world::mujoco_version())],
            reachable: Some(self.reachability_check()),
            factory: self.clone().factory(),
            solver_variants: SolverVariant::all(|change| {
                let target = self.clone();
                Arc::new(move |space: &Space, specification: &Specification| {
                    (target.with_solver_change(change).factory())(space, specification)
                })
            }),
        };
        // This reports mismatches now instead of in the first use of the factory.
        let all = target.space("all").map_err(error)?;
        let specification = definition.formulas(self.preset).specification().map_err(error)?;
        target.system(&all, &specification).map_err(error)?;
        Ok(target)
    }

    fn with_solver_change(&self, change: SolverChange) -> TaskTarget {
        TaskTarget { starts: Arc::new(self.starts.with_solver_change(change)), ..self.clone() }
    }

    /// Returns the target, and another controller of the task, in an environment that writes all
    /// further parts of the observation that one of both reads.
    ///
    /// # Errors
    /// If the task does not have one of them.
    pub fn beside(&self, other: Arc<dyn Controller>) -> Result<(TaskTarget, Arc<dyn Controller>), TaskError> {
        let definition = self.task.definition();
        let layout =
            definition.layout_with(&[self.controller.further_parts(), other.further_parts()].concat());
        let parts = definition.further_parts_of(&layout);
        let starts = Arc::new(self.starts.with_further_parts(&parts)?);
        let controller = Fitted::of_layout(self.controller.clone(), &layout, &parts);
        let other = Fitted::of_layout(other, &layout, &parts);
        Ok((TaskTarget { starts, controller, ..self.clone() }, other))
    }

    /// Returns the environment over the initial box.
    pub fn starts(&self) -> &Arc<TaskEnvironment> {
        &self.starts
    }

    /// Returns the environment over the axes of `space` that belong to the scene. Other axes of
    /// `space` belong to disturbances. It computes the [signals of the manner](MANNER) if
    /// `specification` reads one of them.
    ///
    /// # Errors
    /// If two axes have the same name or the bounds of an axis are invalid.
    pub fn environment(
        &self,
        space: &Space,
        specification: &Specification,
    ) -> Result<TaskEnvironment, TaskError> {
        let environment = self.starts.with_scene_axes(space)?;
        let manner: Vec<&str> = MANNER.iter().map(|signal| signal.name).collect();
        if specification.reads_any(&manner) { Ok(environment.with_manner()) } else { Ok(environment) }
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
            .with_disturbances(space.clone(), &self.disturbances())
    }

    /// Returns the names of the axes that add randomness: also those of images, if the controller
    /// sees any.
    fn random_axes(&self, disturbances: &[Disturbance]) -> Vec<String> {
        let mut names = random_axes(disturbances);
        if !self.controller.sees().is_empty() {
            names.extend(sight(self.task.definition()).random_axes().map(str::to_string));
        }
        names
    }

    fn disturbances(&self) -> Vec<Disturbance> {
        self.starts.disturbances(self.noise.action_std > 0.0)
    }

    fn identity(&self) -> Result<Identity, TaskError> {
        target_identity(self.task, self.preset, &Component::joint_hash(&self.components), self.noise)
    }

    fn reachability_check(&self) -> Arc<ReachabilityCheck> {
        let task = self.task;
        let starts = self.starts.space().clone();
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
            let environment = self.environment(space, specification).map_err(failed)?;
            let system = self.system_in(Arc::new(environment), space, specification)?;
            Ok(Box::new(system) as Box<dyn System>)
        })
    }
}

/// Returns an error and its causes on one line.
fn error_text(error: &dyn std::error::Error) -> String {
    let causes = std::iter::successors(Some(error), |error| error.source());
    causes.map(ToString::to_string).collect::<Vec<_>>().join(": ")
}
