use mishandle_controllers::{Entry, Layout};
use mishandle_rollout::{Axis, NamedFormula, RolloutError, Space, Specification};
use mishandle_world::{Model, Rows, World, WorldError};

use crate::robot::{ARM_JOINTS, JOINTS, Panda};

/// A task preset, which reading of the original benchmark counts: changes formulas, metrics and box, nothing else.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Preset {
    /// What the paper prints, where it can be met and agrees with the paper's own results.
    #[default]
    Paper,
    /// What the paper's code does.
    Code,
}

/// Which reward a training run learns from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reward {
    /// The original's, with its slips mended.
    Original,
    /// Ours, shaped to lead to the strict formula.
    Shaped,
}

/// A named number that a task shows: a signal, an entry of the observation, a term of the reward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantity {
    /// Name.
    pub name: &'static str,
    /// Unit, empty for plain numbers.
    pub unit: &'static str,
    /// How many numbers it is.
    pub size: usize,
    /// What it is, or its formula.
    pub meaning: &'static str,
}

/// A quantity of one number.
pub const fn one(name: &'static str, unit: &'static str, meaning: &'static str) -> Quantity {
    Quantity { name, unit, size: 1, meaning }
}

/// A quantity of three numbers.
pub const fn three(name: &'static str, unit: &'static str, meaning: &'static str) -> Quantity {
    Quantity { name, unit, size: 3, meaning }
}

/// The four formulas of a task, over its signals; bare interval bounds count control steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TaskFormulas {
    /// φ: the task was done.
    pub success: &'static str,
    /// φ′: the task was done well. Ours, not the paper's.
    pub strict: &'static str,
    /// δ: the behavior is not dangerous.
    pub safe: &'static str,
    /// κ: holds from the moment the task is completed.
    pub completion: &'static str,
}

impl TaskFormulas {
    /// The formulas with their names.
    pub fn named(&self) -> Vec<NamedFormula> {
        let texts = [
            ("success", self.success),
            ("strict", self.strict),
            ("safe", self.safe),
            ("completion", self.completion),
        ];
        texts.map(|(name, text)| NamedFormula { name: name.to_string(), text: text.to_string() }).to_vec()
    }

    /// The formulas, parsed.
    ///
    /// # Errors
    /// If one does not parse.
    pub fn specification(&self) -> Result<Specification, RolloutError> {
        Specification::parse(self.success, self.strict, self.safe, self.completion)
    }
}

/// One axis of an initial box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxAxis {
    /// Name.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Bounds under [`Preset::Paper`].
    pub paper: [f64; 2],
    /// Bounds under [`Preset::Code`].
    pub code: [f64; 2],
    /// What the axis sets in the scene.
    pub sets: &'static str,
}

impl BoxAxis {
    /// Lower and upper bound under a preset.
    pub fn bounds(&self, preset: Preset) -> [f64; 2] {
        match preset {
            Preset::Paper => self.paper,
            Preset::Code => self.code,
        }
    }
}

/// How the hand holds something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hold {
    /// For good: it is part of the hand's body.
    Fixed,
    /// By a weld to the hand, until the gripper lets go: it is a free body, its free joint and its weld carry its name.
    Weld,
}

/// Something the hand holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Held {
    /// Name of its body.
    pub name: &'static str,
    /// How it is held.
    pub hold: Hold,
    /// Its `<body>`, without name, pose and free joint.
    pub mjcf: &'static str,
    /// Where its frame is when the robot stands in its start pose, m.
    pub position: [f64; 3],
    /// Orientation there.
    pub quaternion: [f64; 4],
}

/// What may vary in a task's scene beside the initial box: each gives scenarios some axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Variations {
    /// Whether anything touches anything, so that friction matters.
    pub friction: bool,
    /// Names of bodies, or of a flex, whose mass matters.
    pub masses: &'static [&'static str],
    /// Name of a body, or of a flex, that may be pushed, and the largest force along each axis, N. Each vertex of a flex
    /// gets the whole force.
    pub push: Option<(&'static str, f64)>,
    /// Name of a mocap body that may jump.
    pub jump: Option<&'static str>,
}

impl Variations {
    /// Nothing beside the robot's own constants.
    pub const NONE: Variations = Variations { friction: false, masses: &[], push: None, jump: None };
}

/// Who moves the fingers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Grip {
    /// Nobody: they are held at this opening, m for each finger.
    Fixed(f64),
    /// The scene decides before each control step, by [`Scene::grip`]; this is its rule in words, and what the last two
    /// actions do.
    Scene(&'static str),
}

/// All that a task states as data, each fact once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Definition {
    /// Name on the command line.
    pub name: &'static str,
    /// One sentence for people.
    pub summary: &'static str,
    /// Of another version of a task of the benchmark, that task's name: it shares formulas, layout and controllers.
    pub variant_of: Option<&'static str>,
    /// What stands where, how large and how heavy it is, in words.
    pub setting: &'static str,
    /// What the hand holds at the start.
    pub held: Option<Held>,
    /// Start of the seven arm joints (rad) and the two fingers (m).
    pub start: [f64; 9],
    /// Largest random offset of each arm joint's start, rad. Its stream is keyed by the simulation's seed.
    pub start_noise: f64,
    /// Who moves the fingers.
    pub grip: Grip,
    /// Physics steps in a control step.
    pub n_substeps: usize,
    /// What joint velocities are multiplied with in the observation.
    pub velocity_scale: f64,
    /// Signals, in order; each is one number.
    pub signals: &'static [Quantity],
    /// What the controller sees after the 18 numbers of the robot's joints, in order.
    pub observation: &'static [Quantity],
    /// Terms of the original reward.
    pub original_reward: &'static [Quantity],
    /// Terms of the shaped reward.
    pub shaped_reward: &'static [Quantity],
    /// Axes of the initial box.
    pub initial_box: &'static [BoxAxis],
    /// What else may vary.
    pub variations: Variations,
    /// Formulas under [`Preset::Paper`].
    pub paper: TaskFormulas,
    /// Formulas under [`Preset::Code`].
    pub code: TaskFormulas,
    /// When a training episode ends early, in words.
    pub termination: &'static str,
    /// Where MuJoCo forced a difference from the original, and why it does not change what is tested.
    pub differences: &'static str,
}

