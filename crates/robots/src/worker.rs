//! One thread that resets and steps the state rows of a robot.

use std::collections::HashMap;
use std::sync::Arc;

use mishandle_rollout::{EnvironmentWorker, Sample, Scenario, Seed, StepStatus};
use mishandle_world::{Model, RowWorlds, World};

use crate::axes::Parameter;
use crate::change::changed;
use crate::environment::{ModelParts, Robot, Tail};
use crate::events::{EventEffect, jump};
use crate::phase::{Memory, Phase};
use crate::quantity::View;

/// Largest number of models that a worker keeps.
const MODELS: usize = 64;

pub(crate) struct RobotWorker {
    robot: Arc<Robot>,
    parameters: Arc<[Parameter]>,
    world: World,
    /// Models by the bits of the values of their changes.
    models: HashMap<Vec<u64>, Model>,
    limit: usize,
    /// Scratch buffers of the changes of a model and of its key.
    changes: Vec<f64>,
    key: Vec<u64>,
    start: Memory,
    next: Memory,
    command: Memory,
    hold: Memory,
    measured: Memory,
    sample: Memory,
    invalid: Memory,
    /// Values of the reduced signals over the physics steps so far.
    reduced: Vec<f64>,
    observation: Vec<f64>,
    /// Targets of the servos.
    targets: Vec<f64>,
}

impl RobotWorker {
    /// Makes a worker that steps this number of rows in turn.
    pub(crate) fn new(robot: Arc<Robot>, parameters: Arc<[Parameter]>, rows: usize) -> RobotWorker {
        RobotWorker {
            world: robot.model.world(),
            models: HashMap::new(),
            limit: rows.max(MODELS),
            changes: Vec::new(),
            key: Vec::new(),
            start: robot.start.memory(),
            next: robot.next.memory(),
            command: robot.command.memory(),
            hold: robot.hold.memory(),
            measured: robot.measured.memory(),
            sample: robot.sample.memory(),
            invalid: robot.invalid.memory(),
            reduced: vec![0.0; robot.reductions.len()],
            targets: vec![0.0; robot.servos.len()],
            observation: vec![0.0; robot.observation_size],
            parameters,
            robot,
        }
    }
}

impl RowWorlds for RobotWorker {
    fn of_row(&mut self, row: &[f64]) -> &mut World {
        let robot = self.robot.clone();
        let (physics, tail) = row.split_at(robot.model.state_size());
        self.set_model(robot.model_parts(tail), Some(tail[0] * robot.control_dt));
        self.world.set_state(physics);
        &mut self.world
    }
}

impl RobotWorker {
    /// Returns the world of the last episode.
    pub(crate) fn world_mut(&mut self) -> &mut World {
        &mut self.world
    }

    /// Gives the world the model of a row in the physics step that starts at `time`; without a
    /// time, that before the episode.
    fn set_model(&mut self, parts: ModelParts<'_>, time: Option<f64>) {
        if self.robot.changes.is_empty() {
            return;
        }
        self.robot.write_changes(parts, time, &mut self.changes);
        self.key.clear();
        self.key.extend(self.changes.iter().map(|value| value.to_bits()));
        if !self.models.contains_key(&self.key) {
            if self.models.len() >= self.limit {
                self.models.clear();
            }
            let model = changed(&self.robot.model, &self.robot.changes, &self.changes);
            self.models.insert(self.key.clone(), model);
        }
        self.world.set_model(&self.models[&self.key]);
    }

    /// Writes the observation, the signals without a reduction and the rewards of the current
    /// state.
    fn write_sample(&mut self, tail: &mut [f64], sample: &mut Sample<'_>) {
        let robot = &*self.robot;
        if robot.sample.reads_poses() {
            self.world.refresh();
        }
        if robot.sample.reads_external_forces() {
            self.world.refresh_external_forces();
        }
        let Tail { step, values, memory, action, .. } = robot.split(tail);
        let time = *step * robot.control_dt;
        let mut view = View { world: &self.world, time, parameters: values, memory, action };
        robot.sample.run(&mut self.sample, &mut view);
        for (index, (first, size)) in robot.parts.iter().enumerate() {
            robot.sample.write(&self.sample, index, &mut self.observation[*first..first + size]);
        }
        for ((out, value), clip) in sample.observation.iter_mut().zip(&self.observation).zip(&robot.clips) {
            *out = clip.map_or(*value, |[low, high]| clamp(*value, low, high)) as f32;
        }
        let signals = robot.parts.len();
        for (index, signal) in robot.plain_signals.iter().enumerate() {
            let value = robot.sample.value(&self.sample, signals + index)[0];
            sample.signals[*signal] = clip(value, robot.signal_clips[*signal]);
        }
        let rewards = signals + robot.plain_signals.len();
        for (index, reward) in sample.rewards.iter_mut().enumerate() {
            *reward = robot.sample.value(&self.sample, rewards + index)[0];
        }
    }

