//! Copies of a model with changed physical parameters.

use std::sync::Arc;

use mujoco_rs::prelude::*;

use crate::{Actuator, Body, Equality, Joint, Model, ModelField, field_change};

/// A change of a model's physical parameters.
#[derive(Clone, Debug, PartialEq)]
pub enum Change {
    /// Multiplies the sliding friction of every contact.
    Friction(f64),
    /// Multiplies the mass and inertia of these bodies.
    Mass(Vec<Body>, f64),
    /// Adds viscous damping to all velocities of these joints, N m s/rad or N s/m.
    Damping(Vec<Joint>, f64),
    /// Multiplies the stiffness and damping of these position servos, so that their ratio is
    /// unchanged.
    Gain(Vec<Actuator>, f64),
    /// Multiplies the lengths of these bodies, whose geoms have primitive shapes. Their masses do
    /// not change.
    Size(Vec<Body>, f64),
    /// Adds a point mass to a body at its center of mass, kg. Its gravity is not compensated.
    Payload(Body, f64),
    /// Rotates gravity about an axis of the world (0 is x, 1 is y, 2 is z), rad.
    GravityTilt(usize, f64),
    /// Shifts the pose in which a weld holds its second body, along an axis of its first body, m.
    /// The document must set `relpose`, because MuJoCo otherwise recomputes the pose with the
    /// quantities that it derives from masses.
    WeldShift(Equality, usize, f64),
    /// Changes numbers of a field of MuJoCo's model. [`Model::check_change`] says whether it can be
    /// made. Masses do not follow sizes.
    Field {
        /// The field.
        field: ModelField,
        /// Indices into the values of the field, row-major.
        entries: Vec<usize>,
        /// How `value` changes them.
        operation: FieldOperation,
        /// The operand, in the unit of the field.
        value: f64,
    },
}

/// How a [`Change::Field`] changes a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldOperation {
    /// Replaces it.
    Set,
    /// Adds to it.
    Add,
    /// Multiplies it.
    Scale,
}

impl FieldOperation {
    /// Returns the new number.
    pub fn apply(self, old: f64, value: f64) -> f64 {
        match self {
            FieldOperation::Set => value,
            FieldOperation::Add => old + value,
            FieldOperation::Scale => old * value,
        }
    }
}

impl Model {
    /// Returns a copy of this model with these changes. Quantities that MuJoCo derives from masses
    /// and lengths are recomputed.
    ///
    /// # Panics
    /// If [`check_change`](Self::check_change) refuses a change.
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
            if let Err(error) = self.check_change(change) {
                panic!("{error}");
            }
            apply(change, &mut inner);
        }
        field_change::separate_frames(&mut inner);
        if changes.iter().any(|change| change.changes_constants() != [false; 2]) {
            let mut data = MjData::new(Box::new(inner));
            data.set_const();
            inner = data.model().clone();
        }
        Model { inner: Arc::new(inner), ..self.clone() }
    }

    /// Returns the mass of a body without its children, kg.
    pub fn mass(&self, body: Body) -> f64 {
        self.inner.body_mass()[body.0]
    }
}

impl Change {
    /// Returns whether MuJoCo must recompute what it derives from inertias, and from lengths.
    pub(crate) fn changes_constants(&self) -> [bool; 2] {
        use ModelField as F;
        match self {
            Change::Mass(..) | Change::Payload(..) => [true, false],
            Change::Size(..) => [true, true],
            Change::Field { field, .. } => match field {
                F::BodyMass | F::BodyInertia | F::BodyIpos | F::DofArmature | F::ActuatorGear => {
                    [true, false]
                }
                F::BodyPos | F::SitePos => [true, true],
                _ => [false, false],
            },
            _ => [false, false],
        }
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
            for Joint { dof, kind, .. } in joints {
                let own = &mut model.dof_damping_mut()[*dof..][..kind.velocities()];
                own.iter_mut().for_each(|own| *own += damping);
            }
        }
        Change::Size(bodies, factor) => bodies.iter().for_each(|body| resize(*body, *factor, model)),
        Change::Payload(Body(id), mass) => {
            let own = model.body_mass()[*id];
            model.body_mass_mut()[*id] = own + mass;
            // MuJoCo compensates a share of the whole weight.
            model.body_gravcomp_mut()[*id] *= own / (own + mass);
        }
        Change::GravityTilt(axis, angle) => {
            let (sin, cos) = angle.sin_cos();
            let i = (axis + 1) % 3;
            let j = (axis + 2) % 3;
            let gravity = &mut model.opt_mut().gravity;
            (gravity[i], gravity[j]) =
                (cos * gravity[i] - sin * gravity[j], sin * gravity[i] + cos * gravity[j]);
        }
        Change::WeldShift(Equality(id), axis, shift) => {
            // SAFETY: the numbers of a weld are lengths and a quaternion; none of them is an index
            // or a size.
            #[allow(unsafe_code)]
            let data = unsafe { &mut model.eq_data_mut()[*id] };
            // Numbers 3 to 5 are the position of the second body in the frame of the first.
            data[3 + axis] += shift;
        }
        Change::Field { field, entries, operation, value } => {
            field_change::apply(*field, entries, *operation, *value, model);
        }
        Change::Gain(actuators, factor) => {
            for Actuator(id) in actuators {
                // SAFETY: a position servo's gain and bias are plain numbers; none of them is an
                // index or a size.
                #[allow(unsafe_code)]
                unsafe {
                    model.actuator_gainprm_mut()[*id][0] *= factor;
                    model.actuator_biasprm_mut()[*id][..3].iter_mut().for_each(|bias| *bias *= factor);
                }
            }
        }
    }
}

