//! Quantities that MuJoCo computes from the state: sensors, forces, poses of geoms.
//!
//! After a [`step`](World::step), all of them are of its start. [`refresh`](World::refresh) computes
//! the poses of bodies, geoms and sites and the centers of mass of single bodies;
//! [`refresh_sensors`](World::refresh_sensors) computes everything.

use crate::{Body, World};

impl World {
    /// Computes all quantities of the current state: poses, contacts, forces under the current
    /// controls, and sensors. The state does not change, and neither do the bits of later steps.
    pub fn refresh_sensors(&mut self) {
        self.data.forward();
    }

    /// Returns the data of all sensors; [`Model::sensor`](crate::Model::sensor) says where those of
    /// one are. They are of the start of the last step, or of the last
    /// [`refresh_sensors`](Self::refresh_sensors).
    pub fn sensordata(&self) -> &[f64] {
        self.data.sensordata()
    }

    /// Returns the forces of all actuators, N or N m, at the start of the last step or at the last
    /// [`refresh_sensors`](Self::refresh_sensors).
    pub fn actuator_forces(&self) -> &[f64] {
        self.data.actuator_force()
    }

    /// Returns the generalized forces of gravity, Coriolis and centrifugal effects, N or N m, at
    /// the start of the last step or at the last [`refresh_sensors`](Self::refresh_sensors).
    pub fn bias_forces(&self) -> &[f64] {
        self.data.qfrc_bias()
    }

    /// Computes the external forces on bodies from the contacts and constraints of the start of the
    /// last step, or of the last [`refresh_sensors`](Self::refresh_sensors). Neither the state nor
    /// the bits of later steps change.
    pub fn refresh_external_forces(&mut self) {
        self.data.rne_post_constraint();
    }

    /// Returns the external torque and force on a body, N m and N, about the center of mass of its
    /// tree: MuJoCo's `cfrc_ext` of the last
    /// [`refresh_external_forces`](Self::refresh_external_forces).
    pub fn external_force(&self, body: Body) -> [f64; 6] {
        self.data.cfrc_ext()[body.0]
    }

    /// Writes the joint-space inertia matrix, row-major, a row and a column for each generalized
    /// velocity. It is of the start of the last step or of the last
    /// [`refresh_sensors`](Self::refresh_sensors).
    ///
    /// # Panics
    /// If the length of `out` is not the square of the number of generalized velocities.
    pub fn inertia_matrix(&self, out: &mut [f64]) {
        let size = self.model().qvel_size();
        assert_eq!(out.len(), size * size, "the inertia matrix has {size} rows and columns");
        // The length is checked, and the wrapper has no other error.
        let _ = self.data.full_m(out);
    }

    /// Returns the position of a geom, m, at the last [`refresh`](Self::refresh).
    ///
    /// # Panics
    /// If the index is too large.
    pub fn geom_position(&self, index: usize) -> [f64; 3] {
        self.data.geom_xpos()[index]
    }

    /// Returns the rotation matrix of a body, row-major, at the last [`refresh`](Self::refresh): it
    /// maps the body's axes to world axes.
    pub fn body_rotation(&self, body: Body) -> [f64; 9] {
        self.data.xmat()[body.0]
    }

    /// Returns the center of mass of a body without its children, m, at the last
    /// [`refresh`](Self::refresh).
    pub fn body_inertial_position(&self, body: Body) -> [f64; 3] {
        self.data.xipos()[body.0]
    }

    /// Returns the center of mass of a body and its descendants, m, at the start of the last
    /// step or at the last [`refresh_sensors`](Self::refresh_sensors).
    pub fn subtree_com(&self, body: Body) -> [f64; 3] {
        self.data.subtree_com()[body.0]
    }

    /// Calls `f` with the magnitude of the force at each contact point of a geom, N, in the order
    /// of MuJoCo's list. A point without force counts as 0 N. The forces are those of the last step
    /// or of the last [`refresh_sensors`](Self::refresh_sensors).
    pub fn contact_forces_of_geom(&self, geom: usize, f: &mut dyn FnMut(f64)) {
        self.visit_contacts(|other| other == geom, f);
    }

    /// As [`contact_forces_of_geom`](Self::contact_forces_of_geom), for all geoms of a body.
    pub fn contact_forces_of_body(&self, body: Body, f: &mut dyn FnMut(f64)) {
        let bodies = self.model().inner.geom_bodyid();
        self.visit_contacts(|geom| bodies[geom] as usize == body.0, f);
    }

    fn visit_contacts(&self, is_part: impl Fn(usize) -> bool, f: &mut dyn FnMut(f64)) {
        for (index, contact) in self.data.contact().iter().enumerate() {
            // A side that is a flex has a negative geom.
            let takes_part = contact.geom.iter().any(|geom| usize::try_from(*geom).is_ok_and(&is_part));
            if takes_part && let Ok([x, y, z, ..]) = self.data.try_contact_force(index) {
                f(crate::frame::norm([x, y, z]));
            }
        }
    }
}
