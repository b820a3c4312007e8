//! The parts of a first target file by the actuators of the model: for a robot without a policy,
//! or with one that says nothing of joints.
//!
//! An action is the control of an actuator, in the order of the model, whatever the actuator moves:
//! a joint, a tendon, a site or a body. Without a policy, the file has a law that holds the start.

use mishandle_world::{ElementKind, JointKind, Model, ModelField};

use crate::init::FirstPolicy;
use crate::init::facts::PolicyFacts;
use crate::init::robot::{is_position, shortest};
use crate::init::write::{Writer, list, rounded, text};
use crate::pattern::names;

/// Angular frequency of the law that holds a joint, rad/s: slow enough for a control step of 20 ms.
const FREQUENCY: f64 = 10.0;

/// Largest number of joints that the law holds: an expression has a limited length.
const LAWS: usize = 30;

/// Numbers of a row of MuJoCo's gains and biases of actuators, and of gears.
const GAINS: usize = 10;
const GEARS: usize = 6;

/// Returns the facts of a policy about which only the model is known: its joints with a name that
/// are hinges or slides, at their positions of the start.
pub(crate) fn facts_of(model: &Model) -> PolicyFacts {
    let is_named = |(index, name): &(usize, String)| {
        let kind = model.joint_kind(*index);
        !name.is_empty() && matches!(kind, JointKind::Hinge | JointKind::Slide)
    };
    let joints = model.names(ElementKind::Joint).into_iter().enumerate().filter(is_named);
    let start = start_of(model);
    let default: Vec<(String, f64)> =
        joints.map(|(index, name)| (name, start[model.joint_at(index).qpos])).collect();
    let joints = default.iter().map(|(name, _)| name.clone()).collect();
    PolicyFacts { joints, default, ..PolicyFacts::default() }
}

fn start_of(model: &Model) -> &[f64] {
    if model.count(ElementKind::Key) > 0 { model.key_qpos(0) } else { model.qpos0() }
}

/// The control of an actuator that holds the start.
#[derive(Clone, Copy)]
enum Hold {
    /// A number.
    Control(f64),
    /// A force on a joint: position at the start, stiffness and damping, and the force for a
    /// control of 1.
    Joint { joint: usize, start: f64, gains: [f64; 2], force: f64 },
}

fn hold(model: &Model, index: usize) -> Hold {
    let gain = model.field(ModelField::ActuatorGainprm)[GAINS * index];
    let gear = model.field(ModelField::ActuatorGear)[GEARS * index];
    let bias = &model.field(ModelField::ActuatorBiasprm)[GAINS * index..][..3];
    let limited = |control: f64| match model.actuator_range(index) {
        Some([low, high]) => control.clamp(low, high),
        None => control,
    };
    let is_single = |joint: &usize| matches!(model.joint_kind(*joint), JointKind::Hinge | JointKind::Slide);
    if model.count(ElementKind::Key) > 0 && model.key_ctrl(0).iter().any(|control| *control != 0.0) {
        return Hold::Control(limited(model.key_ctrl(0)[index]));
    }
    let Some(joint) = model.actuator_joint(index).filter(is_single) else {
        return Hold::Control(limited(0.0));
    };
    let start = start_of(model)[model.joint_at(joint).qpos];
    if is_position(gain, bias) {
        return Hold::Control(limited(gear * start));
    }
    let mass = model.field(ModelField::DofM0)[model.joint_at(joint).dof];
    let force = gain * gear;
    if bias.iter().any(|number| *number != 0.0) || force == 0.0 || mass <= 0.0 {
        return Hold::Control(limited(0.0));
    }
    Hold::Joint { joint, start, gains: [mass * FREQUENCY.powi(2), 2.0 * mass * FREQUENCY], force }
}

