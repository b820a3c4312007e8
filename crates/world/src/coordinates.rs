//! Named coordinates of a model: joint positions and velocities.

use mujoco_rs::prelude::{MjtJoint, MjtObjBase};

use crate::Model;

/// A number of the state with its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Coordinate {
    /// Name of the joint; for a free or ball joint with the axis, such as `cup_x`. Quaternions are
    /// `_qw`, `_qx`, `_qy`, `_qz`.
    pub name: String,
    /// Unit: `m` or `rad`, of a velocity `m/s` or `rad/s`, empty for a quaternion.
    pub unit: &'static str,
    /// Index into the generalized positions or velocities.
    pub index: usize,
    /// Whether it is a velocity.
    pub is_velocity: bool,
}

impl Model {
    /// Returns the positions of all joints with a name, then their velocities. Vertices of flexes
    /// have no names.
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
        let (mut positions, mut velocities) = (Vec::new(), Vec::new());
        for (joint, kind) in self.inner.jnt_type().iter().enumerate() {
            let Some(name) =
                self.inner.id_to_name(MjtObjBase::mjOBJ_JOINT, joint).filter(|name| !name.is_empty())
            else {
                continue;
            };
            let (qpos, dof) =
                (self.inner.jnt_qposadr()[joint] as usize, self.inner.jnt_dofadr()[joint] as usize);
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
}
