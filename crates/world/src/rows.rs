use mujoco_rs::prelude::MjtJoint;

use crate::frame::{add, cross, rotate, scale, sub};
use crate::{Body, Equality, Flex, Joint, Model, Site};

/// A read-only view of a world for tasks: the state and the quantities computed from it.
///
/// Poses and twists are those of the last [`World::refresh`](crate::World::refresh).
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    /// Generalized positions.
    pub qpos: &'a [f64],
    /// Generalized velocities.
    pub qvel: &'a [f64],
    /// Controls.
    pub ctrl: &'a [f64],
    /// Whether each equality constraint is active.
    pub active: &'a [bool],
    pub(crate) body_positions: &'a [[f64; 3]],
    pub(crate) body_quaternions: &'a [[f64; 4]],
    pub(crate) site_positions: &'a [[f64; 3]],
    pub(crate) site_rotations: &'a [[f64; 9]],
    pub(crate) joint_anchors: &'a [[f64; 3]],
    pub(crate) joint_axes: &'a [[f64; 3]],
    pub(crate) tree: Tree<'a>,
}

/// The kinematic tree: the parent and the joints of each body.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tree<'a> {
    pub parents: &'a [i32],
    pub first_joints: &'a [i32],
    pub joint_counts: &'a [i32],
    pub joint_kinds: &'a [MjtJoint],
    pub joint_dofs: &'a [i32],
}

impl Tree<'_> {
    /// Returns the tree of a model.
    pub(crate) fn of(model: &Model) -> Tree<'_> {
        Tree {
            parents: model.inner.body_parentid(),
            first_joints: model.inner.body_jntadr(),
            joint_counts: model.inner.body_jntnum(),
            joint_kinds: model.inner.jnt_type(),
            joint_dofs: model.inner.jnt_dofadr(),
        }
    }
}

impl Rows<'_> {
    /// Returns the origin of a body's frame, m.
    pub fn position(&self, body: Body) -> [f64; 3] {
        self.body_positions[body.0]
    }

    /// Returns the orientation of a body: the rotation from the body's axes to world axes.
    pub fn quaternion(&self, body: Body) -> [f64; 4] {
        self.body_quaternions[body.0]
    }

    /// Returns the linear (m/s) and angular (rad/s) velocity of a body's frame, both in world axes:
    /// the sum of the contributions of all joints between the body and the world.
    ///
    /// A mocap body has velocity 0.
    pub fn twist(&self, body: Body) -> ([f64; 3], [f64; 3]) {
        let point = self.position(body);
        let mut linear = [0.0; 3];
        let mut angular = [0.0; 3];
        let mut at = body.0;
        while at > 0 {
            let first = self.tree.first_joints[at];
            for joint in (first..first + self.tree.joint_counts[at]).map(|joint| joint as usize) {
                let dof = self.tree.joint_dofs[joint] as usize;
                let axis = self.joint_axes[joint];
                let anchor = self.joint_anchors[joint];
                let (v, w) = match self.tree.joint_kinds[joint] {
                    MjtJoint::mjJNT_SLIDE => (scale(axis, self.qvel[dof]), [0.0; 3]),
                    MjtJoint::mjJNT_HINGE => ([0.0; 3], scale(axis, self.qvel[dof])),
                    MjtJoint::mjJNT_FREE => {
                        let v = [self.qvel[dof], self.qvel[dof + 1], self.qvel[dof + 2]];
                        let w = [self.qvel[dof + 3], self.qvel[dof + 4], self.qvel[dof + 5]];
                        (v, rotate(self.body_quaternions[at], w))
                    }
                    MjtJoint::mjJNT_BALL => {
                        let w = [self.qvel[dof], self.qvel[dof + 1], self.qvel[dof + 2]];
                        ([0.0; 3], rotate(self.body_quaternions[at], w))
                    }
                };
                linear = add(linear, add(v, cross(w, sub(point, anchor))));
                angular = add(angular, w);
            }
            at = self.tree.parents[at] as usize;
        }
        (linear, angular)
    }

    /// Returns whether an equality constraint is active.
    pub fn is_active(&self, equality: Equality) -> bool {
        self.active[equality.0]
    }

    /// Returns the position of a site, m.
    pub fn site_position(&self, site: Site) -> [f64; 3] {
        self.site_positions[site.0]
    }

    /// Returns the rotation matrix of a site, row-major: it maps the site's axes to world axes.
    pub fn site_rotation(&self, site: Site) -> [f64; 9] {
        self.site_rotations[site.0]
    }

    /// Returns the positions of a flex's vertices, m.
    pub fn vertices(&self, flex: Flex) -> &[[f64; 3]] {
        &self.body_positions[flex.body..][..flex.vertices]
    }

    /// Returns the velocities of a flex's vertices, m/s.
    pub fn vertex_velocities(&self, flex: Flex) -> &[[f64; 3]] {
        self.qvel[flex.dof..][..3 * flex.vertices].as_chunks().0
    }

    /// Returns the position of a free body, m.
    pub fn free_position(&self, joint: Joint) -> [f64; 3] {
        [self.qpos[joint.qpos], self.qpos[joint.qpos + 1], self.qpos[joint.qpos + 2]]
    }

    /// Returns the linear velocity of a free body in world axes, m/s.
    pub fn free_velocity(&self, joint: Joint) -> [f64; 3] {
        [self.qvel[joint.dof], self.qvel[joint.dof + 1], self.qvel[joint.dof + 2]]
    }

    /// Returns the angular velocity of a free body in world axes, rad/s. (MuJoCo stores it in body
    /// axes.)
    pub fn free_angular_velocity(&self, joint: Joint) -> [f64; 3] {
        let quaternion = [3, 4, 5, 6].map(|i| self.qpos[joint.qpos + i]);
        rotate(quaternion, [3, 4, 5].map(|i| self.qvel[joint.dof + i]))
    }
}
