use std::sync::Arc;

use mishandle_controllers::ControllerError;
use mishandle_rollout::{
    Axis, Disturbance, Environment, EnvironmentFacts, EnvironmentWorker, Eyes, Image, RolloutError,
    START_OFFSET, Sample, Scenario, Seed, SolverChange, Space, StepStatus, Stream,
};
use mishandle_stl::Formula;
use mishandle_world::{BatchLayout, Model, ModelField, ProbeRecorder, Readings, Rows, World, WorldError};

use crate::axes::{self, Constant, Elements, JUMP_SIZE, PUSH_SIZE, Parameter, Push, SLIP_SIZE};
use crate::check::{check_definition, check_scene, check_substeps, compile};
use crate::definition::{Definition, GripperMode, Preset, Reward, Scene, Task};
use crate::document::compose;
use crate::further::{FurtherParts, Known};
use crate::manner::{MANNER, MEMORY, Manner, probe};
use crate::manner_reward::{MannerReward, MannerWeights};
use crate::robot::{ARM_JOINTS, CONTROL_DT, EPISODE_STEPS, JOINTS, Panda};
use crate::row_world::RowWorld;
use crate::sight::{eyes, sight};

/// Bound to which observations are clipped.
const OBSERVATION_LIMIT: f64 = 5.0;

/// Errors of a task: invalid definition, scene or formulas.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TaskError {
    /// The scene does not compile, or an element is missing.
    #[error("task {task}")]
    Scene {
        /// Name of the task.
        task: &'static str,
        /// Error of MuJoCo.
        source: WorldError,
    },
    /// A field of the task's definition is invalid, or a function of its scene does not fit it.
    #[error("task {task}, field `{field}`: {problem}")]
    Field {
        /// Name of the task.
        task: &'static str,
        /// Field of [`Definition`].
        field: &'static str,
        /// Problem and expected value.
        problem: String,
    },
    /// The action interface of a controller does not fit the robot.
    #[error("task {task}")]
    Interface {
        /// Name of the task.
        task: &'static str,
        /// Problem.
        source: ControllerError,
    },
    /// The initial box or a formula is invalid.
    #[error("task {task}")]
    Data {
        /// Name of the task.
        task: &'static str,
        /// Problem.
        source: RolloutError,
    },
}

/// A task as an environment.
///
/// A state row contains MuJoCo's state and the nine joint targets. If the space has axes of model
/// constants or events, the control step and the values of these axes follow. What the [signals of
/// the manner](Self::with_manner) and [its reward terms](Self::with_manner_reward) need comes last.
/// Random numbers are drawn only at the reset.
#[derive(Clone)]
pub struct TaskEnvironment {
    definition: &'static Definition,
    model: Model,
    panda: Panda,
    scene: Arc<dyn Scene>,
    reward: Reward,
    /// All axes of the scene and their parameters, axes of the initial box first.
    parameters: Vec<(Axis, Parameter)>,
    /// Parameter of each axis of the space.
    space_parameters: Arc<[Parameter]>,
    elements: Elements,
    manner: Manner,
    has_manner: bool,
    manner_reward: MannerReward,
    /// Distance by which every joint coordinate moves after a reset, rad or m.
    start_offset: f64,
    further: FurtherParts,
    facts: EnvironmentFacts,
}

impl TaskEnvironment {
    /// Makes the environment of `task` under a preset with a reward. Its space is the initial box.
    ///
    /// # Errors
    /// If the scene does not compile or the definition of the task is inconsistent.
    pub fn new(task: &dyn Task, preset: Preset, reward: Reward) -> Result<TaskEnvironment, TaskError> {
        let definition = task.definition();
        Self::with_substeps(task, preset, reward, definition.n_substeps)
    }

