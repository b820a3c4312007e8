//! The robot in a model that does not name it: the trees of bodies that actuators move.

use mujoco_rs::prelude::MjtTrn;

use crate::{Body, Model};

impl Model {
    /// Returns the top-level bodies of the trees that actuators move, in ascending order. Without
    /// such a tree they are those of all trees with joints, and without joints the world.
    pub(crate) fn robot_roots(&self) -> Vec<usize> {
        let model = &*self.inner;
        let root = |body: usize| model.body_rootid()[body] as usize;
        let actuated = (0..self.actuators()).filter_map(|actuator| {
            let id = usize::try_from(model.actuator_trnid()[actuator][0]).ok()?;
            let body = match model.actuator_trntype()[actuator] {
                MjtTrn::mjTRN_JOINT | MjtTrn::mjTRN_JOINTINPARENT => model.jnt_bodyid()[id] as usize,
                MjtTrn::mjTRN_SITE | MjtTrn::mjTRN_SLIDERCRANK => model.site_bodyid()[id] as usize,
                MjtTrn::mjTRN_BODY => id,
                _ => return None,
            };
            (body > 0).then(|| root(body))
        });
        let mut roots: Vec<usize> = actuated.collect();
        if roots.is_empty() {
            roots.extend(model.jnt_bodyid().iter().map(|body| root(*body as usize)));
        }
        if roots.is_empty() {
            roots.push(0);
        }
        roots.sort_unstable();
        roots.dedup();
        roots
    }

    /// Returns the bodies of the robot: those of the trees that actuators move, or all that move
    /// without actuators.
    pub fn robot_bodies(&self) -> Vec<Body> {
        let roots = self.robot_roots();
        let is_part = |body: &usize| roots.contains(&(self.inner.body_rootid()[*body] as usize));
        (1..self.inner.nbody() as usize).filter(is_part).map(Body).collect()
    }

    /// Returns the body that a camera follows: the first one of the robot with a free joint, or the
    /// last one of the longest chain of joints.
    pub fn followed_body(&self) -> Body {
        use mujoco_rs::prelude::MjtJoint;
        let model = &*self.inner;
        let roots = self.robot_roots();
        let is_part = |body: usize| roots.contains(&(model.body_rootid()[body] as usize));
        let free = model.jnt_type().iter().zip(model.jnt_bodyid()).find_map(|(kind, body)| {
            (*kind == MjtJoint::mjJNT_FREE && is_part(*body as usize)).then_some(*body as usize)
        });
        if let Some(body) = free {
            return Body(body);
        }
        // A body comes after its parent.
        let mut joints = vec![0; model.nbody() as usize];
        for body in 1..joints.len() {
            joints[body] = joints[model.body_parentid()[body] as usize] + model.body_jntnum()[body];
        }
        let bodies = (0..joints.len()).filter(|body| is_part(*body));
        Body(bodies.rev().max_by_key(|body| joints[*body]).unwrap_or_default())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::PANDA;

    fn facts(xml: &str) -> (Vec<String>, String) {
        let model = Model::from_xml(xml).unwrap();
        let name = |body: usize| model.names(crate::ElementKind::Body)[body].clone();
        (model.robot_roots().into_iter().map(name).collect(), name(model.followed_body().0))
    }

    #[test]
    fn the_robot_is_what_actuators_move() {
        let arm = r#"<mujoco><worldbody>
            <body name="cube"><freejoint/><geom size="1"/></body>
            <body name="table" pos="5 0 0">
              <body name="upper"><joint name="a"/><geom size="1"/>
                <body name="lower"><joint name="b"/><geom size="1"/>
                  <body name="tool"><geom size="1"/></body></body></body>
              <body name="lamp"><joint name="c"/><geom size="1"/></body></body>
            </worldbody><actuator><motor joint="b"/></actuator></mujoco>"#;
        assert_eq!(facts(arm), (vec!["table".to_string()], "lower".to_string()));
        // A quadrotor has thrusters at sites.
        let flying = r#"<mujoco><worldbody><body name="gate"><joint/><geom size="1"/></body>
            <body name="frame"><freejoint/><geom size="1"/><site name="rotor"/>
              <body name="camera"><joint/><geom size="1"/></body></body>
            </worldbody><actuator><general site="rotor" gear="0 0 1 0 0 0"/></actuator></mujoco>"#;
        assert_eq!(facts(flying), (vec!["frame".to_string()], "frame".to_string()));
        let passive = r#"<mujoco><worldbody><body name="one"><joint/><geom size="1"/></body>
            <body name="two"><joint/><geom size="1"/></body></worldbody></mujoco>"#;
        assert_eq!(facts(passive), (vec!["one".to_string(), "two".to_string()], "one".to_string()));
        assert_eq!(facts("<mujoco/>"), (vec!["world".to_string()], "world".to_string()));
        assert_eq!(facts(PANDA).0, ["link0"]);
    }
}
