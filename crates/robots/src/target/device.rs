//! Robots in worlds of another physics engine, and the parts of a file that it cannot simulate.

use mishandle_rollout::{RolloutError, Space};
use mishandle_world::{Body, ModelField, WorldDevice};

use crate::axes::Parameter;
use crate::axis_table::{AxisEffect, AxisTable};
use crate::batch::RobotBatch;
use crate::controlled::ControlledRobot;
use crate::description::{Expression, Named};
use crate::environment::{Robot, RobotEnvironment};
use crate::error::{Problem, RobotError};
use crate::events::{EventEffect, Jumping};
use crate::phase::PhaseBuilder;
use crate::target::RobotFile;

/// A robot whose physics another engine can step: see [`RobotFile::on_device`].
pub struct DeviceRobot {
    environment: RobotEnvironment,
    fields: Vec<ModelField>,
    pushed: Option<Body>,
}

impl DeviceRobot {
    /// Makes a batch of `rows` rows.
    ///
    /// # Errors
    /// If `device` cannot make the worlds, for instance because it does not support the model.
    pub fn batch(&self, device: &dyn WorldDevice, rows: usize) -> Result<RobotBatch, RolloutError> {
        RobotBatch::new(&self.environment, &self.fields, self.pushed, device, rows)
    }
}

impl RobotFile {
    /// Returns this robot over the axes of `space` that belong to it, for the worlds of another
    /// physics engine. They return positions and velocities after a control step, and nothing that
    /// happened between its physics steps. Events outside the space do not matter.
    ///
    /// # Errors
    /// If the robot needs more than that, with the line in the file, or two axes have the same
    /// name.
    pub fn on_device(&self, robot: &ControlledRobot, space: &Space) -> Result<DeviceRobot, RobotError> {
        let environment = robot.environment(space)?;
        let robot = &*robot.robot;
        let parameters = &*environment.parameters;
        self.check_expressions(robot).map_err(|problem| self.at(problem))?;
        let pushed = self.pushed(robot, parameters).map_err(|problem| self.at(problem))?;
        let changes = parameters.iter().filter_map(|parameter| match parameter {
            Parameter::Change(index) => Some(&robot.changes[*index]),
            _ => None,
        });
        // The fields of a change do not depend on its value.
        let changes: Vec<_> = changes.flat_map(|change| change.changes(change.nominal)).collect();
        Ok(DeviceRobot { fields: ModelField::of(&changes), pushed, environment })
    }

    /// Checks what the expressions read in each control step.
    fn check_expressions(&self, robot: &Robot) -> Result<(), Problem> {
        let description = &self.description;
        if let Some(named) = description.signals.iter().find(|named| named.value.over.is_some()) {
            let message =
                format!("the signal `{}` has `over`, which needs each physics step", named.key.name);
            return Err(refused(&named.key.span, &message));
        }
        let servos = robot.servos.len();
        if let Some(tables) = &description.servos
            && (0..servos).any(|servo| !robot.actuated.contains(&servo))
        {
            let message =
                "an actuator of [servos] that `policy.actuators` leaves out keeps its last setpoint";
            return Err(refused(&tables.span, message));
        }
        let library = self.library(&self.memory, Some(robot.action_size), &description.signals);
        let observed = |named: &&Named<_>| self.observed().iter().any(|part| part.name == named.key.name);
        let quantities = description.observation.iter().filter(observed).chain(&description.signals);
        let memory = description.memory.iter().map(|named| (named.key.name.as_str(), &named.value.next));
        let expressions = quantities
            .map(|named| (named.key.name.as_str(), &named.value.value))
            .chain(memory)
            .chain([("policy.action", &description.policy.action)])
            .chain(description.policy.hold.iter().map(|hold| ("policy.hold", hold)));
        for (name, expression) in expressions {
            let Expression { text, .. } = expression;
            let mut phase = PhaseBuilder::new(&library);
            phase.add(expression)?;
            let phase = phase.finish();
            if phase.reads_forces() {
                let message = format!("`{name}` reads forces or sensors");
                return Err(refused(&text.span, &message));
            }
            if phase.reads_controls(servos) {
                let message = format!("`{name}` reads `ctrl` of [servos], which change in each physics step");
                return Err(refused(&text.span, &message));
            }
        }
        Ok(())
    }

    /// Checks the events that may happen, and returns the body that they push.
    fn pushed(&self, robot: &Robot, parameters: &[Parameter]) -> Result<Option<Body>, Problem> {
        let is_event = |named: &&Named<AxisTable>| matches!(named.value.effect, AxisEffect::Event(_));
        let named = self.description.axes.iter().filter(is_event);
        let mut pushed = None;
        for (index, (named, event)) in named.zip(&robot.events).enumerate() {
            if !event.can_act(index, parameters) {
                continue;
            }
            let message = match event.effect {
                EventEffect::Push(body) if *pushed.get_or_insert(body) != body => "pushes a second body",
                EventEffect::Jump(Jumping::Free(_)) => "displaces a free body",
                EventEffect::Slip(_) => "is a slip",
                EventEffect::Push(_) | EventEffect::Jump(Jumping::Mocap(_)) => continue,
            };
            return Err(refused(&named.key.span, &format!("the event `{}` {message}", named.key.name)));
        }
        Ok(pushed)
    }
}

/// Returns the problem of a part of the file that another engine cannot simulate.
fn refused(span: &std::ops::Range<usize>, message: &str) -> Problem {
    Problem::new(span, format!("{message}; another physics engine cannot do that, so ask without screening"))
}