    /// Makes the environment with another number of physics steps per control step, to check that
    /// outcomes do not depend on it.
    ///
    /// # Errors
    /// As for [`new`](Self::new).
    pub fn with_substeps(
        task: &dyn Task,
        preset: Preset,
        reward: Reward,
        n_substeps: usize,
    ) -> Result<TaskEnvironment, TaskError> {
        let definition = task.definition();
        check_definition(definition)?;
        check_substeps(definition, n_substeps)?;
        let scene_error = |source| TaskError::Scene { task: definition.name, source };
        let data_error = |source| TaskError::Data { task: definition.name, source };
        let model = compose(task)
            .and_then(|xml| compile(task, &without_visuals(&xml)))
            .map_err(scene_error)?
            .with_timestep(CONTROL_DT / n_substeps as f64);
        let panda = Panda::new(&model).map_err(scene_error)?;
        let scene = task.bind(&model, &panda).map_err(scene_error)?;
        check_scene(definition, &model, &panda, &*scene)?;
        let manner = Manner::new(probe(definition, &model, &panda).map_err(scene_error)?, n_substeps);
        let environment = TaskEnvironment {
            definition,
            elements: Elements::new(definition, &model, panda).map_err(scene_error)?,
            model,
            panda,
            scene: scene.into(),
            reward,
            parameters: axes::parameters(definition, preset).map_err(data_error)?,
            space_parameters: (0..definition.initial_box.len()).map(Parameter::Start).collect(),
            manner,
            has_manner: false,
            manner_reward: MannerReward::default(),
            start_offset: 0.0,
            further: FurtherParts::default(),
            facts: EnvironmentFacts {
                name: definition.name.to_string(),
                space: definition.starts(preset).map_err(data_error)?,
                signals: definition.signals.iter().map(|signal| signal.name.to_string()).collect(),
                reward_terms: definition.reward(reward).iter().map(|term| term.name.to_string()).collect(),
                observation_size: definition.layout().observation_size(),
                exact_size: 0,
                action_size: JOINTS,
                action_limit: 1.0,
                state_size: 0,
                control_dt: CONTROL_DT,
                episode_steps: EPISODE_STEPS,
            },
        };
        Ok(environment.with_state_size())
    }

    /// Returns the environment under a change of its physics that no verdict may depend on.
    pub fn with_solver_change(&self, change: SolverChange) -> TaskEnvironment {
        match change {
            SolverChange::HalfStep => {
                let manner = Manner::new(self.manner.probe().clone(), 2 * self.substeps());
                let model = self.model.with_timestep(0.5 * self.model.timestep());
                TaskEnvironment { model, manner, ..self.clone() }
            }
            SolverChange::OtherCollider => {
                TaskEnvironment { model: self.model.with_other_collider(), ..self.clone() }
            }
            SolverChange::MovedStart => TaskEnvironment { start_offset: START_OFFSET, ..self.clone() },
        }
    }

    /// Returns the environment over another space. Axes of the task that it does not contain keep
    /// their nominal values.
    ///
    /// # Errors
    /// If `space` has an axis that the task does not have.
    pub fn with_space(&self, space: Space) -> Result<TaskEnvironment, TaskError> {
        let find = |axis: &Axis| self.parameters.iter().find(|(known, _)| known.name == axis.name);
        let unknown = |axis: &Axis| TaskError::Data {
            task: self.definition.name,
            source: RolloutError::Axis { axis: axis.name.clone(), what: "the task has no such axis" },
        };
        let parameter =
            |axis: &Axis| find(axis).map(|(_, parameter)| *parameter).ok_or_else(|| unknown(axis));
        let space_parameters = space.axes().iter().map(parameter).collect::<Result<_, _>>()?;
        let facts = EnvironmentFacts { space, ..self.facts.clone() };
        Ok(TaskEnvironment { space_parameters, facts, ..self.clone() }.with_state_size())
    }

    fn with_state_size(mut self) -> TaskEnvironment {
        self.facts.state_size = self.model.state_size() + JOINTS + self.tail_size() + self.memory_size();
        self
    }

    /// Returns the environment over the axes of `space` that belong to the scene. The others must
    /// belong to [disturbances](Self::disturbances).
    ///
    /// # Errors
    /// If two axes have the same name or the bounds of an axis are invalid.
    pub fn with_scene_axes(&self, space: &Space) -> Result<TaskEnvironment, TaskError> {
        let known = |axis: &&Axis| self.parameters.iter().any(|(own, _)| own.name == axis.name);
        let own: Vec<Axis> = space.axes().iter().filter(known).cloned().collect();
        self.with_space(Space::new(space.name(), own).map_err(|source| self.data_error(source))?)
    }

