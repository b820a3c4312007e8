use std::sync::Arc;

use mishandle_rollout::{
    Axis, Environment, EnvironmentWorker, RolloutError, Sample, Scenario, Seed, Space, StepStatus, Stream,
};
use mishandle_world::{Change, Model, World, WorldError};

use crate::axes::{self, Constant, Elements, JUMP_NUMBERS, PUSH_NUMBERS, Push, Setting};
use crate::check::{check_definition, check_scene, check_substeps, compile};
use crate::definition::{Definition, Grip, Preset, Reward, Scene, Task};
use crate::document::compose;
use crate::robot::{ARM_JOINTS, CONTROL_DT, EPISODE_STEPS, JOINTS, Panda};

/// Observations are clipped to this.
const OBSERVATION_LIMIT: f64 = 5.0;

/// What can be wrong when a task becomes an environment.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TaskError {
    /// The scene does not compile, or an element is missing.
    #[error("task {task}")]
    Scene {
        /// Name of the task.
        task: &'static str,
        /// What is wrong.
        source: WorldError,
    },
    /// A field of the task's definition is wrong, or a function of its scene does not fit it.
    #[error("task {task}, field `{field}`: {problem}")]
    Field {
        /// Name of the task.
        task: &'static str,
        /// The field of [`Definition`].
        field: &'static str,
        /// What is wrong.
        problem: String,
    },
    /// The box or a formula is wrong.
    #[error("task {task}")]
    Data {
        /// Name of the task.
        task: &'static str,
        /// What is wrong.
        source: RolloutError,
    },
}

/// Worlds with changed constants that one worker keeps: as many as rows are stepped in lockstep.
const CHANGED_WORLDS: usize = 16;

/// A task as an environment: robot, scene, and the clock of control and physics steps.
///
/// A state row is MuJoCo's state, then the nine joint targets. Where the space has axes of the model or of events, the
/// control step and the values of these axes follow: all that the future depends on. Random numbers are drawn at the
/// reset alone, so a row needs no counters.
#[derive(Clone)]
pub struct TaskEnvironment {
    definition: &'static Definition,
    model: Model,
    panda: Panda,
    scene: Arc<dyn Scene>,
    reward: Reward,
    /// Every axis there is, start axes first.
    settings: Vec<(Axis, Setting)>,
    space: Space,
    /// What each axis of the space sets.
    sets: Arc<[Setting]>,
    elements: Elements,
    signals: Arc<[String]>,
    reward_terms: Vec<String>,
}

impl TaskEnvironment {
    /// Builds `task` under a preset, with a reward to learn from. Its space is the initial box.
    ///
    /// # Errors
    /// If the scene does not compile or the task's data do not fit each other.
    pub fn new(task: &dyn Task, preset: Preset, reward: Reward) -> Result<TaskEnvironment, TaskError> {
        let definition = task.definition();
        Self::with_substeps(task, preset, reward, definition.n_substeps)
    }

    /// As [`new`](Self::new), with another number of physics steps in a control step: to check that outcomes do not
    /// depend on it.
    ///
    /// # Errors
    /// As [`new`](Self::new).
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
        let environment = TaskEnvironment {
            definition,
            elements: Elements::new(definition, &model, panda).map_err(scene_error)?,
            model,
            panda,
            scene: scene.into(),
            reward,
            settings: axes::settings(definition, preset).map_err(data_error)?,
            space: definition.starts(preset).map_err(data_error)?,
            sets: (0..definition.initial_box.len()).map(Setting::Start).collect(),
            signals: definition.signals.iter().map(|signal| signal.name.to_string()).collect(),
            reward_terms: definition.reward(reward).iter().map(|term| term.name.to_string()).collect(),
        };
        Ok(environment)
    }

    /// The same with another space, whose axes are among those of the task. Axes that are not in the space keep their
    /// nominal values.
    ///
    /// # Errors
    /// If an axis is unknown.
    pub fn with_space(&self, space: Space) -> Result<TaskEnvironment, TaskError> {
        let find = |axis: &Axis| self.settings.iter().find(|(known, _)| known.name == axis.name);
        let unknown = |axis: &Axis| TaskError::Data {
            task: self.definition.name,
            source: RolloutError::Axis { axis: axis.name.clone(), what: "the task has no such axis" },
        };
        let set = |axis: &Axis| find(axis).map(|(_, set)| *set).ok_or_else(|| unknown(axis));
        let sets = space.axes().iter().map(set).collect::<Result<_, _>>()?;
        Ok(TaskEnvironment { sets, space, ..self.clone() })
    }

    /// The compiled model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// What the task states as data.
    pub fn definition(&self) -> &'static Definition {
        self.definition
    }

    /// Every axis of the task's scene, start axes first, and what it sets.
    pub(crate) fn settings(&self) -> &[(Axis, Setting)] {
        &self.settings
    }

    /// The values of an undisturbed episode.
    fn nominal(&self) -> Conditions {
        let mut conditions = Conditions {
            start: vec![0.0; self.definition.initial_box.len()],
            constants: Vec::new(),
            push: [0.0; PUSH_NUMBERS],
            jump: [0.0; JUMP_NUMBERS],
            start_draws: [None; ARM_JOINTS],
        };
        for (axis, setting) in &self.settings {
            conditions.set(*setting, axis.nominal);
        }
        conditions
    }

    /// Whether any axis of the space needs more than a reset.
    fn has_tail(&self) -> bool {
        self.sets.iter().any(|set| matches!(set, Setting::Constant(_) | Setting::Push(_) | Setting::Jump(_)))
    }
}

