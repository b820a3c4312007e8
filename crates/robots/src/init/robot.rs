//! Facts of a model about the robot of a policy.

use std::path::Path;

use mishandle_world::{ElementKind, JointKind, Model, ModelField};

use crate::error::RobotError;
use crate::init::facts::{PolicyFacts, wrong};
use crate::pattern::missing;

/// Largest difference of a number that was rounded to three decimals.
const ROUNDING: f64 = 5e-4;

/// Numbers of a row of MuJoCo's gains and biases of actuators.
const GAINS: usize = 10;

/// The robot of a policy.
pub(crate) struct RobotFacts {
    pub model: Model,
    /// Joints of the actions, in their order.
    pub joints: Vec<JointFacts>,
    /// Joints of the observation, if they are others.
    pub observed: Option<Vec<String>>,
    pub base: Option<Base>,
    pub keyframe: Option<String>,
    pub floor: Floor,
    /// Body for payloads and pushes.
    pub body: String,
    /// Mass of the robot, kg.
    pub mass: f64,
    /// Statements for the user.
    pub unknown: Vec<String>,
    pub remarks: Vec<String>,
}

/// A joint that the policy moves.
pub(crate) struct JointFacts {
    pub name: String,
    pub default: f64,
    pub scale: Option<f64>,
    /// Stiffness and damping that the policy expects.
    pub gains: Option<[f64; 2]>,
    pub actuator: Option<ActuatorFacts>,
}

/// The actuator of a joint.
pub(crate) struct ActuatorFacts {
    pub name: String,
    /// Stiffness and damping of a position actuator; nothing for one that sets a force.
    pub gains: Option<[f64; 2]>,
}

/// A base that moves freely.
pub(crate) struct Base {
    pub body: String,
    /// Its joint, if it has a name.
    pub joint: Option<String>,
    /// Height at the start, m.
    pub height: f64,
}

/// The floor of the model.
pub(crate) enum Floor {
    Missing,
    Named(String),
    Unnamed,
}

impl RobotFacts {
    pub(crate) fn read(file: &Path, facts: &PolicyFacts) -> Result<RobotFacts, RobotError> {
        let (document, model) = crate::model::plain(file)?;
        let (mut unknown, mut remarks) = (Vec::new(), facts.remarks.clone());
        let names = moved_joints(&model, facts, &mut unknown)?;
        let keyframe = (model.count(ElementKind::Key) > 0)
            .then(|| model.names(ElementKind::Key)[0].clone())
            .filter(|name| !name.is_empty());
        let joints = joints(&model, facts, &names, keyframe.as_deref(), (&mut unknown, &mut remarks))?;
        let all = model.names(ElementKind::Joint);
        if let Some(name) = facts.observed_joints.iter().find(|name| !all.contains(name)) {
            return Err(wrong(&facts.source, missing("joint", name, &all)));
        }
        let observed = Some(facts.observed_joints.clone());
        let observed = observed.filter(|observed| !observed.is_empty() && *observed != names);
        let base = base(&model, keyframe.is_some(), &mut unknown)?;
        let bodies = model.names(ElementKind::Body);
        let last = names.last().and_then(|name| model.find(ElementKind::Joint, name).ok());
        let body = match (&base, last) {
            (Some(base), _) => base.body.clone(),
            (None, Some(joint)) => bodies[model.body_of_joint(joint).index()].clone(),
            (None, None) => String::new(),
        };
        let used = names.iter().chain(&facts.observed_joints).chain([&body]).chain(&keyframe);
        if let Some(name) = used.into_iter().find(|name| !is_writable(name)) {
            let message =
                format!("the name `{name}` has a quotation mark or a backslash; rename it in the model");
            return Err(RobotError::Model { path: file.to_path_buf(), message });
        }
        let floor = floor(&document, &model);
        let mass = model.field(ModelField::BodyMass).iter().sum();
        Ok(RobotFacts { joints, observed, base, keyframe, floor, body, mass, unknown, remarks, model })
    }

