use std::sync::Arc;

use mujoco_rs::prelude::*;

use crate::frame::{add, inverse, multiply, rotate, sub};
use crate::model::INTEGRATION;
use crate::rows::Tree;
use crate::{Actuator, Body, Equality, Joint, Mocap, Model, Rows};

/// A simulation of a [`Model`] on one thread.
///
/// Positions, velocities and controls are those of the current state. Poses and twists are updated
/// by [`refresh`](Self::refresh): after a step, MuJoCo's poses are those of the start of the step.
#[derive(Debug)]
pub struct World {
    pub(crate) data: MjData<Arc<MjModel>>,
    model: Model,
}

impl World {
    pub(crate) fn new(model: Model) -> World {
        World { data: MjData::new(model.inner.clone()), model }
    }

    /// Returns the model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Continues with another model: a [changed](Model::changed) copy of the same document. The
    /// state stays; what follows from it and the model is that of the old model until the next
    /// step, [`refresh`](Self::refresh) or [`reset`](Self::reset).
    ///
    /// # Panics
    /// If the model was compiled from another document.
    pub fn set_model(&mut self, model: &Model) {
        if Arc::ptr_eq(&self.model.inner, &model.inner) {
            return;
        }
        assert!(Arc::ptr_eq(&self.model.document, &model.document), "the models are of two documents");
        // SAFETY: copies of one compiled model have the same sizes, indices and addresses. Changes
        // write physical parameters only.
        #[allow(unsafe_code)]
        unsafe {
            self.data.swap_model_unchecked(model.inner.clone());
        }
        self.model = model.clone();
    }

    /// Resets the state to that of the MJCF document, at rest.
    pub fn reset(&mut self) {
        self.data.reset();
    }

    /// Sets the state.
    ///
    /// # Panics
    /// If `row` is shorter than [`Model::state_size`].
    pub fn set_state(&mut self, row: &[f64]) {
        assert!(row.len() >= self.model.state_size, "the state has {} values, which is too few", row.len());
        // SAFETY: the row is long enough (checked above), and the data belong to the model. The
        // wrapper's own method is avoided because it recomputes the length of the state in every
        // call.
        #[allow(unsafe_code)]
        unsafe {
            mujoco_rs::mujoco_c::mj_setState(
                self.model.inner.ffi(),
                self.data.ffi_mut(),
                row.as_ptr(),
                INTEGRATION as i32,
            );
        }
    }

    /// Copies the state into `row`.
    ///
    /// # Panics
    /// If `row` is shorter than [`Model::state_size`].
    pub fn read_state(&self, row: &mut [f64]) {
        assert!(row.len() >= self.model.state_size, "the state has {} values, which is too few", row.len());
        // SAFETY: as in `set_state`.
        #[allow(unsafe_code)]
        unsafe {
            mujoco_rs::mujoco_c::mj_getState(
                self.model.inner.ffi(),
                self.data.ffi(),
                row.as_mut_ptr(),
                INTEGRATION as i32,
            );
        }
    }

    /// Advances the state by one physics step.
    pub fn step(&mut self) {
        self.data.step();
    }

    /// Computes poses from positions (forward kinematics).
    pub fn refresh(&mut self) {
        self.data.kinematics();
    }

    /// Returns whether the simulation has diverged since the last call: a number is not finite or
    /// exceeds MuJoCo's limit. Resets the world if it has.
    ///
    /// MuJoCo checks positions and velocities at the start of a step, so those after the last step
    /// are checked here.
    pub fn take_divergence(&mut self) -> bool {
        const BAD: [usize; 4] = [
            MjtWarning::mjWARN_BADQPOS as usize,
            MjtWarning::mjWARN_BADQVEL as usize,
            MjtWarning::mjWARN_BADQACC as usize,
            MjtWarning::mjWARN_BADCTRL as usize,
        ];
        let in_range =
            |values: &[f64]| values.iter().all(|value| value.abs() < mujoco_rs::mujoco_c::mjMAXVAL);
        let has_no_warning = BAD.iter().all(|&kind| self.data.warning()[kind].number == 0);
        if has_no_warning && in_range(self.qpos()) && in_range(self.qvel()) {
            return false;
        }
        self.data.reset();
        true
    }