/// The document, told to drop shapes that only pictures need.
fn without_visuals(xml: &str) -> String {
    xml.replacen("</mujoco>", "<compiler discardvisual=\"true\"/>\n</mujoco>", 1)
}

impl Environment for TaskEnvironment {
    fn name(&self) -> &str {
        self.definition.name
    }

    fn space(&self) -> &Space {
        &self.space
    }

    fn signals(&self) -> &Arc<[String]> {
        &self.signals
    }

    fn reward_terms(&self) -> &[String] {
        &self.reward_terms
    }

    fn observation_size(&self) -> usize {
        self.definition.layout().observation_size()
    }

    fn action_size(&self) -> usize {
        JOINTS
    }

    fn state_size(&self) -> usize {
        let tail = if self.has_tail() { self.nominal().tail().len() } else { 0 };
        self.model.state_size() + JOINTS + tail
    }

    fn control_dt(&self) -> f64 {
        CONTROL_DT
    }

    fn episode_steps(&self) -> usize {
        EPISODE_STEPS
    }

    fn worker(&self) -> Box<dyn EnvironmentWorker> {
        let nominal = self.nominal();
        Box::new(TaskWorker {
            definition: self.definition,
            panda: self.panda,
            scene: self.scene.clone(),
            reward: self.reward,
            n_substeps: (CONTROL_DT / self.model.timestep()).round() as usize,
            sets: self.sets.clone(),
            elements: self.elements.clone(),
            worlds: Worlds {
                nominal: nominal.constants.clone(),
                worlds: vec![(nominal.values(), self.model.world())],
                next: 1,
            },
            conditions: nominal,
            observation: vec![0.0; self.observation_size()],
        })
    }
}

/// What a scenario sets, axis by axis.
#[derive(Clone, Debug)]
struct Conditions {
    start: Vec<f64>,
    constants: Vec<(Constant, f64)>,
    push: [f64; PUSH_NUMBERS],
    jump: [f64; JUMP_NUMBERS],
    start_draws: [Option<f64>; ARM_JOINTS],
}

impl Conditions {
    fn set(&mut self, setting: Setting, value: Option<f64>) {
        // Only a draw may be absent, as the space has checked.
        let number = value.unwrap_or(0.0);
        match setting {
            Setting::Start(index) => self.start[index] = number,
            Setting::Constant(constant) => {
                match self.constants.iter_mut().find(|(known, _)| *known == constant) {
                    Some((_, value)) => *value = number,
                    None => self.constants.push((constant, number)),
                }
            }
            Setting::Push(index) => self.push[index] = number,
            Setting::Jump(index) => self.jump[index] = number,
            Setting::StartDraw(joint) => self.start_draws[joint] = value,
        }
    }

    /// The values of the constants, in their order.
    fn values(&self) -> Vec<f64> {
        self.constants.iter().map(|(_, value)| *value).collect()
    }

    /// What a state row holds beside physics and joint targets: control step 0, constants, push, jump.
    fn tail(&self) -> Vec<f64> {
        [&[0.0], self.values().as_slice(), &self.push, &self.jump].concat()
    }
}

/// The worlds of one worker: that of the model as it is, and those of the changed models that were needed last. A row's
/// constants choose its world, so that rows with different constants can be stepped in turns.
struct Worlds {
    nominal: Vec<(Constant, f64)>,
    /// Values of the constants, in the order of `nominal`, and a world of the model that has them; the nominal one first.
    worlds: Vec<(Vec<f64>, World)>,
    /// Which is given up next.
    next: usize,
}

impl Worlds {
    /// The place of the world with these constants, which is made if it is not there.
    fn find(&mut self, values: &[f64], elements: &Elements) -> usize {
        if let Some(place) = self.worlds.iter().position(|(known, _)| known == values) {
            return place;
        }
        let changed = self.nominal.iter().zip(values).filter(|((_, nominal), value)| nominal != *value);
        let changes: Vec<Change> =
            changed.map(|((constant, _), value)| elements.change(*constant, *value)).collect();
        let made = (values.to_vec(), self.worlds[0].1.model().changed(&changes).world());
        if self.worlds.len() <= CHANGED_WORLDS {
            self.worlds.push(made);
            return self.worlds.len() - 1;
        }
        let place = self.next;
        self.next = place % CHANGED_WORLDS + 1;
        self.worlds[place] = made;
        place
    }
}

struct TaskWorker {
    definition: &'static Definition,
    panda: Panda,
    scene: Arc<dyn Scene>,
    reward: Reward,
    n_substeps: usize,
    sets: Arc<[Setting]>,
    elements: Elements,
    worlds: Worlds,
    /// Nominal where the space has no axis; the rest is overwritten by each reset.
    conditions: Conditions,
    observation: Vec<f64>,
}

