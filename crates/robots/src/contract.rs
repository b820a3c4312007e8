//! The contract between the robot of a file and its policy, checked before the first episode.

use std::sync::Arc;

use mishandle_rollout::{Controller, EnvironmentWorker, Scenario, Seed, Space, StepStatus};
use mishandle_rollout::{Environment, Sample};
use mishandle_world::{ElementKind, JointKind};

use crate::environment::{Robot, RobotEnvironment};
use crate::error::RobotError;
use crate::pattern::names;
use crate::target::RobotFile;
use crate::worker::RobotWorker;

/// Number of control steps of a check.
const STEPS: usize = 10;

/// Share of an axis at which it is held in the second check.
const AWAY: f64 = 0.8;

/// Largest difference of the norm of a quaternion from 1: numbers with two decimals have it.
const ROUNDED: f64 = 0.02;

/// Observations and actions of the first control steps of an episode.
struct Steps {
    observations: Vec<Vec<f32>>,
    actions: Vec<Vec<f32>>,
    /// Number of controls with a range, if the first action puts all of them to its ends.
    saturated: Option<usize>,
    /// Generalized positions at the start.
    start: Vec<f64>,
    /// The control step in which the physics diverged, from 1, with the state before it.
    diverged: Option<(usize, Vec<f64>)>,
}

impl RobotFile {
    /// Runs a policy for a few control steps and returns warnings in words: an action that
    /// saturates, an action or a part of the observation that never changes, numbers that are not
    /// finite for some observations.
    ///
    /// A part that does not change in the nominal scenario is looked at again with all axes away
    /// from nominal: a robot may be at rest in its equilibrium.
    ///
    /// # Errors
    /// If the first observation or the first action of the nominal scenario is not finite, a
    /// quaternion of its start is none of a rotation, or its physics diverges in these steps.
    pub fn check_contract(&self, controller: &dyn Controller) -> Result<Vec<String>, RobotError> {
        let robot = Arc::new(self.compiled(controller.action_size())?);
        let space = Space::new("contract", robot.axes.iter().map(|(axis, _)| axis.clone()).collect())?;
        let environment = RobotEnvironment::over(robot.clone(), &space)?;
        let mut worker = environment.robot_worker(1);
        let nominal = steps(&robot, &mut worker, controller, &space.nominal(), environment.state_size());
        self.check_rotations(&nominal.start)?;
        let away = space.axes().iter().map(|axis| Some(axis.at(AWAY))).collect();
        let away = space.canonical(Scenario::new(away));
        let away = steps(&robot, &mut worker, controller, &away, environment.state_size());
        let Some(first) = nominal.observations.first() else {
            let message = "no episode starts at the nominal start: a condition of `start.invalid` holds, or the physics \
                           diverges while it settles";
            return Ok(vec![message.to_string()]);
        };
        self.check_first(first, &nominal.actions)?;
        if let Some((step, state)) = &nominal.diverged {
            let action = &nominal.actions[step - 1];
            let joint = self.fastest_joint(controller.action_size(), &space, action, state)?;
            let joint = joint.map_or(String::new(), |name| format!(" (joint `{name}`)"));
            return Err(RobotError::Policy {
                message: format!(
                    "the nominal scenario diverges in control step {step}{joint}: a force is too stiff for the time step; usual \
                     ways out are `integrator = \"implicitfast\"` and a smaller `timestep` in [model], or the armature of the \
                     joints"
                ),
            });
        }
        let mut warnings = Vec::new();
        if let Some(count) = nominal.saturated {
            warnings.push(format!(
                "the first action puts all {count} controls to the ends of their ranges: are scale, offset and order of the \
                 actions those of the policy?"
            ));
        }
        let others = others(first);
        let answers: Vec<Vec<f32>> =
            others.iter().map(|observation| answer(controller, observation)).collect();
        let not_finite = answers.iter().filter(|action| action.iter().any(|x| !x.is_finite())).count();
        if not_finite > 0 {
            warnings.push(format!(
                "the action is not finite for {not_finite} of {} other observations: a simulation that meets one ends as \
                 `invalid action`",
                others.len()
            ));
        }
        let all_actions = nominal.actions.iter().chain(&away.actions).chain(&answers);
        if is_constant(all_actions.map(Vec::as_slice)) {
            warnings.push(
                "the action never changes, whatever the policy observes: does it read its observation, and is its output the \
                 action?"
                    .to_string(),
            );
        }
        for part in self.observed() {
            let range = part.first..part.first + part.size;
            let never = |steps: &Steps| is_constant(steps.observations.iter().map(|all| &all[range.clone()]));
            // A start away from nominal may be invalid.
            let is_known = !away.observations.is_empty();
            if is_known && self.part_reads_state(&part.name) && never(&nominal) && never(&away) {
                warnings.push(format!(
                    "the part `{}` of the observation never changes in {STEPS} control steps: does it read the right element?",
                    part.name
                ));
            }
        }
        Ok(warnings)
    }