    /// Returns the generalized positions.
    pub fn qpos(&self) -> &[f64] {
        self.data.qpos()
    }

    /// Returns the generalized positions for writing.
    pub fn qpos_mut(&mut self) -> &mut [f64] {
        self.data.qpos_mut()
    }

    /// Returns the generalized velocities.
    pub fn qvel(&self) -> &[f64] {
        self.data.qvel()
    }

    /// Returns the generalized velocities for writing.
    pub fn qvel_mut(&mut self) -> &mut [f64] {
        self.data.qvel_mut()
    }

    /// Returns the controls, one per actuator.
    pub fn ctrl(&self) -> &[f64] {
        self.data.ctrl()
    }

    /// Returns the controls for writing. They must be finite.
    pub fn ctrl_mut(&mut self) -> &mut [f64] {
        self.data.ctrl_mut()
    }

    /// Returns the force of an actuator in the last step, N or N m.
    pub fn actuator_force(&self, actuator: Actuator) -> f64 {
        self.data.actuator_force()[actuator.0]
    }

    /// Returns the force that a position servo demanded in the last step before its limit, N or
    /// N m: that of its gains, of its control, and of the position and the velocity at the start of
    /// the step.
    pub fn servo_demand(&self, actuator: Actuator) -> f64 {
        let index = actuator.0;
        let (kp, kv) = self.model().servo_gains(index);
        let data = &self.data;
        kp * (data.ctrl()[index] - data.actuator_length()[index]) - kv * data.actuator_velocity()[index]
    }