    /// Returns whether each joint has an actuator.
    pub(crate) fn has_actuators(&self) -> bool {
        self.joints.iter().all(|joint| joint.actuator.is_some())
    }

    /// Returns whether the actuators of all joints take positions.
    pub(crate) fn takes_positions(&self) -> bool {
        self.joints.iter().all(|joint| joint.actuator.as_ref().is_some_and(|own| own.gains.is_some()))
    }
}

fn is_writable(name: &str) -> bool {
    !name.chars().any(|letter| matches!(letter, '\'' | '"' | '\\') || letter.is_control())
}

/// Returns the joints of the actions in their order.
fn moved_joints(
    model: &Model,
    facts: &PolicyFacts,
    unknown: &mut Vec<String>,
) -> Result<Vec<String>, RobotError> {
    let known = model.names(ElementKind::Joint);
    let of_actuators: Vec<String> = (0..model.actuators())
        .filter_map(|index| model.actuator_joint(index))
        .map(|joint| known[joint].clone())
        .collect();
    let names = if !facts.joints.is_empty() {
        facts.joints.clone()
    } else if !facts.observed_joints.is_empty() {
        let own: Vec<String> =
            facts.observed_joints.iter().filter(|name| of_actuators.contains(name)).cloned().collect();
        let count = facts.gains.as_ref().map(|[stiffness, _]| stiffness.len());
        if count == Some(own.len()) {
            own
        } else {
            unknown.push("which of the joints of the policy its actions move".to_string());
            facts.observed_joints.clone()
        }
    } else {
        unknown.push("which joints the actions move, and in which order: here that of the model".to_string());
        let moves = |joint: &usize| matches!(model.joint_kind(*joint), JointKind::Hinge | JointKind::Slide);
        match of_actuators.is_empty() {
            true => (0..model.joint_count()).filter(moves).map(|joint| known[joint].clone()).collect(),
            false => of_actuators,
        }
    };
    if let Some(name) = names.iter().find(|name| !known.contains(name)) {
        return Err(wrong(&facts.source, missing("joint", name, &known)));
    }
    Ok(names)
}

fn joints(
    model: &Model,
    facts: &PolicyFacts,
    names: &[String],
    keyframe: Option<&str>,
    (unknown, remarks): (&mut Vec<String>, &mut Vec<String>),
) -> Result<Vec<JointFacts>, RobotError> {
    let mut found = Vec::new();
    let mut differs = Vec::new();
    let actuator_names = model.names(ElementKind::Actuator);
    for (index, name) in names.iter().enumerate() {
        let joint = model.find(ElementKind::Joint, name).unwrap_or_default();
        let place = model.joint_at(joint).qpos;
        let own = match keyframe {
            Some(_) => model.key_qpos(0)[place],
            None => model.qpos0()[place],
        };
        let default = match facts.default_of(name).map(shortest) {
            None => own,
            Some(default) if (default - own).abs() <= ROUNDING => own,
            Some(default) => {
                if keyframe.is_some() {
                    differs.push(format!("{name} {default} (policy), {own} (model)"));
                }
                default
            }
        };
        let gains = facts.gains.as_ref();
        let gains = gains.and_then(|[kp, kd]| Some([shortest(*kp.get(index)?), shortest(*kd.get(index)?)]));
        let number = (0..model.actuators()).find(|number| model.actuator_joint(*number) == Some(joint));
        let actuator = number.map(|number| actuator(model, number, actuator_names[number].clone()));
        let scale = match facts.scale.as_slice() {
            [one] => Some(*one),
            several => several.get(index).copied(),
        };
        found.push(JointFacts { name: name.clone(), default, scale: scale.map(shortest), gains, actuator });
    }
    if let (false, Some(keyframe)) = (differs.is_empty(), keyframe) {
        remarks
            .push(format!("default positions differ from the keyframe `{keyframe}`: {}", differs.join("; ")));
    }
    if names.iter().any(|name| facts.default_of(name).is_none()) {
        unknown.push("the default positions of the joints: here those of the model".to_string());
    }
    gains_differ(&found, remarks);
    armature_differs(model, facts, names, remarks);
    Ok(found)
}

