//! The same model under other settings of MuJoCo's solver, and a start that is moved by a little.

use std::sync::Arc;

use mujoco_rs::prelude::*;

use crate::{JointKind, Model, World};

impl Model {
    /// Returns a copy of this model with the other collision detection of convex shapes: MuJoCo's
    /// native one instead of libccd, or libccd instead of the native one. Pairs of shapes for which
    /// MuJoCo has a function of their own, such as two boxes, do not change.
    pub fn with_other_collider(&self) -> Model {
        let mut inner = (*self.inner).clone();
        inner.opt_mut().disableflags ^= MjtDisableBit::mjDSBL_NATIVECCD as i32;
        Model { inner: Arc::new(inner), ..self.clone() }
    }
}

impl World {
    /// Moves all joints by `offset` in alternating directions: the first coordinate by `offset`,
    /// the second one by `-offset`, and so on. A hinge (rad) and a slide joint (m) have one
    /// coordinate, a free joint has three (m). Orientations of free and ball joints stay.
    pub fn move_joints(&mut self, offset: f64) {
        let mut sign = 1.0;
        for index in 0..self.model().joint_count() {
            let joint = self.model().joint_at(index);
            let coordinates = match joint.kind {
                JointKind::Free => 3,
                JointKind::Ball => 0,
                JointKind::Slide | JointKind::Hinge => 1,
            };
            for position in &mut self.qpos_mut()[joint.qpos..][..coordinates] {
                *position += sign * offset;
                sign = -sign;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]

    use super::*;

    #[test]
    fn joints_move_in_turn_and_orientations_stay() {
        let xml = r#"<mujoco><worldbody>
            <body><joint type="hinge"/><geom size="0.1"/></body>
            <body><freejoint/><geom size="0.1"/></body>
            <body><joint type="ball"/><geom size="0.1"/></body>
            <body><joint type="slide"/><geom size="0.1"/></body></worldbody></mujoco>"#;
        let mut world = Model::from_xml(xml).unwrap().world();
        world.reset();
        let before = world.qpos().to_vec();
        world.move_joints(0.5);
        let moved: Vec<f64> = world.qpos().iter().zip(&before).map(|(now, before)| now - before).collect();
        assert_eq!(moved, [0.5, -0.5, 0.5, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5]);
    }

    #[test]
    fn the_other_collider_gives_a_close_contact_with_other_bits_and_twice_the_same() {
        // MuJoCo has no function of its own for an ellipsoid on a box.
        let xml = r#"<mujoco><worldbody><geom type="box" size="1 1 0.1"/>
            <body pos="0 0 0.2" euler="20 30 0"><freejoint/><geom type="ellipsoid" size="0.1 0.05 0.08"/></body>
            </worldbody></mujoco>"#;
        let model = Model::from_xml(xml).unwrap();
        let height = |model: &Model| {
            let mut world = model.world();
            world.reset();
            // It falls for 0.1 s.
            (0..100).for_each(|_| world.step());
            world.qpos()[2]
        };
        let [plain, other] = [height(&model), height(&model.with_other_collider())];
        assert!(plain != other && (plain - other).abs() < 1e-3, "{plain} {other}");
        assert_eq!(plain.to_bits(), height(&model.with_other_collider().with_other_collider()).to_bits());
    }
}
