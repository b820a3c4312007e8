use mishandle_controllers::{Entry, Layout};
use mishandle_rollout::fault::FaultSite;
use mishandle_rollout::{Axis, NamedFormula, RolloutError, Space, Specification};
use mishandle_world::{Model, Rows, World, WorldError};

use crate::cameras::CameraPlace;
use crate::manner::CAREFUL;
use crate::robot::{ARM_JOINTS, JOINTS, Panda};

/// A task preset: one of two readings of the original benchmark. It determines formulas, metrics
/// and the initial box.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Preset {
    /// The values in the text of the paper, where they are feasible and agree with its results.
    #[default]
    Paper,
    /// The values in the code of the paper.
    Code,
}

/// Reward function of a training run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reward {
    /// The reward of the original benchmark with its bugs fixed.
    Original,
    /// The reward of this project, shaped towards the strict formula.
    Shaped,
}

/// A named quantity of a task: a signal, a part of the observation, or a reward term.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantity {
    /// Name.
    pub name: &'static str,
    /// Unit; empty for dimensionless numbers.
    pub unit: &'static str,
    /// Number of components.
    pub size: usize,
    /// Description, or formula of a reward term.
    pub meaning: &'static str,
}

/// Makes a quantity with one component.
pub const fn scalar(name: &'static str, unit: &'static str, meaning: &'static str) -> Quantity {
    Quantity { name, unit, size: 1, meaning }
}

/// Makes a quantity with three components.
pub const fn vector3(name: &'static str, unit: &'static str, meaning: &'static str) -> Quantity {
    Quantity { name, unit, size: 3, meaning }
}

/// The five formulas of a task over its signals. Interval bounds without a unit count control
/// steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TaskFormulas {
    /// φ, success: the task was done.
    pub success: &'static str,
    /// φ′, strict success: the task was done well. The paper has no such formula.
    pub strict: &'static str,
    /// Conditions of careful success besides strict success and [`CAREFUL`](crate::CAREFUL): see
    /// [`careful`](Self::careful). Only they may read the [signals of the manner](crate::MANNER),
    /// which cost time. `None`: the task has no such formula.
    pub careful: Option<&'static [&'static str]>,
    /// δ: the behavior is not dangerous.
    pub safe: &'static str,
    /// κ: the task is completed where it first holds.
    pub completion: &'static str,
}

impl TaskFormulas {
    /// Returns the formulas with their names.
    pub fn named(&self) -> Vec<NamedFormula> {
        let named = |name: &str, text: &str| NamedFormula { name: name.to_string(), text: text.to_string() };
        let mut formulas = vec![named("success", self.success), named("strict", self.strict)];
        formulas.extend(self.careful().map(|text| named("careful", &text)));
        formulas.extend([named("safe", self.safe), named("completion", self.completion)]);
        formulas
    }

    /// Returns the formula of careful success: the task was done well, and in a manner that an
    /// operator of the robot would accept.
    pub fn careful(&self) -> Option<String> {
        let conditions = [self.strict, CAREFUL].into_iter().chain(self.careful?.iter().copied());
        // Any of them may be a disjunction.
        Some(conditions.map(|condition| format!("({condition})")).collect::<Vec<_>>().join(" and "))
    }

    /// Parses the formulas, except `careful`. The requirement is `success`.
    ///
    /// # Errors
    /// If a formula does not parse, or `safe` contains a temporal operator.
    pub fn specification(&self) -> Result<Specification, RolloutError> {
        Specification::parse(self.success, self.strict, self.safe, self.completion)
    }
}

/// One axis of the initial box.
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
    /// Description of the quantity that the axis sets.
    pub meaning: &'static str,
}

impl BoxAxis {
    /// Returns the lower and the upper bound under a preset.
    pub fn bounds(&self, preset: Preset) -> [f64; 2] {
        match preset {
            Preset::Paper => self.paper,
            Preset::Code => self.code,
        }
    }
}

/// Attachment of an object to the hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attachment {
    /// Permanent: the object is a part of the hand's body.
    Fixed,
    /// By a weld until the gripper releases it. The object is a free body; its free joint and its
    /// weld have its name.
    Weld,
}

/// An object that the hand holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldObject {
    /// Name of the body.
    pub name: &'static str,
    /// Attachment to the hand.
    pub attachment: Attachment,
    /// MJCF `<body>` without name, pose and free joint.
    pub mjcf: &'static str,
    /// Position of the body frame in the world while the robot is in its initial pose, m.
    pub position: [f64; 3],
    /// Orientation of the body frame in that pose, w x y z.
    pub quaternion: [f64; 4],
}