    /// Returns whether a condition of the last sample ends a training episode.
    fn has_ended(&self) -> bool {
        let robot = &*self.robot;
        let first = robot.parts.len() + robot.plain_signals.len() + robot.reward_terms.len();
        (first..first + robot.ends).any(|index| robot.sample.value(&self.sample, index)[0] != 0.0)
    }

    /// Evaluates the signals with a reduction after a physics step; `count` is the number of steps
    /// before.
    fn measure(&mut self, time: f64, values: &[f64], memory: &[f64], action: &[f64], count: usize) {
        let robot = &*self.robot;
        if robot.measured.is_empty() {
            return;
        }
        // Forward kinematics change no bit of the next step.
        if robot.measured.reads_poses() {
            self.world.refresh();
        }
        if robot.measured.reads_external_forces() {
            self.world.refresh_external_forces();
        }
        let mut view = View { world: &self.world, time, parameters: values, memory, action };
        robot.measured.run(&mut self.measured, &mut view);
        for (index, (reduced, (over, _))) in self.reduced.iter_mut().zip(&robot.reductions).enumerate() {
            *reduced = over.add(*reduced, robot.measured.value(&self.measured, index)[0], count);
        }
    }

    fn write_reduced(&self, count: usize, sample: &mut Sample<'_>) {
        for (reduced, (over, signal)) in self.reduced.iter().zip(&self.robot.reductions) {
            sample.signals[*signal] = clip(over.finish(*reduced, count), self.robot.signal_clips[*signal]);
        }
    }
}

fn clip(value: f64, bounds: Option<[f64; 2]>) -> f64 {
    bounds.map_or(value, |[low, high]| clamp(value, low, high))
}

/// As `f64::clamp`, and NaN stays NaN.
fn clamp(value: f64, low: f64, high: f64) -> f64 {
    if value < low {
        low
    } else if value > high {
        high
    } else {
        value
    }
}

impl EnvironmentWorker for RobotWorker {
    fn reset(
        &mut self,
        scenario: &Scenario,
        seed: Seed,
        state: &mut [f64],
        mut sample: Sample<'_>,
    ) -> StepStatus {
        let robot = self.robot.clone();
        let (physics, tail) = state.split_at_mut(robot.model.state_size());
        tail.copy_from_slice(&robot.nominal_tail());
        for (parameter, value) in self.parameters.iter().zip(scenario.values()) {
            if let Some(value) = value {
                tail[robot.place(*parameter)] = *value;
            }
        }
        for (number, draw) in robot.draws.iter().enumerate() {
            let own = self.parameters.iter().position(|parameter| *parameter == Parameter::Draw(number));
            let given = own.and_then(|index| scenario.get(index));
            tail[robot.place(Parameter::Draw(number))] = draw.value(given, seed, number as u32);
        }
        self.set_model(robot.model_parts(tail), None);
        self.world.reset();
        if let Some(keyframe) = robot.keyframe {
            self.world.qpos_mut().copy_from_slice(robot.model.key_qpos(keyframe));
            self.world.qvel_mut().copy_from_slice(robot.model.key_qvel(keyframe));
            self.world.ctrl_mut().copy_from_slice(robot.model.key_ctrl(keyframe));
        }
        let Tail { values, memory, action, .. } = robot.split(tail);
        let mut view = View { world: &self.world, time: 0.0, parameters: values, memory, action };
        robot.start.run(&mut self.start, &mut view);
        let places = robot.start_positions.iter().chain(&robot.start_velocities).enumerate();
        for (index, indices) in places {
            let value = robot.start.value(&self.start, index);
            let state = if index < robot.start_positions.len() {
                self.world.qpos_mut()
            } else {
                self.world.qvel_mut()
            };
            for (place, index) in indices.iter().enumerate() {
                state[*index] = value[if value.len() == 1 { 0 } else { place }];
            }
        }
        let mut index = robot.start_positions.len() + robot.start_velocities.len();
        for mocap in &robot.start_mocap {
            let pose = robot.start.value(&self.start, index);
            let quaternion = pose.get(3..7).map_or([1.0, 0.0, 0.0, 0.0], |q| [q[0], q[1], q[2], q[3]]);
            self.world.place(*mocap, [pose[0], pose[1], pose[2]], quaternion);
            index += 1;
        }
        for place in &robot.memory {
            robot.start.write(&self.start, index, &mut memory[place.clone()]);
            index += 1;
        }
        if self.settle(values, memory, action) == StepStatus::Diverged {
            return StepStatus::Diverged;
        }
        if robot.start_offset != 0.0 {
            self.world.move_joints(robot.start_offset);
        }
        self.world.read_state(physics);
        if [&robot.sample, &robot.measured, &robot.invalid].iter().any(|phase| phase.reads_forces()) {
            self.world.refresh_sensors();
        }
        if self.is_invalid(values, memory, action) {
            return StepStatus::InvalidStart;
        }
        self.measure(0.0, values, memory, action, 0);
        self.write_sample(tail, &mut sample);
        self.write_reduced(1, &mut sample);
        sample.rewards.fill(0.0);
        StepStatus::Running
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], sample: Sample<'_>) -> StepStatus {
        self.advance(action, true, state, sample)
    }

    fn step_before_actions(&mut self, action: &[f64], state: &mut [f64], sample: Sample<'_>) -> StepStatus {
        self.advance(action, false, state, sample)
    }
}