    /// Returns the disturbances of observations and actions. Explicit draws of the action noise
    /// exist only if there is noise.
    pub fn disturbances(&self, action_noise: bool) -> Vec<Disturbance> {
        axes::disturbances(self.definition, &self.panda, action_noise)
    }

    /// Returns all axes of the scene and of these disturbances, and the named spaces, `starts`
    /// first. Axes that change nothing of the images `seen` are only in the spaces of sight.
    ///
    /// # Errors
    /// If two axes have the same name.
    pub fn axes_and_spaces(
        &self,
        disturbances: &[Disturbance],
        seen: &[Image],
    ) -> Result<(Vec<Axis>, Vec<Space>), TaskError> {
        let unseen = sight(self.definition).unseen_axes(seen);
        let own = self.parameters.iter().filter(|(axis, _)| !unseen.contains(&axis.name));
        let axes = own.map(|(axis, _)| axis).chain(disturbances.iter().map(|d| &d.axis));
        let spaces = axes::spaces(self.definition, &self.parameters, disturbances)
            .map_err(|source| self.data_error(source))?;
        Ok((axes.cloned().collect(), spaces))
    }

    fn data_error(&self, source: RolloutError) -> TaskError {
        TaskError::Data { task: self.definition.name, source }
    }

    /// Returns the environment that also computes the [signals of the manner](MANNER), after those
    /// of the task. The other signals keep their bits.
    pub fn with_manner(&self) -> TaskEnvironment {
        let names = self.definition.signals.iter().chain(MANNER).map(|signal| signal.name.to_string());
        let facts = EnvironmentFacts { signals: names.collect(), ..self.facts.clone() };
        TaskEnvironment { facts, has_manner: true, ..self.clone() }.with_state_size()
    }

    /// Returns the environment that also writes these [further parts](Definition::further_observation)
    /// of the observation, after the others. The others keep their bits.
    ///
    /// # Errors
    /// If the task does not have one of them.
    pub fn with_further_parts(&self, names: &[String]) -> Result<TaskEnvironment, TaskError> {
        let definition = self.definition;
        let further = FurtherParts::named(definition, names).ok_or_else(|| TaskError::Field {
            task: definition.name,
            field: "further_observation",
            problem: format!("it does not have all of {}", names.join(", ")),
        })?;
        let base = definition.layout().observation_size();
        let exact_size = further.size();
        let observation_size = base + exact_size;
        let facts = EnvironmentFacts { observation_size, exact_size, ..self.facts.clone() };
        Ok(TaskEnvironment { further, facts, ..self.clone() }.with_state_size())
    }

    /// Returns the environment with more [reward terms](crate::MANNER_REWARD): those with a weight
    /// above 0, after those of the task. The others keep their bits. Training episodes have
    /// `episode_steps` control steps.
    pub fn with_manner_reward(&self, weights: MannerWeights, episode_steps: usize) -> TaskEnvironment {
        let careful = self.definition.paper.careful().and_then(|text| Formula::parse(&text).ok());
        let limited = careful.as_ref().map_or_else(Vec::new, Formula::signals);
        let manner_reward = MannerReward::new(weights, episode_steps, &limited);
        let environment = if manner_reward.needs_manner() { self.with_manner() } else { self.clone() };
        let terms = self.definition.reward(self.reward).iter().chain(manner_reward.terms());
        let reward_terms = terms.map(|term| term.name.to_string()).collect();
        let facts = EnvironmentFacts { reward_terms, ..environment.facts.clone() };
        TaskEnvironment { manner_reward, facts, ..environment }.with_state_size()
    }

    /// Returns the length of the last part of a state row: the memory of the signals of the manner,
    /// of its reward terms, and of the further parts of the observation.
    pub(crate) fn memory_size(&self) -> usize {
        let of_manner = self.manner().map_or(0, |_| MEMORY);
        of_manner + self.manner_reward.memory_size() + self.further.memory_size()
    }

    /// Returns the signals of the manner, if the environment computes them.
    pub(crate) fn manner(&self) -> Option<&Manner> {
        self.has_manner.then_some(&self.manner)
    }