impl TaskWorker {
    /// The place of the world in which a row with this tail is stepped.
    fn place(&mut self, tail: &[f64]) -> usize {
        if tail.is_empty() {
            return 0;
        }
        self.worlds.find(&tail[1..][..self.worlds.nominal.len()], &self.elements)
    }

    /// Sets the fingers' targets, and lets go of what the hand holds when the scene says so.
    fn move_fingers(&mut self, place: usize, action: &[f64], fingers: &mut [f64]) {
        match self.definition.grip {
            Grip::Fixed(opening) => fingers.fill(opening),
            Grip::Scene(_) => {
                let world = &mut self.worlds.worlds[place].1;
                // The poses left behind may be those of another row.
                world.refresh();
                if self.scene.grip(&world.rows(), action, fingers) {
                    world.switch_all(false);
                }
                self.panda.limit_fingers(fingers);
            }
        }
    }

    /// Lets what is to jump in this control step jump, and says what pushes.
    fn begin_events(&mut self, place: usize, tail: &[f64]) -> Option<Push> {
        let events = tail.get(1 + self.worlds.nominal.len()..)?;
        let (push, numbers) = events.split_at(PUSH_NUMBERS);
        let due = axes::jump(numbers, tail[0] as usize);
        if let (Some(mocap), Some(offset)) = (self.elements.jump, due) {
            self.worlds.worlds[place].1.shift(mocap, offset);
        }
        Push::new(push)
    }

    /// Writes signals and observation of the present state.
    fn show(&mut self, place: usize, sample: &mut Sample<'_>) {
        let world = &mut self.worlds.worlds[place].1;
        world.refresh();
        let rows = world.rows();
        self.scene.signals(&rows, sample.signals);
        self.panda.observe(&rows, self.definition.velocity_scale, &mut self.observation[..2 * JOINTS]);
        self.scene.observe(&rows, &mut self.observation[2 * JOINTS..]);
        for (seen, value) in sample.observation.iter_mut().zip(&self.observation) {
            *seen = value.clamp(-OBSERVATION_LIMIT, OBSERVATION_LIMIT) as f32;
        }
    }
}

impl EnvironmentWorker for TaskWorker {
    fn reset(&mut self, scenario: &Scenario, seed: Seed, state: &mut [f64], mut sample: Sample<'_>) {
        for (setting, value) in self.sets.iter().zip(scenario.values()) {
            self.conditions.set(*setting, *value);
        }
        let mut start = self.definition.start;
        for (i, (q, joint)) in start[..ARM_JOINTS].iter_mut().zip(self.panda.joints()).enumerate() {
            let drawn = || 2.0 * seed.uniform(Stream::Reset, 0, i as u32) - 1.0;
            let offset = self.conditions.start_draws[i].unwrap_or_else(drawn);
            *q = (*q + self.definition.start_noise * offset).clamp(joint.low, joint.high);
        }
        let (physics, rest) = state.split_at_mut(self.worlds.worlds[0].1.model().state_size());
        let (targets, tail) = rest.split_at_mut(JOINTS);
        if !tail.is_empty() {
            tail.copy_from_slice(&self.conditions.tail());
        }
        let place = self.place(tail);
        let world = &mut self.worlds.worlds[place].1;
        world.reset();
        self.panda.place(&start, world);
        self.scene.place(&self.conditions.start, world);
        self.show(place, &mut sample);
        sample.rewards.fill(0.0);
        self.worlds.worlds[place].1.read_state(physics);
        targets.copy_from_slice(&start);
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], mut sample: Sample<'_>) -> StepStatus {
        let (physics, rest) = state.split_at_mut(self.worlds.worlds[0].1.model().state_size());
        let (targets, tail) = rest.split_at_mut(JOINTS);
        let place = self.place(tail);
        self.worlds.worlds[place].1.set_state(physics);
        self.panda.move_targets(action, targets);
        let push = self.begin_events(place, tail);
        self.move_fingers(place, action, &mut targets[ARM_JOINTS..]);
        let world = &mut self.worlds.worlds[place].1;
        for substep in 0..self.n_substeps {
            if let Some(push) = &push {
                let step = world.model().timestep();
                let time = tail[0] * CONTROL_DT + substep as f64 * step;
                let force = push.force(time, step);
                self.elements.push.iter().for_each(|body| world.push(*body, force));
            }
            self.panda.set_servos(targets, world);
            world.step();
        }
        if world.take_divergence() {
            return StepStatus::Diverged;
        }
        world.read_state(physics);
        if let Some(step) = tail.first_mut() {
            *step += 1.0;
        }
        self.show(place, &mut sample);
        let rows = self.worlds.worlds[place].1.rows();
        self.scene.reward(self.reward, &rows, sample.signals, action, sample.rewards);
        match self.scene.lost(&rows, sample.signals) {
            true => StepStatus::Terminated,
            false => StepStatus::Running,
        }
    }
}