impl RobotWorker {
    fn advance(
        &mut self,
        action: &[f64],
        has_arrived: bool,
        state: &mut [f64],
        mut sample: Sample<'_>,
    ) -> StepStatus {
        let robot = self.robot.clone();
        let (physics, tail) = state.split_at_mut(robot.model.state_size());
        let start = tail[0] * robot.control_dt;
        self.set_model(robot.model_parts(tail), Some(start));
        self.world.set_state(physics);
        if !self.begin_step(action, has_arrived, tail) {
            return StepStatus::Diverged;
        }
        let Tail { values, model, memory, .. } = robot.split(tail);
        let timestep = robot.model.timestep();
        for substep in 0..robot.substeps {
            let now = start + substep as f64 * timestep;
            if !robot.slips.is_empty() {
                self.set_model(model, Some(now));
            }
            for body in robot.pushed() {
                self.world.push(body, robot.force_on(body, model.events, now));
            }
            self.physics_step();
            if (substep + 1) % robot.measured_every == 0 {
                self.measure(now + timestep, values, memory, action, substep / robot.measured_every);
            }
        }
        if self.world.take_divergence() {
            return StepStatus::Diverged;
        }
        self.world.read_state(physics);
        let status = self.end_step(tail, &mut sample);
        self.write_reduced(robot.substeps / robot.measured_every, &mut sample);
        status
    }
}

/// The parts of a control step before and after the physics, which another engine may take.
impl RobotWorker {
    /// Returns the world.
    pub(crate) fn world(&self) -> &World {
        &self.world
    }

    /// Sets the world to a row that another engine steps: positions and velocities, controls, and
    /// the poses of the mocap bodies. Forces are not those of the row.
    pub(crate) fn load(
        &mut self,
        tail: &[f64],
        positions: &[f64],
        velocities: &[f64],
        controls: &[f64],
        mocap: &[f64],
    ) {
        let robot = self.robot.clone();
        self.set_model(robot.model_parts(tail), Some(tail[0] * robot.control_dt));
        self.world.qpos_mut().copy_from_slice(positions);
        self.world.qvel_mut().copy_from_slice(velocities);
        self.world.ctrl_mut().copy_from_slice(controls);
        self.world.place_all(mocap);
    }