    /// Returns the compiled model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Returns the definition of the task.
    pub fn definition(&self) -> &'static Definition {
        self.definition
    }

    /// Returns the parameters of an undisturbed episode.
    fn nominal(&self) -> ParameterValues {
        let mut values = ParameterValues {
            start: vec![0.0; self.definition.initial_box.len()],
            constants: Vec::new(),
            push: [0.0; PUSH_SIZE],
            jump: [0.0; JUMP_SIZE],
            slip: [0.0; SLIP_SIZE],
            throw_speed: 1.0,
            start_draws: [None; ARM_JOINTS],
            start_offsets: [0.0; ARM_JOINTS],
        };
        for (axis, parameter) in &self.parameters {
            values.set(*parameter, axis.nominal);
        }
        values
    }

    /// Returns the robot's elements.
    pub(crate) fn panda(&self) -> &Panda {
        &self.panda
    }

    /// Returns the elements of the model that axes modify.
    pub(crate) fn elements(&self) -> &Elements {
        &self.elements
    }

    /// Returns the functions that map a view of a state to targets, samples and rewards.
    pub(crate) fn functions(&self) -> SceneFunctions {
        let TaskEnvironment { definition, model, panda, scene, reward, manner_reward, further, .. } = self;
        SceneFunctions {
            definition,
            model: model.clone(),
            panda: *panda,
            scene: scene.clone(),
            reward: *reward,
            manner: self.manner().cloned(),
            manner_reward: *manner_reward,
            measured_size: self.observation_size() - self.exact_size(),
            further: further.clone(),
        }
    }

    /// Returns the number of physics steps per control step.
    pub(crate) fn substeps(&self) -> usize {
        (CONTROL_DT / self.model.timestep()).round() as usize
    }

    /// Makes a worker that steps this number of rows in turn, for one thread.
    pub(crate) fn task_worker(&self, rows: usize) -> TaskWorker {
        TaskWorker {
            functions: self.functions(),
            n_substeps: self.substeps(),
            start_offset: self.start_offset,
            space_parameters: self.space_parameters.clone(),
            elements: self.elements.clone(),
            row_world: self.row_world(rows),
            values: self.nominal(),
            recorder: self.manner().map(|manner| ProbeRecorder::new(manner.probe().clone(), &self.model)),
            observation: vec![0.0; self.observation_size()],
        }
    }

    /// Makes the world of a worker that steps this number of rows in turn.
    pub(crate) fn row_world(&self, rows: usize) -> RowWorld {
        RowWorld::new(&self.model, self.nominal().constants, self.tail_size(), rows)
    }

    /// Returns the parameter of each axis of the space.
    pub(crate) fn space_parameters(&self) -> &[Parameter] {
        &self.space_parameters
    }

    /// Returns the number of parameters in a state row: 0 if no axis of the space affects steps
    /// after the reset.
    pub(crate) fn tail_size(&self) -> usize {
        let affects_steps = |parameter: &Parameter| {
            use Parameter as P;
            !matches!(parameter, P::Start(_) | P::StartDraw(_) | P::StartOffset(_) | P::ThrowSpeed | P::Sight)
        };
        if self.space_parameters.iter().any(affects_steps) { self.nominal().tail().len() } else { 0 }
    }
}

/// Returns the document with a compiler option that removes visual geoms.
fn without_visuals(xml: &str) -> String {
    xml.replacen("</mujoco>", "<compiler discardvisual=\"true\"/>\n</mujoco>", 1)
}

impl Environment for TaskEnvironment {
    fn facts(&self) -> &EnvironmentFacts {
        &self.facts
    }

    fn eyes(&self, images: &[Image]) -> Result<Arc<dyn Eyes>, RolloutError> {
        Ok(Arc::new(eyes(self.definition, self.space(), images)?))
    }

    fn worker(&self) -> Box<dyn EnvironmentWorker> {
        self.worker_of(1)
    }

    fn worker_of(&self, rows: usize) -> Box<dyn EnvironmentWorker> {
        Box::new(self.task_worker(rows))
    }
}

/// Values of all parameters of the scene.
#[derive(Clone, Debug)]
struct ParameterValues {
    start: Vec<f64>,
    constants: Vec<(Constant, f64)>,
    push: [f64; PUSH_SIZE],
    jump: [f64; JUMP_SIZE],
    slip: [f64; SLIP_SIZE],
    throw_speed: f64,
    start_draws: [Option<f64>; ARM_JOINTS],
    start_offsets: [f64; ARM_JOINTS],
}

