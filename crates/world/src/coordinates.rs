//! Named coordinates of a model: joint positions and velocities.

use mujoco_rs::prelude::{MjtJoint, MjtObjBase};

use crate::Model;

/// A number of the state with its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Coordinate {
    /// Name of the joint, or of its body; for a free or ball joint with the axis, such as `cup_x`.
    /// Quaternions are `_qw`, `_qx`, `_qy`, `_qz`.
    pub name: String,
    /// Unit: `m` or `rad`, of a velocity `m/s` or `rad/s`, empty for a quaternion.
    pub unit: &'static str,
    /// Index into the generalized positions or velocities.
    pub index: usize,
    /// Whether it is a velocity.
    pub is_velocity: bool,
}

impl Model {
    /// Returns the positions of all joints, then their velocities, without those of the vertices of
    /// flexes. A joint without a name has that of its body, and its number there if the body has
    /// several. Without both names it is left out.
    ///
    /// # Example
    /// ```
    /// let model = mishandle_world::Model::from_xml(mishandle_world::PANDA)?;
    /// let coordinates = model.coordinates();
    /// assert_eq!(coordinates.len(), 18);
    /// assert_eq!((coordinates[6].name.as_str(), coordinates[6].unit), ("joint7", "rad"));
    /// assert_eq!((coordinates[17].name.as_str(), coordinates[17].unit), ("finger_joint2", "m/s"));
    /// # Ok::<(), mishandle_world::WorldError>(())
    /// ```
    pub fn coordinates(&self) -> Vec<Coordinate> {
        let mut positions = Vec::new();
        let mut velocities = Vec::new();
        for (joint, kind) in self.inner.jnt_type().iter().enumerate() {
            let Some(name) = self.name_of_joint(joint) else { continue };
            let qpos = self.inner.jnt_qposadr()[joint] as usize;
            let dof = self.inner.jnt_dofadr()[joint] as usize;
            let mut add = |suffix: &str, [position, velocity]: [Option<&'static str>; 2], i: usize| {
                let coordinate = |unit, index, is_velocity| Coordinate {
                    name: format!("{name}{suffix}"),
                    unit,
                    index,
                    is_velocity,
                };
                positions.extend(position.map(|unit| coordinate(unit, qpos + i, false)));
                velocities.extend(velocity.map(|unit| coordinate(unit, dof + i, true)));
            };
            if *kind == MjtJoint::mjJNT_FREE {
                for (i, suffix) in ["_x", "_y", "_z"].into_iter().enumerate() {
                    add(suffix, [Some("m"), Some("m/s")], i);
                }
            }
            let mut add_rotation = |first: usize| {
                for (i, suffix) in ["_qw", "_qx", "_qy", "_qz"].into_iter().enumerate() {
                    add(suffix, [Some(""), None], first + i);
                }
                for (i, suffix) in ["_wx", "_wy", "_wz"].into_iter().enumerate() {
                    add(suffix, [None, Some("rad/s")], first + i);
                }
            };
            match kind {
                MjtJoint::mjJNT_BALL => add_rotation(0),
                MjtJoint::mjJNT_FREE => add_rotation(3),
                MjtJoint::mjJNT_SLIDE => add("", [Some("m"), Some("m/s")], 0),
                MjtJoint::mjJNT_HINGE => add("", [Some("rad"), Some("rad/s")], 0),
            }
        }
        positions.extend(velocities);
        positions
    }

    fn name_of_joint(&self, joint: usize) -> Option<String> {
        let model = &*self.inner;
        let name = |kind, index| model.id_to_name(kind, index).filter(|name| !name.is_empty());
        if let Some(name) = name(MjtObjBase::mjOBJ_JOINT, joint) {
            return Some(name.to_string());
        }
        let body = model.jnt_bodyid()[joint];
        if model.flex_vertbodyid().contains(&body) {
            return None;
        }
        let body = body as usize;
        let of_body = name(MjtObjBase::mjOBJ_BODY, body)?;
        match model.body_jntnum()[body] {
            1 => Some(of_body.to_string()),
            _ => Some(format!("{of_body}_{}", joint as i32 - model.body_jntadr()[body] + 1)),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn joints_without_names_have_those_of_their_bodies() {
        let model = Model::from_xml(
            r#"<mujoco><worldbody>
            <body name="base"><freejoint/><geom size="1"/>
              <body name="leg"><joint type="slide"/><joint/><joint name="own"/><geom size="1"/></body>
              <body><joint/><geom size="1"/></body></body></worldbody></mujoco>"#,
        )
        .unwrap();
        let coordinates = model.coordinates();
        let of = |is_velocity: bool| -> Vec<&str> {
            let found = coordinates.iter().filter(|coordinate| coordinate.is_velocity == is_velocity);
            found.map(|coordinate| coordinate.name.as_str()).collect()
        };
        let base = ["base_x", "base_y", "base_z", "base_qw", "base_qx", "base_qy", "base_qz"];
        let legs = ["leg_1", "leg_2", "own"];
        assert_eq!(of(false), [base.as_slice(), &legs].concat());
        let twist = ["base_x", "base_y", "base_z", "base_wx", "base_wy", "base_wz"];
        assert_eq!(of(true), [twist.as_slice(), &legs].concat());
    }
}