    /// Applies the jumps of a control step, and computes the memory and the controls from the world
    /// and the action. Returns whether the controls are finite.
    pub(crate) fn begin_step(&mut self, action: &[f64], has_arrived: bool, tail: &mut [f64]) -> bool {
        let robot = self.robot.clone();
        let Tail { step, values, model, memory, action: last } = robot.split(tail);
        let start = *step * robot.control_dt;
        for (event, components) in robot.events.iter().zip(model.events) {
            if let EventEffect::Jump(jumping) = event.effect
                && let Some(offset) = jump(components, *step, robot.control_dt)
            {
                jumping.shift(&mut self.world, offset);
            }
        }
        self.refresh_for(&[&robot.next, robot.controls(has_arrived)]);
        // All parts follow from the memory of the step before.
        let mut view = View { world: &self.world, time: start, parameters: values, memory, action };
        robot.next.run(&mut self.next, &mut view);
        for (index, place) in robot.memory.iter().enumerate() {
            robot.next.write(&self.next, index, &mut memory[place.clone()]);
        }
        last.copy_from_slice(action);
        self.set_controls(has_arrived, start, values, memory, action)
    }

    /// Counts a control step and writes its sample, without signals over its physics steps.
    pub(crate) fn end_step(&mut self, tail: &mut [f64], sample: &mut Sample<'_>) -> StepStatus {
        tail[0] += 1.0;
        self.write_sample(tail, sample);
        if self.has_ended() { StepStatus::Terminated } else { StepStatus::Running }
    }
}

impl RobotWorker {
    /// Computes the poses and forces that phases read.
    fn refresh_for(&mut self, phases: &[&Phase]) {
        if phases.iter().any(|phase| phase.reads_forces()) {
            self.world.refresh_sensors();
        } else if phases.iter().any(|phase| phase.reads_poses()) {
            self.world.refresh();
        }
        if phases.iter().any(|phase| phase.reads_external_forces()) {
            self.world.refresh_external_forces();
        }
    }

    /// Sets the controls of a control step. Returns whether they are finite.
    fn set_controls(
        &mut self,
        has_arrived: bool,
        time: f64,
        values: &[f64],
        memory: &[f64],
        action: &[f64],
    ) -> bool {
        let robot = &*self.robot;
        let phase = robot.controls(has_arrived);
        let numbers = if std::ptr::eq(phase, &robot.command) { &mut self.command } else { &mut self.hold };
        phase.run(numbers, &mut View { world: &self.world, time, parameters: values, memory, action });
        let controls = self.world.ctrl_mut();
        for (place, actuator) in robot.actuated.iter().enumerate() {
            let value = phase.value(numbers, 0);
            controls[*actuator] = value[if value.len() == 1 { 0 } else { place }];
        }
        // Targets of servos have no range; their setpoints do.
        let ranges = controls.iter_mut().zip(&robot.control_ranges).skip(robot.servos.len());
        for (control, range) in ranges {
            *control = clip(*control, *range);
        }
        // The servos set the controls in each physics step.
        self.targets.copy_from_slice(&self.world.ctrl()[..robot.servos.len()]);
        self.world.ctrl().iter().all(|control| control.is_finite())
    }

    fn physics_step(&mut self) {
        self.world.step_servos(&self.robot.servos, &self.targets);
    }

    /// Runs the physics from the start to sample 0, with the controls of control steps in which no
    /// action has arrived. The time of expressions stays 0.
    fn settle(&mut self, values: &[f64], memory: &[f64], action: &[f64]) -> StepStatus {
        let robot = self.robot.clone();
        for step in 0..robot.settling {
            if step % robot.substeps == 0 {
                self.refresh_for(&[robot.controls(false)]);
                if !self.set_controls(false, 0.0, values, memory, action) {
                    return StepStatus::Diverged;
                }
            }
            self.physics_step();
        }
        if robot.settling > 0 && self.world.take_divergence() {
            return StepStatus::Diverged;
        }
        StepStatus::Running
    }

    /// Returns whether no episode starts from the current state. Forces are up to date.
    fn is_invalid(&mut self, values: &[f64], memory: &[f64], action: &[f64]) -> bool {
        let robot = &*self.robot;
        if robot.invalid.is_empty() {
            return false;
        }
        if robot.invalid.reads_poses() {
            self.world.refresh();
        }
        if robot.invalid.reads_external_forces() {
            self.world.refresh_external_forces();
        }
        let mut view = View { world: &self.world, time: 0.0, parameters: values, memory, action };
        robot.invalid.run(&mut self.invalid, &mut view);
        (0..robot.invalid.len()).any(|index| robot.invalid.value(&self.invalid, index)[0] != 0.0)
    }
}
