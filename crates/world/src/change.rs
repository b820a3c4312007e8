//! Copies of a model with changed physical parameters.

use std::sync::Arc;

use mujoco_rs::prelude::*;

use crate::{Actuator, Body, Joint, Model};

/// A change of a model's physical parameters.
#[derive(Clone, Debug, PartialEq)]
pub enum Change {
    /// Multiplies the sliding friction of every contact.
    Friction(f64),
    /// Multiplies the mass and inertia of these bodies.
    Mass(Vec<Body>, f64),
    /// Adds viscous damping to these joints, N m s/rad or N s/m.
    Damping(Vec<Joint>, f64),
    /// Multiplies the stiffness and damping of these position servos, so that their ratio is unchanged.
    Gain(Vec<Actuator>, f64),
}

impl Model {
    /// Returns a copy of this model with these changes. Quantities that MuJoCo derives from masses are recomputed.
    ///
    /// # Example
    /// ```
    /// use mishandle_world::{Change, Model};
    /// let xml = r#"<mujoco><worldbody><body name="ball"><freejoint/><geom size="0.1" mass="2"/></body></worldbody></mujoco>"#;
    /// let model = Model::from_xml(xml)?;
    /// let ball = model.body("ball")?;
    /// let heavy = model.changed(&[Change::Mass(vec![ball], 2.0)]);
    /// assert_eq!((model.mass(ball), heavy.mass(ball)), (2.0, 4.0));
    /// # Ok::<(), mishandle_world::WorldError>(())
    /// ```
    pub fn changed(&self, changes: &[Change]) -> Model {
        let mut inner = (*self.inner).clone();
        for change in changes {
            apply(change, &mut inner);
        }
        if changes.iter().any(|change| matches!(change, Change::Mass(..))) {
            let mut data = MjData::new(Box::new(inner));
            data.set_const();
            inner = data.model().clone();
        }
        Model { inner: Arc::new(inner), state_size: self.state_size }
    }

    /// Returns the mass of a body without its children, kg.
    pub fn mass(&self, body: Body) -> f64 {
        self.inner.body_mass()[body.0]
    }
}

fn apply(change: &Change, model: &mut MjModel) {
    match change {
        Change::Friction(factor) => {
            model.geom_friction_mut().iter_mut().for_each(|friction| friction[0] *= factor);
            model
                .pair_friction_mut()
                .iter_mut()
                .flat_map(|friction| &mut friction[..2])
                .for_each(|f| *f *= factor);
        }
        Change::Mass(bodies, factor) => {
            for Body(id) in bodies {
                model.body_mass_mut()[*id] *= factor;
                model.body_inertia_mut()[*id].iter_mut().for_each(|inertia| *inertia *= factor);
            }
        }
        Change::Damping(joints, damping) => {
            joints.iter().for_each(|joint| model.dof_damping_mut()[joint.dof] += damping);
        }
        Change::Gain(actuators, factor) => {
            for Actuator(id) in actuators {
                // SAFETY: a position servo's gain and bias are plain numbers; none of them is an index or a size.
                #[allow(unsafe_code)]
                unsafe {
                    model.actuator_gainprm_mut()[*id][0] *= factor;
                    model.actuator_biasprm_mut()[*id][..3].iter_mut().for_each(|bias| *bias *= factor);
                }
            }
        }
    }
}