/// Scales a body about the origin of its frame.
fn resize(Body(id): Body, factor: f64, model: &mut MjModel) {
    let range = |first: i32, count: i32| first.max(0) as usize..(first.max(0) + count) as usize;
    let scale = |values: &mut [f64]| values.iter_mut().for_each(|value| *value *= factor);
    for geom in range(model.body_geomadr()[id], model.body_geomnum()[id]) {
        scale(&mut model.geom_size_mut()[geom]);
        scale(&mut model.geom_pos_mut()[geom]);
        scale(&mut model.geom_aabb_mut()[geom]);
        model.geom_rbound_mut()[geom] *= factor;
    }
    for volume in range(model.body_bvhadr()[id], model.body_bvhnum()[id]) {
        scale(&mut model.bvh_aabb_mut()[volume]);
    }
    let sites = model.site_bodyid().iter().enumerate().filter(|(_, body)| **body as usize == id);
    for site in sites.map(|(site, _)| site).collect::<Vec<_>>() {
        scale(&mut model.site_pos_mut()[site]);
    }
    scale(&mut model.body_ipos_mut()[id]);
    // An inertia of the same mass is proportional to the square of the lengths.
    model.body_inertia_mut()[id].iter_mut().for_each(|inertia| *inertia *= factor * factor);
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    fn simulate(model: &Model, steps: usize) -> Vec<f64> {
        let mut world = model.world();
        world.reset();
        (0..steps).for_each(|_| world.step());
        world.qpos().to_vec()
    }

    fn assert_close(a: &[f64], b: &[f64]) {
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9), "{a:?}\n{b:?}");
    }

    #[test]
    fn a_resized_body_moves_like_one_that_was_compiled_with_this_size() {
        let xml = |s: f64| {
            format!(
                r#"<mujoco><worldbody><geom type="plane" size="1 1 0.1"/>
                <body name="thing" pos="0 0 0.2" euler="20 30 0"><freejoint/>
                <geom type="box" size="{} {} {}" pos="{} 0 0" mass="0.3"/>
                <geom type="cylinder" size="{} {}" pos="0 0 {}" mass="0.2"/></body></worldbody></mujoco>"#,
                0.03 * s,
                0.02 * s,
                0.04 * s,
                0.05 * s,
                0.02 * s,
                0.06 * s,
                0.03 * s
            )
        };
        let plain = Model::from_xml(&xml(1.0)).unwrap();
        let thing = plain.body("thing").unwrap();
        let changed = plain.changed(&[Change::Size(vec![thing], 1.3)]);
        let compiled = Model::from_xml(&xml(1.3)).unwrap();
        // It falls, hits the ground after 0.15 s and comes to rest.
        for steps in [50, 120, 400] {
            assert_close(&simulate(&changed, steps), &simulate(&compiled, steps));
        }
        assert!((simulate(&changed, 400)[2] - simulate(&plain, 400)[2]).abs() > 1e-3, "the size matters");
    }

    #[test]
    fn a_payload_hangs_on_the_arm_like_a_body_without_gravity_compensation() {
        let xml = |payload: &str| {
            format!(
                r#"<mujoco><worldbody><body name="arm" gravcomp="1"><joint name="j" axis="0 1 0" damping="0.1"/>
                <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.02" mass="2"/>{payload}</body></worldbody></mujoco>"#
            )
        };
        let plain = Model::from_xml(&xml("")).unwrap();
        let changed = plain.changed(&[Change::Payload(plain.body("arm").unwrap(), 0.4)]);
        // The center of mass of the capsule is in its middle. A small sphere is almost a point
        // mass.
        let attached = Model::from_xml(&xml(
            r#"<body pos="0.25 0 0"><geom size="0.001" mass="0.4" contype="0" conaffinity="0"/></body>"#,
        ));
        let found = simulate(&changed, 200);
        let expected = simulate(&attached.unwrap(), 200);
        assert!((found[0] - expected[0]).abs() < 1e-6, "{found:?} {expected:?}");
        assert!(
            found[0] > 0.1 && simulate(&plain, 200)[0].abs() < 1e-9,
            "only the payload moves the arm: {found:?}"
        );
    }
}