/// Variations of a task's scene besides the initial box. Each one adds axes to the scenarios.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Variations {
    /// Whether the scene has contacts, so that friction may vary.
    pub friction: bool,
    /// Names of bodies, or of a flex, whose mass may vary.
    pub masses: &'static [&'static str],
    /// Name of a body, or of a flex, that may be pushed, and the maximum force along each axis, N.
    /// Each vertex of a flex receives the full force.
    pub push: Option<(&'static str, f64)>,
    /// Name of a mocap body that may jump.
    pub jump: Option<&'static str>,
    /// Names of bodies with primitive geoms whose size may vary.
    pub sizes: &'static [&'static str],
    /// Name of the free joint of an object that is thrown at the start, whose initial speed may
    /// vary.
    pub thrown: Option<&'static str>,
}

impl Variations {
    /// No variations except those of the robot.
    pub const NONE: Variations =
        Variations { friction: false, masses: &[], push: None, jump: None, sizes: &[], thrown: None };
}

/// Control of the gripper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GripperMode {
    /// The fingers stay at this position, m per finger.
    Fixed(f64),
    /// [`Scene::grip`] sets the targets of the fingers before each control step. The text describes
    /// this rule and the effect of the last two actions.
    Scene(&'static str),
}

/// The definition of a task as data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Definition {
    /// Name on the command line.
    pub name: &'static str,
    /// Summary in one sentence.
    pub summary: &'static str,
    /// Name of the base task if this task is a variant. A variant shares formulas, layout and
    /// controllers with its base.
    pub variant_of: Option<&'static str>,
    /// Description of the objects in the scene: positions, sizes and masses.
    pub scene_description: &'static str,
    /// Name of the body, with all that is attached to it, or of the flex that the robot
    /// manipulates.
    pub object: Option<&'static str>,
    /// Object in the hand at the start. An offset of the initial posture moves it, and the `object`
    /// on it that is not thrown.
    pub held: Option<HeldObject>,
    /// Initial positions of the seven arm joints (rad) and the two fingers (m).
    pub start: [f64; 9],
    /// Maximum random offset of the initial position of each arm joint, rad. It is drawn with the
    /// seed of the simulation.
    pub start_noise: f64,
    /// Direction to the lamp in images, for a vertical part of 1.
    pub lamp: [f64; 3],
    /// Control of the gripper.
    pub grip: GripperMode,
    /// Physics steps per control step.
    pub n_substeps: usize,
    /// Factor of the joint velocities in the observation.
    pub velocity_scale: f64,
    /// Signals, in order. Each has one component.
    pub signals: &'static [Quantity],
    /// Parts of the observation after the 18 numbers of the robot's joints, in order.
    pub observation: &'static [Quantity],
    /// Terms of the original reward.
    pub original_reward: &'static [Quantity],
    /// Terms of the shaped reward.
    pub shaped_reward: &'static [Quantity],
    /// Axes of the initial box.
    pub initial_box: &'static [BoxAxis],
    /// Variations of the scene besides the initial box.
    pub variations: Variations,
    /// Formulas under [`Preset::Paper`].
    pub paper: TaskFormulas,
    /// Formulas under [`Preset::Code`].
    pub code: TaskFormulas,
    /// Condition of [`Scene::is_terminal`], in words.
    pub termination: &'static str,
    /// Differences from the original benchmark and their reasons.
    pub differences: &'static str,
}

impl Definition {
    /// Returns the formulas of a preset.
    pub fn formulas(&self, preset: Preset) -> &TaskFormulas {
        match preset {
            Preset::Paper => &self.paper,
            Preset::Code => &self.code,
        }
    }

    /// Returns the terms of a reward.
    pub fn reward(&self, reward: Reward) -> &'static [Quantity] {
        match reward {
            Reward::Original => self.original_reward,
            Reward::Shaped => self.shaped_reward,
        }
    }

    /// Returns the parts of an observation: the robot's joints, then the task's part.
    pub fn whole_observation(&self) -> Vec<Quantity> {
        let robot = [
            Quantity {
                name: "joint_positions",
                unit: "",
                size: JOINTS,
                meaning: "positions of the seven arm joints and two fingers, mapped from their limits to [-1, 1]",
            },
            Quantity {
                name: "joint_velocities",
                unit: "rad/s, m/s",
                size: JOINTS,
                meaning: "velocities of the joints, multiplied by the velocity scale of the task",
            },
        ];
        robot.iter().chain(self.observation).copied().collect()
    }

    /// Returns the further parts of an observation, in order. The environment writes those that a
    /// controller names, after the [whole observation](Self::whole_observation).
    pub fn further_observation(&self) -> Vec<Quantity> {
        crate::further::further_parts(self).iter().map(|part| part.quantity()).collect()
    }

    /// Returns the layout of observations and actions of a controller that reads no further parts.
    pub fn layout(&self) -> Layout {
        self.layout_with(&[])
    }

    /// Returns the layout of observations and actions of a controller that reads these further
    /// parts. Names that the task does not have are left out.
    pub fn layout_with(&self, further_parts: &[String]) -> Layout {
        let entry = |name: &str, unit: &str, size| Entry { name: name.into(), unit: unit.into(), size };
        let mut parts = self.whole_observation();
        let named = |part: &Quantity| further_parts.iter().any(|name| name == part.name);
        parts.extend(self.further_observation().into_iter().filter(named));
        Layout {
            observation: parts.iter().map(|q| entry(q.name, q.unit, q.size)).collect(),
            action: vec![
                entry("arm_target_steps", "", ARM_JOINTS),
                entry("finger_target_steps", "", JOINTS - ARM_JOINTS),
            ],
        }
    }

    /// Returns the observation and the action as places of faults: their channels and the range of
    /// each number.
    pub fn fault_sites(&self) -> [FaultSite; 2] {
        crate::axes::sites(self)
    }

    /// Returns the initial box of a preset as a space.
    ///
    /// # Errors
    /// If the bounds of an axis are not in order.
    pub fn starts(&self, preset: Preset) -> Result<Space, RolloutError> {
        let axis = |axis: &BoxAxis| {
            let [low, high] = axis.bounds(preset);
            Axis::start(axis.name, axis.unit, low, high).meaning(axis.meaning)
        };
        Space::new("starts", self.initial_box.iter().map(axis).collect())
    }
}

