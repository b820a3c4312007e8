//! Facts about the elements of a model, by index: joints, ranges of actuators, sensors, keyframes.

use std::ops::Range;

use mujoco_rs::prelude::MjtTrn;
use mujoco_rs::wrappers::mj_model::MjtObjBase;

use crate::{Body, ElementKind, Joint, JointKind, Model};

impl Model {
    /// Returns the number of joints.
    pub fn joint_count(&self) -> usize {
        self.count(ElementKind::Joint)
    }

    /// Returns the joint with this index.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn joint_at(&self, index: usize) -> Joint {
        let [low, high] = self.inner.jnt_range()[index];
        Joint {
            kind: self.joint_kind(index),
            qpos: self.inner.jnt_qposadr()[index] as usize,
            dof: self.inner.jnt_dofadr()[index] as usize,
            low,
            high,
        }
    }

    /// Returns the kind of the joint with this index.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn joint_kind(&self, index: usize) -> JointKind {
        JointKind::of(self.inner.jnt_type()[index])
    }

    /// Returns whether the joint with this index has limits.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn joint_is_limited(&self, index: usize) -> bool {
        self.inner.jnt_limited()[index]
    }

    /// Returns the body that a joint moves.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn body_of_joint(&self, index: usize) -> Body {
        Body(self.inner.jnt_bodyid()[index] as usize)
    }

    /// Returns the body with this index. Body 0 is the world.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn body_at(&self, index: usize) -> Body {
        assert!(index < self.count(ElementKind::Body), "body {index} does not exist");
        Body(index)
    }

    /// Returns the body of a geom.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn body_of_geom(&self, index: usize) -> Body {
        Body(self.inner.geom_bodyid()[index] as usize)
    }

    /// Returns the body of a site.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn body_of_site(&self, index: usize) -> Body {
        Body(self.inner.site_bodyid()[index] as usize)
    }

    /// Returns the range of an actuator's control, if it is limited.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn actuator_range(&self, index: usize) -> Option<[f64; 2]> {
        self.inner.actuator_ctrllimited()[index].then(|| self.inner.actuator_ctrlrange()[index])
    }

    /// Returns the range of an actuator's force, if it is limited.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn actuator_force_range(&self, index: usize) -> Option<[f64; 2]> {
        self.inner.actuator_forcelimited()[index].then(|| self.inner.actuator_forcerange()[index])
    }

    /// Returns the index of the joint that an actuator acts on, if it acts on a joint.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn actuator_joint(&self, index: usize) -> Option<usize> {
        let kind = self.inner.actuator_trntype()[index];
        let acts_on_joint = matches!(kind, MjtTrn::mjTRN_JOINT | MjtTrn::mjTRN_JOINTINPARENT);
        acts_on_joint.then(|| self.inner.actuator_trnid()[index][0] as usize)
    }

    /// Returns whether a body is another one or a descendant of it.
    pub fn is_within(&self, body: Body, ancestor: Body) -> bool {
        let mut body = body.0;
        // A body comes after its parent.
        while body > ancestor.0 {
            body = self.inner.body_parentid()[body] as usize;
        }
        body == ancestor.0
    }

    /// Returns the index of the site at which a sensor measures, if it measures at one.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn sensor_site(&self, index: usize) -> Option<usize> {
        let is_site = self.inner.sensor_objtype()[index] == MjtObjBase::mjOBJ_SITE;
        is_site.then(|| self.inner.sensor_objid()[index] as usize)
    }

    /// Returns the numbers of a sensor in [`World::sensordata`](crate::World::sensordata).
    ///
    /// # Panics
    /// If the index is too large.
    pub fn sensor(&self, index: usize) -> Range<usize> {
        let first = self.inner.sensor_adr()[index] as usize;
        first..first + self.inner.sensor_dim()[index] as usize
    }

    /// Returns the generalized positions of the document's initial state.
    pub fn qpos0(&self) -> &[f64] {
        self.inner.qpos0()
    }

    /// Returns the generalized positions of a keyframe.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn key_qpos(&self, index: usize) -> &[f64] {
        let size = self.qpos_size();
        &self.inner.key_qpos()[index * size..][..size]
    }

    /// Returns the generalized velocities of a keyframe.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn key_qvel(&self, index: usize) -> &[f64] {
        let size = self.qvel_size();
        &self.inner.key_qvel()[index * size..][..size]
    }

    /// Returns the controls of a keyframe.
    ///
    /// # Panics
    /// If the index is too large.
    pub fn key_ctrl(&self, index: usize) -> &[f64] {
        let size = self.actuators();
        &self.inner.key_ctrl()[index * size..][..size]
    }
}
