use crate::{Joint, Model, Site, World, WorldError};

/// Kinematics of a chain of joints that carries a site: pose and Jacobian at any joint vector.
///
/// It has a [`World`] of its own, whose other joints stay where the MJCF document has them.
#[derive(Debug)]
pub struct Arm {
    world: World,
    site: Site,
    joints: Vec<Joint>,
    /// Jacobian over all velocities of the model, linear rows above angular ones, row-major 6 x nv.
    full: Vec<f64>,
}

impl Arm {
    /// The chain of `joints` that carries `site`.
    ///
    /// # Errors
    /// If a name is unknown to the model.
    pub fn new(model: &Model, joints: &[&str], site: &str) -> Result<Arm, WorldError> {
        Ok(Arm {
            world: model.world(),
            site: model.site(site)?,
            joints: joints.iter().map(|name| model.joint(name)).collect::<Result<_, _>>()?,
            full: vec![0.0; 6 * model.qvel_size()],
        })
    }

    /// The joints.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// Moves the joints to `q`, rad or m.
    pub fn set(&mut self, q: &[f64]) {
        for (joint, q) in self.joints.iter().zip(q) {
            self.world.qpos_mut()[joint.qpos] = *q;
        }
        self.world.refresh();
    }

    /// Position of the site, m.
    pub fn position(&self) -> [f64; 3] {
        self.world.rows().site_position(self.site)
    }

    /// Rotation matrix of the site, row by row: takes its own axes to the world's.
    pub fn rotation(&self) -> [f64; 9] {
        self.world.rows().site_rotation(self.site)
    }

    /// Fills `out` with the site's Jacobian, row-major 6 x joints: linear velocity (m/s) above angular velocity
    /// (rad/s), both in world axes, for each joint's unit velocity.
    ///
    /// # Panics
    /// If `out` does not hold six times the number of joints.
    pub fn jacobian(&mut self, out: &mut [f64]) {
        let (columns, nv) = (self.joints.len(), self.world.model().qvel_size());
        assert_eq!(out.len(), 6 * columns, "the Jacobian has six rows of {columns}");
        self.world.data.com_pos();
        let (linear, angular) = self.full.split_at_mut(3 * nv);
        // SAFETY: both halves hold 3 nv values, the site belongs to the model, model and data belong together.
        #[allow(unsafe_code)]
        unsafe {
            mujoco_rs::mujoco_c::mj_jacSite(
                self.world.model().inner.ffi(),
                self.world.data.ffi(),
                linear.as_mut_ptr(),
                angular.as_mut_ptr(),
                self.site.0 as i32,
            );
        }
        for (row, out) in self.full.chunks(nv).zip(out.chunks_mut(columns)) {
            for (joint, value) in self.joints.iter().zip(out) {
                *value = row[joint.dof];
            }
        }
    }
}
