use std::sync::Arc;

use mishandle_rollout::{Environment, InitialBox, RolloutError, Sample, Seed, Status, Stream, Worker};
use mishandle_world::{Model, World, WorldError};

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
    /// The box or a formula is wrong.
    #[error("task {task}")]
    Data {
        /// Name of the task.
        task: &'static str,
        /// What is wrong.
        source: RolloutError,
    },
}

/// A task as an environment: robot, scene, and the clock of control and physics steps.
///
/// A state row is MuJoCo's state, then the nine joint targets. Random numbers are drawn at the reset alone, so a row
/// needs no counters.
pub struct TaskEnvironment {
    definition: &'static Definition,
    model: Model,
    panda: Panda,
    scene: Arc<dyn Scene>,
    reward: Reward,
    initial_box: InitialBox,
    signals: Arc<[String]>,
    reward_terms: Vec<String>,
}

impl TaskEnvironment {
    /// Builds `task` under a preset, with a reward to learn from.
    ///
    /// # Errors
    /// If the scene does not compile or the task's data do not fit each other.
    pub fn new(task: &dyn Task, preset: Preset, reward: Reward) -> Result<TaskEnvironment, TaskError> {
        let definition = task.definition();
        Self::with_substeps(task, preset, reward, definition.n_substeps)
    }

    /// As [`new`](Self::new), with another number of physics steps in a control step: to check that outcomes do not
    /// hang on it.
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
        let scene_error = |source| TaskError::Scene { task: definition.name, source };
        let model = compose(task)
            .and_then(|xml| Model::from_xml(&without_visuals(&xml)))
            .map_err(scene_error)?
            .with_timestep(CONTROL_DT / n_substeps as f64);
        let panda = Panda::new(&model).map_err(scene_error)?;
        let scene = task.bind(&model, &panda).map_err(scene_error)?;
        let initial_box = definition
            .initial_box(preset)
            .map_err(|source| TaskError::Data { task: definition.name, source })?;
        Ok(TaskEnvironment {
            definition,
            model,
            panda,
            scene: scene.into(),
            reward,
            initial_box,
            signals: definition.signals.iter().map(|signal| signal.name.to_string()).collect(),
            reward_terms: definition.reward(reward).iter().map(|term| term.name.to_string()).collect(),
        })
    }

    /// The compiled model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// What the task states as data.
    pub fn definition(&self) -> &'static Definition {
        self.definition
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

    fn initial_box(&self) -> &InitialBox {
        &self.initial_box
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
        self.model.state_size() + JOINTS
    }

    fn control_dt(&self) -> f64 {
        CONTROL_DT
    }

    fn episode_steps(&self) -> usize {
        EPISODE_STEPS
    }

    fn worker(&self) -> Box<dyn Worker> {
        Box::new(TaskWorker {
            definition: self.definition,
            panda: self.panda,
            scene: self.scene.clone(),
            reward: self.reward,
            n_substeps: (CONTROL_DT / self.model.timestep()).round() as usize,
            world: self.model.world(),
            observation: vec![0.0; self.observation_size()],
        })
    }
}

struct TaskWorker {
    definition: &'static Definition,
    panda: Panda,
    scene: Arc<dyn Scene>,
    reward: Reward,
    n_substeps: usize,
    world: World,
    observation: Vec<f64>,
}

impl TaskWorker {
    /// Sets the fingers' targets, and lets go of what the hand holds when the scene says so.
    fn move_fingers(&mut self, action: &[f64], fingers: &mut [f64]) {
        match self.definition.grip {
            Grip::Fixed(opening) => fingers.fill(opening),
            Grip::Scene(_) => {
                // The poses left behind may be those of another row.
                self.world.refresh();
                if self.scene.grip(&self.world.rows(), action, fingers) {
                    self.world.switch_all(false);
                }
                self.panda.limit_fingers(fingers);
            }
        }
    }

    /// Writes signals and observation of the present state.
    fn show(&mut self, sample: &mut Sample<'_>) {
        self.world.refresh();
        let rows = self.world.rows();
        self.scene.signals(&rows, sample.signals);
        self.panda.observe(&rows, self.definition.velocity_scale, &mut self.observation[..2 * JOINTS]);
        self.scene.observe(&rows, &mut self.observation[2 * JOINTS..]);
        for (seen, value) in sample.observation.iter_mut().zip(&self.observation) {
            *seen = value.clamp(-OBSERVATION_LIMIT, OBSERVATION_LIMIT) as f32;
        }
    }
}

impl Worker for TaskWorker {
    fn reset(&mut self, x0: &[f64], seed: Seed, state: &mut [f64], mut sample: Sample<'_>) {
        let mut start = self.definition.start;
        for (i, (q, joint)) in start[..ARM_JOINTS].iter_mut().zip(self.panda.joints()).enumerate() {
            let offset = 2.0 * seed.uniform(Stream::Reset, 0, i as u32) - 1.0;
            *q = (*q + self.definition.start_noise * offset).clamp(joint.low, joint.high);
        }
        self.world.reset();
        self.panda.place(&start, &mut self.world);
        self.scene.place(x0, &mut self.world);
        self.show(&mut sample);
        sample.rewards.fill(0.0);
        let (physics, targets) = state.split_at_mut(self.world.model().state_size());
        self.world.read_state(physics);
        targets.copy_from_slice(&start);
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], mut sample: Sample<'_>) -> Status {
        let (physics, targets) = state.split_at_mut(self.world.model().state_size());
        self.world.set_state(physics);
        self.panda.move_targets(action, targets);
        self.move_fingers(action, &mut targets[ARM_JOINTS..]);
        for _ in 0..self.n_substeps {
            self.panda.set_servos(targets, &mut self.world);
            self.world.step();
        }
        if self.world.take_divergence() {
            return Status::Diverged;
        }
        self.world.read_state(physics);
        self.show(&mut sample);
        let rows = self.world.rows();
        self.scene.reward(self.reward, &rows, sample.signals, action, sample.rewards);
        match self.scene.lost(&rows, sample.signals) {
            true => Status::Terminated,
            false => Status::Running,
        }
    }
}
