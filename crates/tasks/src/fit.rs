//! Fits controllers of files to a task: the further parts of the observation that they read, and
//! their action interface.

use std::sync::Arc;

use mishandle_controllers::{ActionInterface, ActionLimiter, ControllerError, Fitted, JOINT_TARGETS, Layout};
use mishandle_rollout::Controller;
use mishandle_world::{Model, PANDA};

use crate::definition::Definition;
use crate::environment::TaskError;
use crate::robot::Panda;

impl Definition {
    /// Returns the names of the further parts of the observation that a layout names.
    pub fn further_parts_of(&self, layout: &Layout) -> Vec<String> {
        let names = |name: &str| layout.observation.iter().any(|entry| entry.name == name);
        let further = self.further_observation();
        further.iter().filter(|part| names(part.name)).map(|part| part.name.to_string()).collect()
    }

    /// Returns the layout that a controller with the layout `found` must have: that of the task,
    /// with the further parts that it names.
    pub fn layout_for(&self, found: &Layout) -> Layout {
        self.layout_with(&self.further_parts_of(found))
    }

    /// Returns the limiter of an action interface for observations and actions with this layout.
    ///
    /// # Errors
    /// If the layout has no joint targets, or the interface does not fit the arm.
    pub fn limiter(&self, layout: &Layout, interface: &ActionInterface) -> Result<ActionLimiter, TaskError> {
        let error = |source| TaskError::Interface { task: self.name, source };
        let mut parts = layout.observation.iter();
        let place = parts.clone().position(|entry| entry.name == JOINT_TARGETS);
        let place = place.ok_or_else(|| error(ControllerError::NoJointTargets))?;
        let first = parts.by_ref().take(place).map(|entry| entry.size).sum();
        let scene_error = |source| TaskError::Scene { task: self.name, source };
        let panda = Model::from_xml(PANDA).and_then(|model| Panda::new(&model)).map_err(scene_error)?;
        ActionLimiter::new(interface, panda.joint_targets(first)).map_err(error)
    }

    /// Returns a controller with this layout and interface as it fits into the environment of the
    /// task.
    ///
    /// # Errors
    /// As for [`limiter`](Self::limiter).
    pub fn fit(
        &self,
        controller: Arc<dyn Controller>,
        layout: &Layout,
        interface: Option<&ActionInterface>,
    ) -> Result<Arc<dyn Controller>, TaskError> {
        let further_parts = self.further_parts_of(layout);
        let limiter = interface.map(|interface| self.limiter(layout, interface)).transpose()?;
        if further_parts.is_empty() && limiter.is_none() {
            return Ok(controller);
        }
        Ok(Arc::new(Fitted::new(controller, further_parts, limiter)))
    }
}