impl Writer<'_> {
    /// Groups of the joints, of which observation and signals speak.
    pub(super) fn bare_constants(&mut self) {
        let names: Vec<String> = self.robot.joints.iter().map(|joint| text(&joint.name)).collect();
        if names.is_empty() {
            return;
        }
        self.line("[constants]");
        self.line(format!("joints = {{ group = \"joint\", names = [{}] }}", names.join(", ")));
        self.line(
            "\n[constants.default]    # positions of the joints at the start, rad or m\nof = \"joints\"",
        );
        for joint in &self.robot.joints {
            self.line(format!("{} = {}", text(&joint.name), joint.default));
        }
        self.line("");
    }

    /// The policy: a file, a program, or a law.
    pub(super) fn bare_policy(&mut self, policy: &FirstPolicy) {
        let model = &self.robot.model;
        let own = names(model, ElementKind::Actuator);
        let count = if own.is_empty() { self.robot.joints.len() } else { own.len() };
        let label = |index: usize| match own.get(index).map(String::as_str) {
            None => self.robot.joints[index].name.clone(),
            Some("") => format!("actuator {index}"),
            Some(name) => name.to_string(),
        };
        self.line("[policy]");
        match policy {
            FirstPolicy::Onnx(file) => self.line(format!("onnx = {}", text(file))),
            FirstPolicy::Program(command) => {
                let words: Vec<String> = command.iter().map(|word| text(word)).collect();
                self.line(format!("process = [{}]", words.join(", ")));
            }
            FirstPolicy::Law => {
                self.unknown.push(
                    "the policy: here a law that holds the start; `onnx = \"policy.onnx\"` or `process = [\"python3\", \
                     \"policy.py\"]` takes its place"
                        .to_string(),
                );
                self.line(
                    "# TODO your policy in place of a law that holds the start; one line for each actuator",
                );
                let laws: Vec<String> = if model.actuators() == 0 {
                    self.robot.joints.iter().map(|joint| joint.default.to_string()).collect()
                } else {
                    let mut laws = 0;
                    let law = |index| match hold(model, index) {
                        Hold::Joint { .. } if laws == LAWS => "0".to_string(),
                        held => {
                            laws += usize::from(matches!(held, Hold::Joint { .. }));
                            self.law(held)
                        }
                    };
                    (0..count).map(law).collect()
                };
                self.line(format!("expression = \"\"\"[\n  {}\n]\"\"\"", laws.join(",\n  ")));
            }
        }
        let meaning = "controls of the actuators, in the order of the model";
        if !matches!(policy, FirstPolicy::Law) {
            self.unknown.push(format!("the meaning of the actions: here {meaning}"));
            if let Some(size) = self.sizes.action.filter(|size| *size != count) {
                self.remarks
                    .push(format!("the policy has {size} actions, but the model has {count} actuators"));
            }
        }
        self.line(format!("actions = {count}"));
        self.line(format!("action = \"action\"    # {meaning}:"));
        for index in 0..count {
            let range = if own.is_empty() { None } else { model.actuator_range(index) };
            let range = range.map_or("no limits".to_string(), |range| list(&range));
            self.line(format!("#   {}, {range}", super::write::comment(&label(index))));
        }
        self.line("");
    }

    /// Returns a control as an expression of the observation.
    fn law(&self, hold: Hold) -> String {
        let (joint, start, gains, force) = match hold {
            Hold::Control(control) => return shortest(control).to_string(),
            Hold::Joint { joint, start, gains, force } => (joint, start, gains, force),
        };
        let name = &self.robot.model.names(ElementKind::Joint)[joint];
        let Some(place) = self.robot.joints.iter().position(|known| known.name == *name) else {
            return "0".to_string();
        };
        let [stiffness, damping] = gains.map(|gain| rounded(gain / force));
        // The part of a single joint is a number.
        let place = if self.robot.joints.len() == 1 { String::new() } else { format!("[{place}]") };
        format!("{stiffness} * ({start} - position{place}) - {damping} * velocity{place}")
    }

    /// Position servos for the joints of a model without actuators.
    pub(super) fn bare_actuators(&mut self) {
        self.unknown
            .push("the actuators, which the model lacks: here a position servo for each joint".to_string());
        for joint in &self.robot.joints {
            let index = self.robot.model.find(ElementKind::Joint, &joint.name).unwrap_or_default();
            let mass = self.robot.model.field(ModelField::DofM0)[self.robot.model.joint_at(index).dof];
            let [kp, kv] = [mass * FREQUENCY.powi(2), 2.0 * mass * FREQUENCY].map(rounded);
            let name = text(&regex_lite::escape(&joint.name));
            self.line(format!(
                "\n[[model.actuator]]\njoints = {name}\ntype = \"position\"\nkp = {kp}\nkv = {kv}"
            ));
        }
    }

    /// The observation: positions and velocities of the joints, or what has the size that the
    /// policy reads.
    pub(super) fn bare_observation(&mut self) {
        self.line("[observation]");
        let joints = self.robot.joints.len();
        let actuators = self.robot.model.actuators();
        let actions = if actuators == 0 { joints } else { actuators };
        if joints > 0 && self.sizes.observation == Some(2 * joints + actions) {
            self.unknown.push(
                "the parts of the observation: here positions and velocities of the joints, and the last action"
                    .to_string(),
            );
            self.line("position = \"qpos(joints)\"\nvelocity = \"qvel(joints)\"\nlast = \"action\"\n");
            return;
        }
        let layout =
            self.sizes.observation.filter(|size| *size != 2 * joints).and_then(|size| self.left_out(size));
        match layout {
            Some(left_out) => {
                self.unknown.push(format!(
                    "the parts of the observation: here all positions but the first {left_out}, then all velocities, as in the \
                     environments of Gymnasium"
                ));
                let from = if left_out == 0 { String::new() } else { format!("[{left_out}:]") };
                self.line(format!("position = \"qpos('.*'){from}\"\nvelocity = \"qvel('.*')\""));
            }
            None if joints == 0 => {
                self.unknown.push("the parts of the observation: here the time".to_string());
                self.line("clock = { value = \"time\", unit = \"s\" }");
            }
            None => {
                if let Some(size) = self.sizes.observation {
                    self.unknown.push(
                        "the parts of the observation: here positions and velocities of the joints"
                            .to_string(),
                    );
                    if size != 2 * joints {
                        self.remarks.push(format!(
                            "the parts of the observation have {} numbers, but the policy reads {size}",
                            2 * joints
                        ));
                    }
                }
                self.line("position = \"qpos(joints)\"\nvelocity = \"qvel(joints)\"");
            }
        }
        self.line("");
    }

    /// Returns how many of the first positions the observation of a robot of Gymnasium leaves out:
    /// its place on its line or in its plane.
    fn left_out(&self, size: usize) -> Option<usize> {
        let model = &self.robot.model;
        let all = model.qpos_size() + model.qvel_size();
        (0..=2).find(|left_out| all == size + left_out)
    }
}