/// Reports joints with another armature than in the training of the policy.
fn armature_differs(model: &Model, facts: &PolicyFacts, names: &[String], remarks: &mut Vec<String>) {
    let own = |name: &str| {
        let joint = model.find(ElementKind::Joint, name).ok()?;
        model.field(ModelField::DofArmature).get(model.joint_at(joint).dof).copied()
    };
    let policy = facts.armature.iter().filter(|(name, _)| names.contains(name));
    let differs: Vec<String> = policy
        .filter_map(|(name, policy)| {
            let own = own(name).filter(|own| (own - policy).abs() > ROUNDING)?;
            Some(format!("{name} {} (policy), {own} (model)", shortest(*policy)))
        })
        .collect();
    if !differs.is_empty() {
        remarks.push(format!(
            "the armature of joints differs; [[model.set]] changes it: {}",
            differs.join("; ")
        ));
    }
}

/// Reports actuators of the model with other gains than the policy expects.
fn gains_differ(joints: &[JointFacts], remarks: &mut Vec<String>) {
    let mut differs = Vec::new();
    for joint in joints {
        let of_model = joint.actuator.as_ref().and_then(|actuator| actuator.gains);
        if let (Some(policy), Some(own)) = (joint.gains, of_model)
            && policy.iter().zip(own).any(|(a, b)| (a - b).abs() > ROUNDING)
        {
            differs.push(format!(
                "{} kp {} and kv {} (policy), {} and {} (model)",
                joint.name, policy[0], policy[1], own[0], own[1]
            ));
        }
    }
    if !differs.is_empty() {
        remarks.push(format!(
            "gains of the actuators differ, and the file keeps those of the model: {}",
            differs.join("; ")
        ));
    }
}

fn actuator(model: &Model, number: usize, name: String) -> ActuatorFacts {
    let gain = model.field(ModelField::ActuatorGainprm)[GAINS * number];
    let bias = &model.field(ModelField::ActuatorBiasprm)[GAINS * number..][..3];
    let is_position = gain > 0.0 && (bias[1] + gain).abs() <= 1e-9 * gain;
    ActuatorFacts { name, gains: is_position.then(|| [gain, 0.0 - bias[2]]) }
}

/// Returns the first body that moves freely.
fn base(model: &Model, has_keyframe: bool, unknown: &mut Vec<String>) -> Result<Option<Base>, RobotError> {
    let free = (0..model.joint_count()).find(|joint| model.joint_kind(*joint) == JointKind::Free);
    let Some(joint) = free else { return Ok(None) };
    let body = model.names(ElementKind::Body)[model.body_of_joint(joint).index()].clone();
    if body.is_empty() {
        unknown.push("the name of the body that moves freely: it has none in the model".to_string());
        return Ok(None);
    }
    let place = model.joint_at(joint).qpos + 2;
    let height = if has_keyframe { model.key_qpos(0)[place] } else { model.qpos0()[place] };
    let name = model.names(ElementKind::Joint)[joint].clone();
    unknown.push(format!(
        "the height of the base at the start: here that of the model, {height} m; the robot should stand on the floor"
    ));
    let joint = Some(name).filter(|name| !name.is_empty() && is_writable(name));
    Ok(Some(Base { body, joint, height }))
}

fn floor(document: &str, model: &Model) -> Floor {
    let names = model.names(ElementKind::Geom);
    let is_floor = |name: &&String| ["floor", "ground", "plane", "terrain"].contains(&name.as_str());
    match names.iter().find(is_floor) {
        Some(name) => Floor::Named(name.clone()),
        None if document.contains("\"plane\"") || document.contains("\"hfield\"") => Floor::Unnamed,
        None => Floor::Missing,
    }
}

/// Returns the 64-bit number of the shortest text of a number that was stored with 32 bits.
pub(crate) fn shortest(number: f64) -> f64 {
    let narrow = number as f32;
    match f64::from(narrow) == number {
        true => narrow.to_string().parse().unwrap_or(number),
        false => number,
    }
}