impl ParameterValues {
    fn set(&mut self, parameter: Parameter, value: Option<f64>) {
        // The space has checked that only a draw is `None`.
        let number = value.unwrap_or(0.0);
        match parameter {
            Parameter::Start(index) => self.start[index] = number,
            Parameter::Constant(constant) => {
                match self.constants.iter_mut().find(|(known, _)| *known == constant) {
                    Some((_, value)) => *value = number,
                    None => self.constants.push((constant, number)),
                }
            }
            Parameter::Push(index) => self.push[index] = number,
            Parameter::Jump(index) => self.jump[index] = number,
            Parameter::Slip(index) => self.slip[index] = number,
            Parameter::ThrowSpeed => self.throw_speed = number,
            Parameter::Sight => {}
            Parameter::StartOffset(joint) => self.start_offsets[joint] = number,
            Parameter::StartDraw(joint) => self.start_draws[joint] = value,
        }
    }

    /// Returns the values of the constants.
    fn constant_values(&self) -> Vec<f64> {
        self.constants.iter().map(|(_, value)| *value).collect()
    }

    /// Returns the tail of a state row, which follows physics and joint targets: control step 0,
    /// constants, push, jump, slip.
    fn tail(&self) -> Vec<f64> {
        [&[0.0], self.constant_values().as_slice(), &self.push, &self.jump, &self.slip].concat()
    }
}

/// The functions of a task that map a view of a state to targets, samples and rewards. Every engine
/// uses them.
#[derive(Clone)]
pub(crate) struct SceneFunctions {
    definition: &'static Definition,
    model: Model,
    panda: Panda,
    scene: Arc<dyn Scene>,
    reward: Reward,
    manner: Option<Manner>,
    manner_reward: MannerReward,
    /// Length of the observation before its further parts.
    measured_size: usize,
    further: FurtherParts,
}

/// A control step that has ended.
pub(crate) struct FinishedStep<'a> {
    pub readings: Option<&'a Readings>,
    pub action: &'a [f64],
    /// Targets of the joints during the step.
    pub targets: &'a [f64],
}

/// The parts of the memory of an episode.
struct MemoryParts<'a> {
    of_signals: &'a mut [f64],
    of_rewards: &'a mut [f64],
    /// Number of control steps since the start, if a further part of the observation needs it.
    steps: &'a mut [f64],
}

impl SceneFunctions {
    /// Returns whether [`move_fingers`](Self::move_fingers) reads the state.
    pub(crate) fn reads_state_to_grip(&self) -> bool {
        matches!(self.definition.grip, GripperMode::Scene(_))
    }

    /// Moves the targets of the joints by an action. Returns whether the gripper releases the held
    /// object.
    pub(crate) fn move_targets(&self, rows: &Rows<'_>, action: &[f64], targets: &mut [f64]) -> bool {
        self.panda.move_targets(action, targets);
        self.move_fingers(rows, action, &mut targets[ARM_JOINTS..])
    }

    /// Sets the targets of the fingers. Returns whether the gripper releases the held object.
    fn move_fingers(&self, rows: &Rows<'_>, action: &[f64], fingers: &mut [f64]) -> bool {
        match self.definition.grip {
            GripperMode::Fixed(opening) => {
                fingers.fill(opening);
                false
            }
            GripperMode::Scene(_) => {
                let releases = self.scene.grip(rows, action, fingers);
                self.panda.limit_fingers(fingers);
                releases
            }
        }
    }

    /// Writes the task's signals and the observation of a state.
    fn write_sample(&self, rows: &Rows<'_>, known: Known<'_>, buffer: &mut [f64], sample: &mut Sample<'_>) {
        self.scene.signals(rows, &mut sample.signals[..self.definition.signals.len()]);
        let (measured, further) = buffer.split_at_mut(self.measured_size);
        self.panda.observe(rows, self.definition.velocity_scale, &mut measured[..2 * JOINTS]);
        self.scene.observe(rows, &mut measured[2 * JOINTS..]);
        self.further.write(&self.model, &self.panda, rows, known, further);
        for (clipped, value) in sample.observation.iter_mut().zip(buffer) {
            *clipped = value.clamp(-OBSERVATION_LIMIT, OBSERVATION_LIMIT) as f32;
        }
    }