    fn check_first(&self, first: &[f32], actions: &[Vec<f32>]) -> Result<(), RobotError> {
        let error = |message: String| Err(RobotError::Policy { message });
        for part in self.observed() {
            let numbers = &first[part.first..part.first + part.size];
            if numbers.iter().any(|number| !number.is_finite()) {
                return error(format!(
                    "the part `{}` of the observation is not finite at the nominal start; read other quantities, or change \
                     [start]",
                    part.name
                ));
            }
        }
        let action = actions.first().into_iter().flatten();
        if let Some((index, number)) = action.enumerate().find(|(_, number)| !number.is_finite()) {
            return error(format!(
                "number {} of the action is {number} for the first observation of the nominal scenario; no episode can start. \
                 Order and sizes of the observation: {}",
                index + 1,
                self.observation_text()
            ));
        }
        Ok(())
    }

    /// Checks the quaternions of free and ball joints at the nominal start.
    fn check_rotations(&self, positions: &[f64]) -> Result<(), RobotError> {
        let model = &self.model.physics;
        for index in 0..model.joint_count() {
            let joint = model.joint_at(index);
            let first = match joint.kind {
                JointKind::Free => joint.qpos + 3,
                JointKind::Ball => joint.qpos,
                _ => continue,
            };
            let quaternion = &positions[first..first + 4];
            let norm = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
            if (norm - 1.0).abs() > ROUNDED {
                let name = names(model, ElementKind::Joint).swap_remove(index);
                return Err(RobotError::Policy {
                    message: format!(
                        "the quaternion {quaternion:?} of the joint `{name}` at the nominal start has the norm {norm}, not 1; write \
                         (w, x, y, z), for instance with quat_euler(roll, pitch, yaw)"
                    ),
                });
            }
        }
        Ok(())
    }

    /// Returns the joint that moved fastest before the physics diverged in a control step.
    fn fastest_joint(
        &self,
        actions: usize,
        space: &Space,
        action: &[f32],
        state: &[f64],
    ) -> Result<Option<String>, RobotError> {
        let mut robot = self.compiled(actions)?;
        // The controls follow from a control step without physics.
        let substeps = std::mem::take(&mut robot.substeps);
        let robot = Arc::new(robot);
        let mut worker = RobotEnvironment::over(robot.clone(), space)?.robot_worker(1);
        let mut after = state.to_vec();
        let mut observation = vec![0.0; robot.observation_size];
        let mut signals = vec![0.0; robot.signals.len()];
        let mut rewards = vec![0.0; robot.reward_terms.len()];
        let sample = Sample { signals: &mut signals, observation: &mut observation, rewards: &mut rewards };
        if worker.step(&limited(&robot, action), &mut after, sample) == StepStatus::Diverged
            || !robot.servos.is_empty()
        {
            return Ok(None);
        }
        let world = worker.world_mut();
        let mut fastest = None;
        for _ in 0..substeps {
            let speeds = world.qvel().iter().map(|speed| speed.abs()).enumerate();
            let moving = speeds.filter(|(_, speed)| *speed > 0.0);
            fastest = moving.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(dof, _)| dof);
            world.step();
            if world.take_divergence() {
                break;
            }
        }
        let model = &self.model.physics;
        let moves = |dof: usize| (0..model.joint_count()).rfind(|joint| model.joint_at(*joint).dof <= dof);
        let name = |joint: usize| names(model, ElementKind::Joint).swap_remove(joint);
        Ok(fastest.and_then(moves).map(name))
    }

    /// Returns the parts of the observation with their sizes, and the sum.
    pub fn observation_text(&self) -> String {
        let parts: Vec<String> =
            self.observed().iter().map(|part| format!("{} {}", part.name, part.size)).collect();
        format!("{}; together {}", parts.join(", "), self.observation_size())
    }
}