impl Definition {
    /// The formulas of a preset.
    pub fn formulas(&self, preset: Preset) -> &TaskFormulas {
        match preset {
            Preset::Paper => &self.paper,
            Preset::Code => &self.code,
        }
    }

    /// The terms of a reward.
    pub fn reward(&self, reward: Reward) -> &'static [Quantity] {
        match reward {
            Reward::Original => self.original_reward,
            Reward::Shaped => self.shaped_reward,
        }
    }

    /// The parts of an observation: the robot's joints, then what the task adds.
    pub fn whole_observation(&self) -> Vec<Quantity> {
        let robot = [
            Quantity {
                name: "joint_positions",
                unit: "",
                size: JOINTS,
                meaning: "seven joints and two fingers, mapped from their limits to [-1, 1]",
            },
            Quantity {
                name: "joint_velocities",
                unit: "rad/s, m/s",
                size: JOINTS,
                meaning: "times the task's velocity scale",
            },
        ];
        robot.iter().chain(self.observation).copied().collect()
    }

    /// What a controller of this task takes and gives.
    pub fn layout(&self) -> Layout {
        let entry = |name: &str, unit: &str, size| Entry { name: name.into(), unit: unit.into(), size };
        Layout {
            observation: self.whole_observation().iter().map(|q| entry(q.name, q.unit, q.size)).collect(),
            action: vec![
                entry("arm_target_steps", "", ARM_JOINTS),
                entry("finger_target_steps", "", JOINTS - ARM_JOINTS),
            ],
        }
    }

    /// The initial box of a preset as a space.
    ///
    /// # Errors
    /// If the bounds of an axis are not in order.
    pub fn starts(&self, preset: Preset) -> Result<Space, RolloutError> {
        let axis = |axis: &BoxAxis| {
            let [low, high] = axis.bounds(preset);
            Axis::start(axis.name, axis.unit, low, high).meaning(axis.sets)
        };
        Space::new("starts", self.initial_box.iter().map(axis).collect())
    }
}

/// A manipulation task: its data, its scene bound to a compiled model, and an expert.
pub trait Task: Send + Sync {
    /// What the task states as data.
    fn definition(&self) -> &'static Definition;

    /// MJCF of what stands around the robot: children of `<mujoco>`.
    ///
    /// Its equality constraints, but those that keep the edges of a flex, are what the hand holds: all are switched
    /// off for good when the gripper lets go.
    fn scene(&self) -> std::borrow::Cow<'static, str>;

    /// Name of the file that [`scene`](Self::scene) comes from, for error messages.
    fn scene_file(&self) -> &'static str {
        "scene.xml"
    }

    /// Finds the scene's elements in the compiled model.
    ///
    /// # Errors
    /// If one is missing.
    fn bind(&self, model: &Model, panda: &Panda) -> Result<Box<dyn Scene>, WorldError>;

    /// Whether the task can be done at all from an initial configuration of its box.
    ///
    /// It can unless a task proves otherwise, from kinematics or from the time there is: failures of a controller, of
    /// the expert too, are no proof.
    fn reachable(&self, _x0: &[f64]) -> bool {
        true
    }

    /// A controller that meets the formula by model and feedback, from what a controller may see.
    ///
    /// # Errors
    /// If the robot's model does not compile.
    fn expert(&self) -> Result<std::sync::Arc<dyn mishandle_rollout::Controller>, WorldError>;
}

/// A task's scene in a compiled model. All functions are pure: they read rows and write numbers.
pub trait Scene: Send + Sync {
    /// Puts the scene where `x0` says; the robot is placed already.
    fn place(&self, x0: &[f64], world: &mut World);

    /// Under [`Grip::Scene`]: sets the fingers' targets (m, clamped to their stroke afterwards) for the coming control
    /// step, from the state before it, and says whether the gripper lets go of what it holds.
    ///
    /// `fingers` comes with the targets of the step before; the action is not clipped.
    fn grip(&self, _rows: &Rows<'_>, _action: &[f64], _fingers: &mut [f64]) -> bool {
        false
    }

    /// Writes the signals.
    fn signals(&self, rows: &Rows<'_>, out: &mut [f64]);

    /// Writes the task's part of the observation.
    fn observe(&self, rows: &Rows<'_>, out: &mut [f64]);

    /// Writes the terms of a reward, from the scene after the step and the action (not clipped) that led to it.
    fn reward(&self, reward: Reward, rows: &Rows<'_>, signals: &[f64], action: &[f64], out: &mut [f64]);

    /// Whether a training episode may end here because the task is lost.
    fn lost(&self, rows: &Rows<'_>, signals: &[f64]) -> bool;
}
