use crate::frame::{add, cross, sub};
use crate::{Body, Joint, Site};

/// The state of a world and what follows from it, as plain rows of numbers: all that a task may look at.
///
/// Poses are those of the last [`World::refresh`](crate::World::refresh), twists those of the last
/// [`World::refresh_twists`](crate::World::refresh_twists).
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    /// Generalised positions.
    pub qpos: &'a [f64],
    /// Generalised velocities.
    pub qvel: &'a [f64],
    /// Controls.
    pub ctrl: &'a [f64],
    pub(crate) body_positions: &'a [[f64; 3]],
    pub(crate) body_quaternions: &'a [[f64; 4]],
    pub(crate) site_positions: &'a [[f64; 3]],
    pub(crate) site_rotations: &'a [[f64; 9]],
    /// Angular and linear velocity of each body, the latter at the centre of mass of its tree.
    pub(crate) body_velocities: &'a [[f64; 6]],
    pub(crate) centers: &'a [[f64; 3]],
    pub(crate) roots: &'a [i32],
}

impl Rows<'_> {
    /// Origin of a body's frame, m.
    pub fn position(&self, body: Body) -> [f64; 3] {
        self.body_positions[body.0]
    }

    /// Orientation of a body: takes its own axes to the world's.
    pub fn quaternion(&self, body: Body) -> [f64; 4] {
        self.body_quaternions[body.0]
    }

    /// Linear (m/s) and angular (rad/s) velocity of a body's frame, both in world axes.
    pub fn twist(&self, body: Body) -> ([f64; 3], [f64; 3]) {
        let [a, b, c, x, y, z] = self.body_velocities[body.0];
        let angular = [a, b, c];
        let arm = sub(self.position(body), self.centers[self.roots[body.0] as usize]);
        (add([x, y, z], cross(angular, arm)), angular)
    }

    /// Position of a site, m.
    pub fn site_position(&self, site: Site) -> [f64; 3] {
        self.site_positions[site.0]
    }

    /// Rotation matrix of a site, row by row: takes its own axes to the world's.
    pub fn site_rotation(&self, site: Site) -> [f64; 9] {
        self.site_rotations[site.0]
    }

    /// Position of a free body, m.
    pub fn free_position(&self, joint: Joint) -> [f64; 3] {
        [self.qpos[joint.qpos], self.qpos[joint.qpos + 1], self.qpos[joint.qpos + 2]]
    }

    /// Linear velocity of a free body, world axes, m/s.
    pub fn free_velocity(&self, joint: Joint) -> [f64; 3] {
        [self.qvel[joint.dof], self.qvel[joint.dof + 1], self.qvel[joint.dof + 2]]
    }

    /// Angular velocity of a free body, its own axes, rad/s.
    pub fn free_angular_velocity(&self, joint: Joint) -> [f64; 3] {
        [self.qvel[joint.dof + 3], self.qvel[joint.dof + 4], self.qvel[joint.dof + 5]]
    }
}