    /// Returns a view of the state and the quantities computed from it.
    pub fn rows(&self) -> Rows<'_> {
        Rows {
            qpos: self.data.qpos(),
            qvel: self.data.qvel(),
            ctrl: self.data.ctrl(),
            active: self.data.eq_active(),
            body_positions: self.data.xpos(),
            body_quaternions: self.data.xquat(),
            site_positions: self.data.site_xpos(),
            site_rotations: self.data.site_xmat(),
            joint_anchors: self.data.xanchor(),
            joint_axes: self.data.xaxis(),
            tree: Tree::of(&self.model),
        }
    }

    /// Sets the pose of a mocap body.
    pub fn place(&mut self, mocap: Mocap, position: [f64; 3], quaternion: [f64; 4]) {
        self.data.mocap_pos_mut()[mocap.0] = position;
        self.data.mocap_quat_mut()[mocap.0] = quaternion;
    }

    /// Sets the poses of the mocap bodies: position (m) and quaternion of each.
    pub fn place_all(&mut self, poses: &[f64]) {
        for (index, pose) in poses.as_chunks::<7>().0.iter().enumerate() {
            let [x, y, z, quaternion @ ..] = *pose;
            self.place(Mocap(index), [x, y, z], quaternion);
        }
    }

    /// Returns the positions and quaternions of all mocap bodies.
    pub fn mocap_poses(&self) -> (&[[f64; 3]], &[[f64; 4]]) {
        (self.data.mocap_pos(), self.data.mocap_quat())
    }

    /// Writes position (m) and quaternion of each mocap body, as [`place_all`](Self::place_all)
    /// takes them.
    pub fn write_mocap_poses(&self, poses: &mut [f64]) {
        let (positions, quaternions) = self.mocap_poses();
        let own = poses.as_chunks_mut::<7>().0.iter_mut().zip(positions).zip(quaternions);
        for ((pose, position), quaternion) in own {
            pose[..3].copy_from_slice(position);
            pose[3..].copy_from_slice(quaternion);
        }
    }

    /// Moves a mocap body by `offset`, m.
    pub fn shift(&mut self, mocap: Mocap, offset: [f64; 3]) {
        let position = &mut self.data.mocap_pos_mut()[mocap.0];
        *position = add(*position, offset);
    }

    /// Applies a force (N, world axes) to a body's center of mass in all following steps, until it
    /// is replaced. The force is part of the state.
    pub fn push(&mut self, body: Body, force: [f64; 3]) {
        self.data.xfrc_applied_mut()[body.0][..3].copy_from_slice(&force);
    }

    /// Sets the pose of a free body and its velocity to 0.
    pub fn place_free(&mut self, joint: Joint, position: [f64; 3], quaternion: [f64; 4]) {
        let qpos = &mut self.data.qpos_mut()[joint.qpos..][..7];
        qpos[..3].copy_from_slice(&position);
        qpos[3..].copy_from_slice(&quaternion);
        self.data.qvel_mut()[joint.dof..][..6].fill(0.0);
    }

    /// Returns position and quaternion of a body, as [`refresh`](Self::refresh) last computed them.
    pub fn pose(&self, body: Body) -> ([f64; 3], [f64; 4]) {
        let rows = self.rows();
        (rows.position(body), rows.quaternion(body))
    }

    /// Moves bodies as if they were fixed to a body that went from the pose `from` to `to`: those
    /// with a free joint, and points with three slides along the axes of the world. The poses of
    /// the last [`refresh`](Self::refresh) are theirs.
    pub fn carry(&mut self, bodies: &[Body], from: ([f64; 3], [f64; 4]), to: ([f64; 3], [f64; 4])) {
        let turn = multiply(to.1, inverse(from.1));
        let inner = self.model.inner.clone();
        for body in bodies {
            let (position, quaternion) = self.pose(*body);
            let moved = add(to.0, rotate(turn, sub(position, from.0)));
            let Ok(first) = usize::try_from(inner.body_jntadr()[body.0]) else { continue };
            let qpos = inner.jnt_qposadr()[first] as usize;
            if inner.jnt_type()[first] == MjtJoint::mjJNT_FREE {
                let qpos = &mut self.data.qpos_mut()[qpos..][..7];
                qpos[..3].copy_from_slice(&moved);
                qpos[3..].copy_from_slice(&multiply(turn, quaternion));
            } else {
                let way = sub(moved, position);
                self.data.qpos_mut()[qpos..][..3].iter_mut().zip(way).for_each(|(q, way)| *q += way);
            }
        }
    }

    /// Switches an equality constraint on or off.
    pub fn switch(&mut self, equality: Equality, on: bool) {
        self.data.eq_active_mut()[equality.0] = on;
    }

    /// Switches each equality constraint on or off.
    pub fn set_active(&mut self, active: &[bool]) {
        self.data.eq_active_mut().copy_from_slice(active);
    }

    /// Returns whether each equality constraint is active.
    pub fn active(&self) -> &[bool] {
        self.data.eq_active()
    }

    /// Switches all equality constraints on or off, except the edge constraints of flexes, which
    /// hold a cloth together.
    pub fn switch_all(&mut self, on: bool) {
        switch(&self.model, self.data.eq_active_mut(), on);
    }

    /// Returns the maximum penetration depth of all contacts, m; 0 without contacts.
    pub fn penetration(&self) -> f64 {
        self.data.contact().iter().map(|contact| -contact.dist).fold(0.0, f64::max)
    }
}

impl Model {
    /// Switches off all equality constraints in `active`, except the edge constraints of flexes,
    /// which hold a cloth together.
    pub fn release(&self, active: &mut [bool]) {
        switch(self, active, false);
    }

    /// Returns whether an equality constraint in `active` is on, except the edge constraints of
    /// flexes.
    pub fn holds(&self, active: &[bool]) -> bool {
        let attaches = |(active, kind): (&bool, &MjtEq)| *active && *kind != MjtEq::mjEQ_FLEX;
        active.iter().zip(self.inner.eq_type()).any(attaches)
    }
}

fn switch(model: &Model, active: &mut [bool], on: bool) {
    for (active, kind) in active.iter_mut().zip(model.inner.eq_type()) {
        if *kind != MjtEq::mjEQ_FLEX {
            *active = on;
        }
    }
}
