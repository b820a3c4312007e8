use crate::{Joint, Model, Site, World, WorldError};

/// The forward kinematics of a chain of joints that ends at a site: pose and Jacobian for any joint
/// vector.
///
/// It has its own [`World`], whose other joints keep the positions of the MJCF document.
#[derive(Debug)]
pub struct Arm {
    world: World,
    site: Site,
    joints: Vec<Joint>,
    /// The Jacobian for all velocities of the model, row-major 6 x nv, with the linear rows above
    /// the angular rows.
    full: Vec<f64>,
}

impl Arm {
    /// Creates the kinematics of the chain of `joints` that ends at `site`.
    ///
    /// # Errors
    /// If the model has no element with one of the names.
    pub fn new(model: &Model, joints: &[&str], site: &str) -> Result<Arm, WorldError> {
        Ok(Arm {
            world: model.world(),
            site: model.site(site)?,
            joints: joints.iter().map(|name| model.joint(name)).collect::<Result<_, _>>()?,
            full: vec![0.0; 6 * model.qvel_size()],
        })
    }

    /// Returns the joints.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// Sets the joint positions to `q`, rad or m.
    pub fn set(&mut self, q: &[f64]) {
        for (joint, q) in self.joints.iter().zip(q) {
            self.world.qpos_mut()[joint.qpos] = *q;
        }
        self.world.refresh();
    }

    /// Returns the position of the site, m.
    pub fn position(&self) -> [f64; 3] {
        self.world.rows().site_position(self.site)
    }

    /// Returns the rotation matrix of the site, row-major: it maps the site's axes to world axes.
    pub fn rotation(&self) -> [f64; 9] {
        self.world.rows().site_rotation(self.site)
    }

    /// Computes the site's Jacobian into `out`, row-major 6 x joints: linear velocity (m/s) above
    /// angular velocity (rad/s), both in world axes, per unit joint velocity.
    ///
    /// # Panics
    /// If the length of `out` is not six times the number of joints.
    pub fn jacobian(&mut self, out: &mut [f64]) {
        let columns = self.joints.len();
        let nv = self.world.model().qvel_size();
        assert_eq!(out.len(), 6 * columns, "the Jacobian has 6 rows and {columns} columns");
        self.world.data.com_pos();
        let (linear, angular) = self.full.split_at_mut(3 * nv);
        // SAFETY: both halves have 3 nv elements, the site belongs to the model, and the data
        // belong to the model.
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