    /// Splits the memory of an episode into its parts.
    fn split_memory<'a>(&self, memory: &'a mut [f64]) -> MemoryParts<'a> {
        let (of_signals, memory) = memory.split_at_mut(self.manner.as_ref().map_or(0, |_| MEMORY));
        let (of_rewards, steps) = memory.split_at_mut(self.manner_reward.memory_size());
        MemoryParts { of_signals, of_rewards, steps }
    }

    /// Writes the sample after a control step, with rewards if there is space for them, and returns
    /// its status. `memory` is that of the episode.
    pub(crate) fn write_step(
        &self,
        rows: &Rows<'_>,
        step: &FinishedStep<'_>,
        memory: &mut [f64],
        buffer: &mut [f64],
        mut sample: Sample<'_>,
    ) -> StepStatus {
        let FinishedStep { readings, action, targets } = *step;
        let MemoryParts { of_signals, of_rewards, steps } = self.split_memory(memory);
        steps.iter_mut().for_each(|steps| *steps += 1.0);
        let known = Known { targets, steps: steps.first().copied().unwrap_or_default() };
        self.write_sample(rows, known, buffer, &mut sample);
        if let (Some(manner), Some(readings)) = (&self.manner, readings) {
            let signals = &mut sample.signals[self.definition.signals.len()..];
            manner.finish(rows, readings, action, of_signals, signals);
        }
        if !sample.rewards.is_empty() {
            let (own, manner) = sample.rewards.split_at_mut(self.definition.reward(self.reward).len());
            self.scene.reward(self.reward, rows, sample.signals, action, own);
            let signals = &sample.signals[self.definition.signals.len()..];
            self.manner_reward.write(rows, &self.panda, signals, action, of_rewards, manner);
        }
        if self.scene.is_terminal(rows, sample.signals) {
            StepStatus::Terminated
        } else {
            StepStatus::Running
        }
    }
}

pub(crate) struct TaskWorker {
    functions: SceneFunctions,
    n_substeps: usize,
    start_offset: f64,
    space_parameters: Arc<[Parameter]>,
    elements: Elements,
    row_world: RowWorld,
    /// Parameters without an axis in the space keep their nominal values. Each reset overwrites the
    /// others.
    values: ParameterValues,
    recorder: Option<ProbeRecorder>,
    observation: Vec<f64>,
}

impl TaskWorker {
    /// Returns the world of the last [reset](EnvironmentWorker::reset) or
    /// [`set_state`](Self::set_state). Its poses are those of the new state.
    pub(crate) fn world(&self) -> &World {
        self.row_world.world()
    }

    /// Loads a state row into the world with its constants.
    pub(crate) fn set_state(&mut self, state: &[f64]) {
        let world = self.row_world.of_row(state, &self.elements);
        world.set_state(state);
        world.refresh();
    }

    /// Returns the values of fields of the model of a state row with this tail.
    pub(crate) fn read_fields(&mut self, tail: &[f64], fields: &[ModelField]) -> Vec<f64> {
        let mut values = Vec::new();
        self.row_world.model(tail, &self.elements).read_fields(fields, &mut values);
        values
    }

    /// Recomputes the poses of an output row of a batch for these poses of the mocap bodies.
    pub(crate) fn refresh_output(
        &mut self,
        tail: &[f64],
        layout: &BatchLayout,
        mocap: &[f64],
        output: &mut [f64],
    ) {
        let world = self.row_world.of_tail(tail, &self.elements);
        let (qpos, qvel) = layout.state(output);
        world.qpos_mut().copy_from_slice(qpos);
        world.qvel_mut().copy_from_slice(qvel);
        world.place_all(mocap);
        world.refresh();
        layout.write(world, output);
    }

    /// Applies the jump of this control step and returns the push.
    fn start_events(&mut self, tail: &[f64]) -> Option<Push> {
        let events = self.row_world.events(tail)?;
        let (push, events) = events.split_at(PUSH_SIZE);
        let offset = axes::jump(&events[..JUMP_SIZE], tail[0] as usize);
        if let (Some(mocap), Some(offset)) = (self.elements.jump, offset) {
            self.row_world.world_mut().shift(mocap, offset);
        }
        Push::new(push)
    }

