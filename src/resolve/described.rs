//! Targets without a controller, to describe them.

use std::sync::Arc;

use mishandle_robots::RobotPolicy;
use mishandle_rollout::{Component, Controller, ControllerWorker, Noise, Target};

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::resolve::policy::Identified;
use crate::resolve::simulator::{described_simulator, simulator_file};
use crate::resolve::{contract_warnings, is_target_file, robot_file, target};

/// Returns the target of a plan for a description: spaces, signals and formulas. A target file
/// needs no policy for it, since nothing is simulated; [`described_warnings`] checks the one that
/// it names.
///
/// # Errors
/// The errors of [`target`], except that the policy of a target file is not read.
pub fn described_target(plan: &Plan) -> Result<Target, MishandleError> {
    if let Some(file) = simulator_file(plan)? {
        return described_simulator(plan, &file);
    }
    if !is_target_file(&plan.target) {
        return target(plan);
    }
    let robot = robot_file(plan)?;
    let (controller, components) = idle(robot.observation_size(), robot.actions());
    Ok(robot.target(controller, components, Noise::default())?)
}

/// Returns a controller whose actions are 0.
pub(crate) fn idle(observations: usize, actions: usize) -> Identified {
    let component = Component {
        role: "controller".to_string(),
        name: "none".to_string(),
        hash: String::new(),
        file_hash: String::new(),
    };
    (Arc::new(Idle { observations, actions }), vec![component])
}

/// Returns the warnings about the policy that a target file names; none for other targets. A
/// program is not started for it.
///
/// # Errors
/// If the policy cannot be read, or no episode can start with it.
pub fn described_warnings(plan: &Plan) -> Result<Vec<String>, MishandleError> {
    let is_skipped = |policy: &RobotPolicy| matches!(policy, RobotPolicy::Open | RobotPolicy::Program(_));
    let is_robot = is_target_file(&plan.target) && simulator_file(plan)?.is_none();
    if !is_robot || is_skipped(robot_file(plan)?.policy()) {
        return Ok(Vec::new());
    }
    contract_warnings(plan)
}

/// A controller whose actions are 0.
struct Idle {
    observations: usize,
    actions: usize,
}

impl Controller for Idle {
    fn observation_size(&self) -> usize {
        self.observations
    }

    fn action_size(&self) -> usize {
        self.actions
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        Box::new(IdleWorker)
    }
}

struct IdleWorker;

impl ControllerWorker for IdleWorker {
    fn act(&mut self, _rows: usize, _observations: &[f32], _states: &mut [f64], actions: &mut [f32]) {
        actions.fill(0.0);
    }
}
