//! Facts of a model about the robot of a policy.

use std::path::Path;

use mishandle_world::{ElementKind, GeomKind, JointKind, Model, ModelField};

use crate::error::RobotError;
use crate::init::facts::{PolicyFacts, Tool, wrong};
use crate::pattern::{missing, names as names_in};

/// Largest difference of a number that was rounded to three decimals.
const ROUNDING: f64 = 5e-4;

/// Numbers of a row of MuJoCo's gains and biases of actuators.
const GAINS: usize = 10;

/// Numbers of a row of MuJoCo's gears of actuators.
const GEARS: usize = 6;

/// The sensor with which mjlab measures the velocity of a base.
const VELOCITY_SENSOR: &str = "imu_lin_vel";

/// The robot of a policy.
pub(crate) struct RobotFacts {
    pub model: Model,
    /// Joints of the actions, in their order.
    pub joints: Vec<JointFacts>,
    /// Joints of the observation, if they are others.
    pub observed: Option<Vec<String>>,
    pub base: Option<Base>,
    /// Name or number of the first keyframe.
    pub keyframe: Option<String>,
    /// The site at which mjlab measures the velocity of the base.
    pub site: Option<String>,
    /// Whether the integrator of the model is implicit in velocities.
    pub is_implicit: bool,
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
    /// Armature, damping and dry friction in the model.
    pub armature: f64,
    pub passive: [f64; 2],
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
    /// Largest force on the joint, N or N m, if the model limits it.
    pub limit: Option<f64>,
}

/// A base that moves freely.
pub(crate) struct Base {
    pub body: String,
    /// Name of its joint.
    pub joint: String,
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
    pub(crate) fn read(file: &Path, model: Model, facts: &PolicyFacts) -> Result<RobotFacts, RobotError> {
        let mut unknown = Vec::new();
        let mut remarks = facts.remarks.clone();
        let names = moved_joints(&model, facts, &mut unknown)?;
        let first = model.names(ElementKind::Key).into_iter().next();
        let keyframe = first.map(|name| if name.is_empty() { "0".to_string() } else { name });
        let joints = joints(&model, facts, &names, keyframe.as_deref(), &mut unknown, &mut remarks)?;
        let all = model.names(ElementKind::Joint);
        if let Some(name) = facts.observed_joints.iter().find(|name| !all.contains(name)) {
            return Err(wrong(&facts.source, missing("joint", name, &all)));
        }
        let observed = Some(facts.observed_joints.clone());
        let observed = observed.filter(|observed| !observed.is_empty() && *observed != names);
        let base = base(&model, &names, keyframe.is_some(), &mut unknown)?;
        let site = base.as_ref().and_then(|base| velocity_site(&model, base, facts, &mut remarks));
        let bodies = model.names(ElementKind::Body);
        let last = names.last().and_then(|name| model.find(ElementKind::Joint, name).ok());
        let body = match (&base, last) {
            (Some(base), _) => base.body.clone(),
            (None, Some(joint)) => bodies[model.body_of_joint(joint).index()].clone(),
            // The world comes first.
            (None, None) => bodies.iter().skip(1).rfind(|name| !name.is_empty()).cloned().unwrap_or_default(),
        };
        let used = names.iter().chain(&facts.observed_joints).chain([&body]).chain(&keyframe);
        if let Some(name) = used.into_iter().find(|name| !is_writable(name)) {
            let message =
                format!("the name `{name}` has a quotation mark or a backslash; rename it in the model");
            return Err(RobotError::Model { path: file.to_path_buf(), message });
        }
        let is_implicit = model.is_implicit();
        let floor = floor(&model);
        let mass = model.field(ModelField::BodyMass).iter().sum();
        Ok(RobotFacts {
            joints,
            observed,
            base,
            keyframe,
            site,
            is_implicit,
            floor,
            body,
            mass,
            unknown,
            remarks,
            model,
        })
    }

    /// Returns whether each joint has an actuator.
    pub(crate) fn has_actuators(&self) -> bool {
        self.joints.iter().all(|joint| joint.actuator.is_some())
    }