    /// Writes the signals and the observation of the initial state with these targets.
    fn write_start(&mut self, targets: &[f64], sample: &mut Sample<'_>) {
        let world = self.row_world.world_mut();
        world.refresh();
        let known = Known { targets, steps: 0.0 };
        self.functions.write_sample(&world.rows(), known, &mut self.observation, sample);
    }
}

impl EnvironmentWorker for TaskWorker {
    fn reset(
        &mut self,
        scenario: &Scenario,
        seed: Seed,
        state: &mut [f64],
        mut sample: Sample<'_>,
    ) -> StepStatus {
        for (parameter, value) in self.space_parameters.iter().zip(scenario.values()) {
            self.values.set(*parameter, *value);
        }
        let SceneFunctions { definition, panda, .. } = &self.functions;
        let (definition, panda) = (*definition, *panda);
        let mut start = definition.start;
        for (i, (q, joint)) in start[..ARM_JOINTS].iter_mut().zip(panda.joints()).enumerate() {
            let drawn = || 2.0 * seed.uniform(Stream::Reset, 0, i as u32) - 1.0;
            let offset = self.values.start_draws[i].unwrap_or_else(drawn);
            let offset = definition.start_noise * offset + self.values.start_offsets[i];
            *q = (*q + offset).clamp(joint.low, joint.high);
        }
        let (physics, targets, tail, memory) = self.row_world.split(state);
        if !tail.is_empty() {
            tail.copy_from_slice(&self.values.tail());
        }
        let world = self.row_world.of_tail(tail, &self.elements);
        world.reset();
        panda.place(&start, world);
        self.functions.scene.place(&self.values.start, world);
        if self.values.start_offsets != [0.0; ARM_JOINTS] {
            self.elements.move_start(&panda, &definition.start, &start, world);
        }
        if let Some(thrown) = self.elements.thrown {
            world.qvel_mut()[thrown.dof..][..3].iter_mut().for_each(|v| *v *= self.values.throw_speed);
        }
        if self.start_offset != 0.0 {
            world.move_joints(self.start_offset);
        }
        self.write_start(&start, &mut sample);
        sample.rewards.fill(0.0);
        let world = self.row_world.world();
        let MemoryParts { of_signals, of_rewards, steps } = self.functions.split_memory(memory);
        of_rewards.fill(0.0);
        steps.fill(0.0);
        if let Some(manner) = &self.functions.manner {
            manner.start(&world.rows(), of_signals, &mut sample.signals[definition.signals.len()..]);
        }
        world.read_state(physics);
        targets.copy_from_slice(&start);
        StepStatus::Running
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], sample: Sample<'_>) -> StepStatus {
        let (physics, targets, tail, memory) = self.row_world.split(state);
        self.row_world.of_tail(tail, &self.elements).set_state(physics);
        let push = self.start_events(tail);
        let world = self.row_world.world_mut();
        if self.functions.reads_state_to_grip() {
            // The derived poses may belong to another row.
            world.refresh();
        }
        if self.functions.move_targets(&world.rows(), action, targets) {
            world.switch_all(false);
        }
        self.recorder.iter_mut().for_each(ProbeRecorder::clear);
        for substep in 0..self.n_substeps {
            if let Some(push) = &push {
                let force = push.substep_force(tail[0], substep, world.model().timestep());
                self.elements.push.iter().for_each(|body| world.push(*body, force));
            }
            match &mut self.recorder {
                Some(recorder) => recorder.step(&self.functions.panda.servos(), targets, world),
                None => self.functions.panda.step(targets, world),
            }
        }
        if world.take_divergence() {
            return StepStatus::Diverged;
        }
        world.read_state(physics);
        if let Some(step) = tail.first_mut() {
            *step += 1.0;
        }
        world.refresh();
        let rows = world.rows();
        let readings = self.recorder.as_ref().map(ProbeRecorder::readings);
        let step = FinishedStep { readings, action, targets };
        self.functions.write_step(&rows, &step, memory, &mut self.observation, sample)
    }
}