/// A manipulation task: a definition, a scene, and an expert.
pub trait Task: Send + Sync {
    /// Returns the definition of the task as data.
    fn definition(&self) -> &'static Definition;

    /// Returns the MJCF of the scene around the robot: children of `<mujoco>`.
    ///
    /// Its equality constraints, except those of the edges of a flex, attach the held object to the
    /// hand. All of them are disabled permanently when the gripper releases the object.
    fn scene(&self) -> std::borrow::Cow<'static, str>;

    /// Returns the name of the file of [`scene`](Self::scene), for error messages.
    fn scene_file(&self) -> &'static str {
        "scene.xml"
    }

    /// Returns the page with notes on the task, which [`notes`](crate::notes) reads. The default is
    /// an empty page.
    fn notes(&self) -> &'static str {
        ""
    }

    /// Returns the places of the cameras: over the table and at the wrist.
    fn cameras(&self) -> [CameraPlace; 2] {
        [CameraPlace::OVER, CameraPlace::WRIST]
    }

    /// Finds the elements of the scene in the compiled model.
    ///
    /// # Errors
    /// If an element is missing.
    fn bind(&self, model: &Model, panda: &Panda) -> Result<Box<dyn Scene>, WorldError>;

    /// Returns whether the task is feasible from an initial configuration of its box.
    ///
    /// The default is `true`. A task may return `false` only with a proof from kinematics or from
    /// the duration of an episode. A failure of a controller, including the expert, is not a proof.
    fn reachable(&self, _x0: &[f64]) -> bool {
        true
    }

    /// Returns a model-based controller that satisfies the success formula from the observation
    /// alone.
    ///
    /// # Errors
    /// If the robot's model does not compile.
    fn expert(&self) -> Result<std::sync::Arc<dyn mishandle_rollout::Controller>, WorldError>;
}

/// A task's scene in a compiled model. All functions are pure functions of the simulation state.
pub trait Scene: Send + Sync {
    /// Sets the initial state of the scene from the initial configuration `x0`. The robot is
    /// already placed.
    fn place(&self, x0: &[f64], world: &mut World);

    /// Sets the targets of the fingers for the next control step under [`GripperMode::Scene`], and
    /// returns whether the gripper releases the held object.
    ///
    /// `fingers` contains the targets of the previous step, m; the caller clamps them to the
    /// stroke. The action is not clipped.
    fn grip(&self, _rows: &Rows<'_>, _action: &[f64], _fingers: &mut [f64]) -> bool {
        false
    }

    /// Writes the signals, in the order of the definition.
    fn signals(&self, rows: &Rows<'_>, out: &mut [f64]);

    /// Writes the task's part of the observation, in the order of the definition.
    fn observe(&self, rows: &Rows<'_>, out: &mut [f64]);

    /// Writes the terms of a reward, from the state after the step and its action, which is not
    /// clipped.
    fn reward(&self, reward: Reward, rows: &Rows<'_>, signals: &[f64], action: &[f64], out: &mut [f64]);

    /// Returns whether the state is terminal: a training episode ends here, because the task has
    /// failed.
    fn is_terminal(&self, rows: &Rows<'_>, signals: &[f64]) -> bool;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_conditions_of_careful_success_must_hold() {
        let formulas = |careful| TaskFormulas {
            success: "a > 0",
            strict: "a > 0 or b > 0",
            careful,
            safe: "a > 0",
            completion: "a > 0",
        };
        let text = formulas(Some(&["c > 0 or d > 0"])).careful();
        assert_eq!(text, Some(format!("(a > 0 or b > 0) and ({CAREFUL}) and (c > 0 or d > 0)")));
        let names = |formulas: TaskFormulas| -> Vec<String> {
            formulas.named().into_iter().map(|formula| formula.name).collect()
        };
        assert_eq!(names(formulas(Some(&[]))), ["success", "strict", "careful", "safe", "completion"]);
        assert_eq!(names(formulas(None)), ["success", "strict", "safe", "completion"]);
    }
}
