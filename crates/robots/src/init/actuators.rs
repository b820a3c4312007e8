//! The actuators of a first target file: those that a model lacks, and positions for motors.

use mishandle_world::ElementKind;

use crate::init::facts::{ActionKind, Tool};
use crate::init::robot::JointFacts;
use crate::init::write::{Writer, text};

impl<'a> Writer<'a> {
    /// Actuators for a model without them, one table for all joints with the same gains.
    pub(super) fn actuators(&mut self) {
        let missing = self.without_actuators();
        if self.facts.action == ActionKind::Effort {
            self.line("\n[[model.actuator]]    # the actions are forces");
            self.line(format!("joints = {}\ntype = \"motor\"", pattern(&missing)));
            return;
        }
        if missing.iter().any(|joint| joint.gains.is_none()) {
            self.unknown.push("stiffness and damping of the joints".to_string());
            self.line("\n# TODO stiffness and damping of the joints");
            self.line(format!("# [[model.actuator]]\n# joints = {}", pattern(&missing)));
            self.line("# type = \"position\"\n# kp = \n# kv = ");
            return;
        }
        let limit = |joint: &JointFacts| joint.actuator.as_ref().and_then(|actuator| actuator.limit);
        for joints in groups(&missing, |joint| (joint.gains, limit(joint))) {
            let [kp, kv] = joints[0].gains.unwrap_or_default();
            self.line("\n[[model.actuator]]    # stiffness and damping of the policy's training");
            self.line(format!("joints = {}\ntype = \"position\"\nkp = {kp}\nkv = {kv}", pattern(&joints)));
            if let Some(limit) = limit(joints[0]) {
                self.line(format!("forcerange = [-{limit}, {limit}]    # of the motors of the model"));
            }
        }
        if missing.iter().any(|joint| limit(joint).is_none()) {
            self.unknown
                .push("limits of the joints' torques (`forcerange` in [[model.actuator]])".to_string());
        }
        if self.facts.armature.is_empty() {
            self.armature(&missing);
        }
        self.passive();
    }

    /// Asks for the armature of joints, which decides how stiff an actuator with large gains is.
    fn armature(&mut self, joints: &[&JointFacts]) {
        self.unknown.push(format!(
            "the armature of the joints, which is not in {}: here that of the model; mjlab's own robots have kv² / (16 kp), a \
             damping ratio of 2, as in the comments of the file",
            self.facts.source
        ));
        for joints in groups(joints, |joint| joint.gains) {
            let [kp, kv] = joints[0].gains.unwrap_or_default();
            let armature = format!("{:.6}", kv * kv / (16.0 * kp));
            self.line(format!("\n# TODO armature: {} in the model", joints[0].armature));
            self.line(format!("# [[model.set]]\n# joint = {}\n# armature = {armature}", pattern(&joints)));
        }
    }

    /// Reports damping and friction that joints have beside the damping of the policy's training.
    fn passive(&mut self) {
        let has = |joint: &&JointFacts| joint.passive != [0.0; 2];
        let joints = self.robot.joints.iter().filter(has);
        let texts: Vec<String> = joints
            .map(|joint| {
                let [damping, friction] = joint.passive;
                format!("{} damping {damping}, frictionloss {friction}", joint.name)
            })
            .collect();
        if self.facts.tool == Tool::Isaac && !texts.is_empty() {
            self.remarks.push(format!(
                "joints of the model have damping or friction beside that of the actuators, which the descriptor does not list; \
                 [[model.set]] changes it: {}",
                texts.join("; ")
            ));
        }
    }

    /// Returns the joints for which the file adds actuators.
    fn without_actuators(&self) -> Vec<&'a JointFacts> {
        let replaces = self.replaces_motors();
        self.robot.joints.iter().filter(|joint| joint.actuator.is_none() || replaces).collect()
    }

    /// Returns whether the file adds position actuators.
    pub(super) fn adds_positions(&self) -> bool {
        let added = self.without_actuators();
        self.facts.action != ActionKind::Effort
            && !added.is_empty()
            && added.iter().all(|joint| joint.gains.is_some())
    }

    /// Returns whether the file adds position actuators beside motors of the model, because the
    /// policy's training had them. They need the names of the joints.
    pub(super) fn replaces_motors(&self) -> bool {
        let robot = self.robot;
        let taken = robot.model.names(ElementKind::Actuator);
        self.facts.action != ActionKind::Effort
            && robot.has_actuators()
            && !robot.takes_positions()
            && robot.joints.iter().all(|joint| joint.gains.is_some() && !taken.contains(&joint.name))
    }

    /// Returns whether an action is the control of an actuator.
    pub(super) fn acts_by_control(&self) -> bool {
        let has_gains = self.robot.joints.iter().all(|joint| joint.gains.is_some());
        match self.facts.action {
            ActionKind::Effort => true,
            ActionKind::Position => false,
            ActionKind::Unknown => self.robot.has_actuators() && !self.robot.takes_positions() && !has_gains,
        }
    }

    /// Returns whether positions must be reached by the file itself, because the actuators take
    /// forces.
    pub(super) fn moves_by_force(&self) -> bool {
        !self.acts_by_control()
            && self.robot.has_actuators()
            && !self.robot.takes_positions()
            && !self.replaces_motors()
    }
}

/// Returns a pattern that matches the names of these joints only.
fn pattern(joints: &[&JointFacts]) -> String {
    let names: Vec<String> = joints.iter().map(|joint| regex_lite::escape(&joint.name)).collect();
    text(&names.join("|"))
}

/// Returns the joints that agree in a value, in the order of the first of each group.
fn groups<'a, K: PartialEq>(
    joints: &[&'a JointFacts],
    value: impl Fn(&JointFacts) -> K,
) -> Vec<Vec<&'a JointFacts>> {
    let mut groups: Vec<Vec<&JointFacts>> = Vec::new();
    for joint in joints {
        match groups.iter_mut().find(|group| value(group[0]) == value(joint)) {
            Some(group) => group.push(joint),
            None => groups.push(vec![joint]),
        }
    }
    groups
}