    /// Returns whether the first keyframe has controls that are not 0.
    pub(crate) fn keyframe_has_controls(&self) -> bool {
        self.keyframe.is_some() && self.model.key_ctrl(0).iter().any(|control| *control != 0.0)
    }

    /// Returns whether the actuators of all joints take positions.
    pub(crate) fn takes_positions(&self) -> bool {
        self.joints.iter().all(|joint| joint.actuator.as_ref().is_some_and(|own| own.gains.is_some()))
    }
}

fn is_writable(name: &str) -> bool {
    !name.chars().any(|letter| matches!(letter, '\'' | '"' | '\\') || letter.is_control())
}

/// Returns facts with the names of the model's joints: a model that is composed of others, such as
/// one that mjlab writes, has a common text, `robot/`, before all names.
pub(crate) fn named_as_in(model: &Model, facts: &PolicyFacts) -> PolicyFacts {
    let known = model.names(ElementKind::Joint);
    let all = || facts.joints.iter().chain(&facts.observed_joints);
    let Some(first) = all().next().filter(|first| !known.contains(first)) else {
        return facts.clone();
    };
    let prefixes = known.iter().filter_map(|name| name.strip_suffix(first.as_str()));
    let prefixes = prefixes.filter(|prefix| prefix.ends_with('/'));
    let fits = |prefix: &&str| all().all(|name| known.contains(&format!("{prefix}{name}")));
    prefixes.into_iter().find(fits).map_or_else(|| facts.clone(), |prefix| facts.with_prefix(prefix))
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
        } else if let Some(count) = count.filter(|count| *count < facts.observed_joints.len()) {
            unknown.push(format!(
                "which of the joints of the policy its actions move: here the first {count}, because {} has {count} stiffnesses",
                facts.source
            ));
            facts.observed_joints[..count].to_vec()
        } else {
            unknown.push("which of the joints of the policy its actions move".to_string());
            facts.observed_joints.clone()
        }
    } else {
        Vec::new()
    };
    if names.iter().any(String::is_empty) {
        let source = if facts.source.is_empty() { "the model" } else { &facts.source };
        return Err(wrong(source, "a joint that an actuator moves has no name; name it in the model"));
    }
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
    unknown: &mut Vec<String>,
    remarks: &mut Vec<String>,
) -> Result<Vec<JointFacts>, RobotError> {
    let mut found = Vec::new();
    let mut differs = Vec::new();
    let actuator_names = names_in(model, ElementKind::Actuator);
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
        let dof = model.joint_at(joint).dof;
        let of_dof = |field: ModelField| model.field(field)[dof];
        found.push(JointFacts {
            name: name.clone(),
            default,
            armature: of_dof(ModelField::DofArmature),
            passive: [of_dof(ModelField::DofDamping), of_dof(ModelField::DofFrictionloss)],
            scale: scale.map(shortest),
            gains,
            actuator,
        });
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

/// Returns whether an actuator with this gain and these biases is a position servo.
pub(crate) fn is_position(gain: f64, bias: &[f64]) -> bool {
    gain > 0.0 && (bias[1] + gain).abs() <= 1e-9 * gain
}

fn actuator(model: &Model, number: usize, name: String) -> ActuatorFacts {
    let gain = model.field(ModelField::ActuatorGainprm)[GAINS * number];
    let bias = &model.field(ModelField::ActuatorBiasprm)[GAINS * number..][..3];
    let takes_positions = is_position(gain, bias);
    let gear = model.field(ModelField::ActuatorGear)[GEARS * number].abs();
    let largest = |range: [f64; 2]| range[0].abs().max(range[1].abs());
    // The range of a control is one of forces if the actuator is a motor.
    let is_motor = bias.iter().all(|number| *number == 0.0);
    let of_control =
        model.actuator_range(number).filter(|_| is_motor).map(|range| gain.abs() * largest(range));
    let of_force = model.actuator_force_range(number).map(largest);
    let limit = [of_control, of_force].into_iter().flatten().reduce(f64::min);
    ActuatorFacts {
        name,
        gains: takes_positions.then(|| [gain, 0.0 - bias[2]]),
        limit: limit.map(|limit| gear * limit),
    }
}

/// Returns the first body that moves freely and has a joint of the policy below it: a free object
/// is no base.
fn base(
    model: &Model,
    joints: &[String],
    has_keyframe: bool,
    unknown: &mut Vec<String>,
) -> Result<Option<Base>, RobotError> {
    let moved: Vec<usize> =
        joints.iter().filter_map(|name| model.find(ElementKind::Joint, name).ok()).collect();
    let carries = |free: &usize| {
        let body = model.body_of_joint(*free);
        moved.iter().any(|joint| model.is_within(model.body_of_joint(*joint), body))
    };
    let mut free = (0..model.joint_count()).filter(|joint| model.joint_kind(*joint) == JointKind::Free);
    let Some(joint) = free.find(carries) else { return Ok(None) };
    let body = model.names(ElementKind::Body)[model.body_of_joint(joint).index()].clone();
    let name = names_in(model, ElementKind::Joint).swap_remove(joint);
    if body.is_empty() || !is_writable(&name) {
        unknown.push("the name of the body that moves freely: it has none in the model".to_string());
        return Ok(None);
    }
    let place = model.joint_at(joint).qpos + 2;
    let height = if has_keyframe { model.key_qpos(0)[place] } else { model.qpos0()[place] };
    unknown.push(format!(
        "the height of the base at the start: here that of the model, {height} m; the robot should stand on the floor"
    ));
    Ok(Some(Base { body, joint: name, height }))
}

/// Returns the site of mjlab's velocity sensor, if it is on the base and has the axes of its body.
fn velocity_site(
    model: &Model,
    base: &Base,
    facts: &PolicyFacts,
    remarks: &mut Vec<String>,
) -> Option<String> {
    let reads = facts.parts.iter().any(|part| part.name == "base_lin_vel");
    if facts.tool != Tool::Mjlab || !reads {
        return None;
    }
    let sensors = model.names(ElementKind::Sensor);
    let sensor = sensors.iter().position(|name| name.ends_with(VELOCITY_SENSOR));
    let site = sensor.and_then(|sensor| model.sensor_site(sensor));
    let found = site.map(|site| model.names(ElementKind::Site)[site].clone()).filter(|name| {
        let (Ok(site), Ok(body)) = (model.site(name), model.body(&base.body)) else { return false };
        let mut world = model.world();
        world.refresh();
        let axes = world.rows().site_rotation(site);
        let is_same = axes.iter().zip(world.body_rotation(body)).all(|(a, b)| (a - b).abs() < 1e-6);
        is_same && model.body_of_site(site.index()) == body && is_writable(name)
    });
    if found.is_none() {
        remarks.push(format!(
            "`base_lin_vel` is the velocity of the body's origin; mjlab measures it with the sensor `{VELOCITY_SENSOR}`, and the \
             model has none on this body with its axes: add cross(angular velocity, position of its site)"
        ));
    }
    found
}

fn floor(model: &Model) -> Floor {
    let names = model.names(ElementKind::Geom);
    let is_ground = |kind| matches!(kind, GeomKind::Plane | GeomKind::HeightField(_));
    let is_floor = |name: &&String| ["floor", "ground", "plane", "terrain"].contains(&name.as_str());
    match names.iter().find(is_floor) {
        Some(name) => Floor::Named(name.clone()),
        None if model.geoms().iter().any(|geom| is_ground(geom.kind)) => Floor::Unnamed,
        None => Floor::Missing,
    }
}

/// Returns the 64-bit number of the shortest text of a number that was stored with 32 bits.
pub(crate) fn shortest(number: f64) -> f64 {
    let narrow = number as f32;
    if f64::from(narrow) == number { narrow.to_string().parse().unwrap_or(number) } else { number }
}