/// Simulates the first control steps of a scenario; none if no episode starts from it.
fn steps(
    robot: &Robot,
    worker: &mut RobotWorker,
    controller: &dyn Controller,
    scenario: &Scenario,
    state_size: usize,
) -> Steps {
    let mut policy = controller.worker();
    let mut memory = vec![0.0; controller.state_size()];
    policy.reset(&mut memory, Seed(0));
    let mut state = vec![0.0; state_size];
    let mut observation = vec![0.0; robot.observation_size];
    let mut signals = vec![0.0; robot.signals.len()];
    let mut rewards = vec![0.0; robot.reward_terms.len()];
    let mut steps = Steps {
        observations: Vec::new(),
        actions: Vec::new(),
        saturated: None,
        start: Vec::new(),
        diverged: None,
    };
    let sample = Sample { signals: &mut signals, observation: &mut observation, rewards: &mut rewards };
    let status = worker.reset(scenario, Seed(0), &mut state, sample);
    steps.start = worker.world_mut().qpos().to_vec();
    if status != StepStatus::Running {
        return steps;
    }
    for step in 0..STEPS.min(robot.episode_steps) {
        steps.observations.push(observation.clone());
        let mut action = vec![0.0; controller.action_size()];
        policy.look(1, &black(controller));
        policy.act(1, &observation, &mut memory, &mut action);
        steps.actions.push(action.clone());
        let before = state.clone();
        let sample = Sample { signals: &mut signals, observation: &mut observation, rewards: &mut rewards };
        let status = worker.step(&limited(robot, &action), &mut state, sample);
        if step == 0 {
            steps.saturated = saturated(robot, worker.world_mut().ctrl());
        }
        if status == StepStatus::Diverged && action.iter().all(|number| number.is_finite()) {
            steps.diverged = Some((step + 1, before));
        }
        if status != StepStatus::Running {
            break;
        }
    }
    steps
}

/// Returns an action within the limit of a robot.
fn limited(robot: &Robot, action: &[f32]) -> Vec<f64> {
    let limit = robot.action_limit;
    action.iter().map(|x| f64::from(*x).clamp(-limit, limit)).collect()
}

/// Returns the number of controls with a range if all of them are at an end of it.
fn saturated(robot: &Robot, controls: &[f64]) -> Option<usize> {
    // Servos set their own controls.
    let actuated = robot.actuated.iter().filter(|index| **index >= robot.servos.len());
    let ranges = actuated.map(|index| (controls[*index], robot.control_ranges[*index]));
    let is_at_end: Vec<bool> =
        ranges.filter_map(|(x, range)| range.map(|[low, high]| x <= low || x >= high)).collect();
    (!is_at_end.is_empty() && is_at_end.iter().all(|at_end| *at_end)).then_some(is_at_end.len())
}

/// Returns a few other observations: zeros, the opposite, and two near the first one.
fn others(first: &[f32]) -> Vec<Vec<f32>> {
    let near = |scale: f32| -> Vec<f32> {
        first.iter().zip(1u16..).map(|(x, i)| x + scale * (1.7 * f32::from(i)).sin()).collect()
    };
    vec![vec![0.0; first.len()], first.iter().map(|x| -x).collect(), near(0.1), near(1.0)]
}

/// Returns the action for an observation at the start of an episode.
fn answer(controller: &dyn Controller, observation: &[f32]) -> Vec<f32> {
    let mut worker = controller.worker();
    let mut memory = vec![0.0; controller.state_size()];
    worker.reset(&mut memory, Seed(0));
    let mut action = vec![0.0; controller.action_size()];
    worker.look(1, &black(controller));
    worker.act(1, observation, &mut memory, &mut action);
    action
}

/// Returns black images for a controller that sees: the contract is about observations.
fn black(controller: &dyn Controller) -> Vec<u8> {
    vec![0; controller.sees().iter().map(mishandle_rollout::Image::bytes).sum()]
}

fn is_constant<'a>(mut rows: impl Iterator<Item = &'a [f32]>) -> bool {
    let Some(first) = rows.next() else { return true };
    rows.all(|row| row.iter().zip(first).all(|(a, b)| a.to_bits() == b.to_bits()))
}
