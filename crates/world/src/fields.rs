//! Fields of a model that differ between the worlds of a batch.

use std::sync::Arc;

use mujoco_rs::mujoco_c::mjModel;

use crate::{Change, Model};

/// Declares the fields of [`ModelField`] that are arrays of MuJoCo's model, with their number of
/// elements and of numbers per element.
macro_rules! model_fields {
    ($($field:ident $array:ident [$count:ident, $width:literal];)*) => {
        /// A field of the model that may have another value in each world of a batch.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum ModelField {
            $(#[doc = concat!("MuJoCo's array `", stringify!($array), "`.")] $field,)*
            /// Gravity, `opt.gravity`.
            Gravity,
        }

        impl ModelField {
            /// Returns MuJoCo's name, such as `geom_friction` or `opt.gravity`.
            pub fn name(self) -> &'static str {
                match self {
                    $(ModelField::$field => stringify!($array),)*
                    ModelField::Gravity => "opt.gravity",
                }
            }

            /// Returns the address of the first number and the number of numbers. The model at this
            /// address must be valid.
            #[allow(unsafe_code)]
            unsafe fn part(self, model: *mut mjModel) -> (*mut f64, usize) {
                // SAFETY: the caller guarantees that the model is valid.
                unsafe {
                    match self {
                        $(ModelField::$field => ((*model).$array, $width * (*model).$count as usize),)*
                        ModelField::Gravity => ((&raw mut (*model).opt.gravity).cast(), 3),
                    }
                }
            }
        }
    };
}

model_fields! {
    GeomFriction geom_friction [ngeom, 3];
    GeomSize geom_size [ngeom, 3];
    GeomPos geom_pos [ngeom, 3];
    GeomAabb geom_aabb [ngeom, 6];
    GeomRbound geom_rbound [ngeom, 1];
    PairFriction pair_friction [npair, 5];
    BvhAabb bvh_aabb [nbvh, 6];
    BodyMass body_mass [nbody, 1];
    BodyInertia body_inertia [nbody, 3];
    BodyIpos body_ipos [nbody, 3];
    BodyGravcomp body_gravcomp [nbody, 1];
    BodySubtreemass body_subtreemass [nbody, 1];
    BodyInvweight0 body_invweight0 [nbody, 2];
    DofDamping dof_damping [nv, 1];
    DofInvweight0 dof_invweight0 [nv, 1];
    DofM0 dof_M0 [nv, 1];
    DofLength dof_length [nv, 1];
    SitePos site_pos [nsite, 3];
    ActuatorGainprm actuator_gainprm [nactuator, 10];
    ActuatorBiasprm actuator_biasprm [nactuator, 10];
    ActuatorAcc0 actuator_acc0 [nactuator, 1];
    FlexedgeInvweight0 flexedge_invweight0 [nflexedge, 1];
    EqData eq_data [neq, 12];
}

/// Fields that `mj_setConst` derives from masses, inertias and lengths, except those of tendons,
/// cameras and lights.
const DERIVED: [ModelField; 7] = [
    ModelField::BodySubtreemass,
    ModelField::BodyInvweight0,
    ModelField::DofInvweight0,
    ModelField::DofM0,
    ModelField::DofLength,
    ModelField::ActuatorAcc0,
    ModelField::FlexedgeInvweight0,
];

impl ModelField {
    /// Returns the fields that changes of these kinds modify, each once, in the order of the enum.
    pub fn of(changes: &[Change]) -> Vec<ModelField> {
        let mut fields: Vec<ModelField> = changes.iter().flat_map(Change::fields).collect();
        fields.sort_unstable();
        fields.dedup();
        fields
    }
}

impl Change {
    /// Returns the fields that a change of this kind modifies.
    fn fields(&self) -> Vec<ModelField> {
        use ModelField as F;
        let own: &[ModelField] = match self {
            Change::Friction(_) => &[F::GeomFriction, F::PairFriction],
            Change::Mass(..) => &[F::BodyMass, F::BodyInertia],
            Change::Damping(..) => &[F::DofDamping],
            Change::Gain(..) => &[F::ActuatorGainprm, F::ActuatorBiasprm],
            Change::Size(..) => &[
                F::GeomSize,
                F::GeomPos,
                F::GeomAabb,
                F::GeomRbound,
                F::BvhAabb,
                F::BodyInertia,
                F::BodyIpos,
                F::SitePos,
            ],
            Change::Payload(..) => &[F::BodyMass, F::BodyGravcomp],
            Change::GravityTilt(..) => &[F::Gravity],
            Change::WeldShift(..) => &[F::EqData],
        };
        let derived: &[ModelField] = if self.changes_inertia() { &DERIVED } else { &[] };
        [own, derived].concat()
    }
}

impl Model {
    /// Returns the values of a field, row-major.
    fn field(&self, field: ModelField) -> &[f64] {
        // SAFETY: the model is valid and only read. It has this many numbers at this address (the
        // table above repeats mjmodel.h), and they live as long as the model.
        #[allow(unsafe_code)]
        unsafe {
            let (start, length) = field.part(std::ptr::from_ref(self.inner.ffi()).cast_mut());
            if length == 0 { &[] } else { std::slice::from_raw_parts(start, length) }
        }
    }

    /// Returns the number of numbers of these fields.
    pub fn fields_size(&self, fields: &[ModelField]) -> usize {
        fields.iter().map(|field| self.field(*field).len()).sum()
    }

    /// Appends the values of these fields to `values`, one field after another, each row-major.
    ///
    /// # Example
    /// ```
    /// use mishandle_world::{Change, Model, ModelField};
    /// let xml = r#"<mujoco><worldbody><body name="ball"><freejoint/><geom size="0.1" mass="2"/></body></worldbody></mujoco>"#;
    /// let model = Model::from_xml(xml)?;
    /// let changes = [Change::Mass(vec![model.body("ball")?], 2.0)];
    /// assert!(ModelField::of(&changes).contains(&ModelField::BodyMass));
    /// let mut masses = Vec::new();
    /// model.changed(&changes).read_fields(&[ModelField::BodyMass], &mut masses);
    /// assert_eq!(masses, [0.0, 4.0]); // the world and the ball
    /// # Ok::<(), mishandle_world::WorldError>(())
    /// ```
    pub fn read_fields(&self, fields: &[ModelField], values: &mut Vec<f64>) {
        fields.iter().for_each(|field| values.extend_from_slice(self.field(*field)));
    }

    /// Returns a copy of this model with the values that [`read_fields`](Self::read_fields) has
    /// read from a [changed](Self::changed) copy of this model.
    pub(crate) fn with_fields(&self, fields: &[ModelField], values: &[f64]) -> Model {
        assert_eq!(values.len(), self.fields_size(fields), "number of values of the fields");
        let mut inner = (*self.inner).clone();
        let mut rest = values;
        for field in fields {
            // SAFETY: as in `field`; `inner` is borrowed exclusively, so its numbers may be
            // written. Values of a changed copy keep the indices that `eq_data` and the parameters
            // of actuators may contain.
            #[allow(unsafe_code)]
            unsafe {
                let (start, length) = field.part(inner.ffi_mut());
                let (own, others) = rest.split_at(length);
                std::ptr::copy_nonoverlapping(own.as_ptr(), start, length);
                rest = others;
            }
        }
        Model { inner: Arc::new(inner), ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    /// A model with everything that changes modify. It has no tendon, camera or light, whose
    /// derived fields are left out.
    const XML: &str = r#"<mujoco><worldbody><geom name="floor" type="plane" size="1 1 0.1"/>
        <body name="arm" gravcomp="1"><joint name="j" axis="0 1 0" damping="0.1"/>
        <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.02" mass="2"/>
        <body name="finger" pos="0.5 0 0"><joint name="k" type="slide"/><geom size="0.01" mass="0.1"/></body></body>
        <body name="thing" pos="0.5 0 0.2"><freejoint/><site name="s" pos="0.01 0 0"/>
        <geom name="box" type="box" size="0.03 0.02 0.04" pos="0.05 0 0" mass="0.3"/><geom size="0.02" mass="0.1"/></body></worldbody>
        <contact><pair geom1="floor" geom2="box" friction="1 1 0.1 0.1 0.1"/></contact>
        <equality><weld name="w" body1="arm" body2="thing" relpose="0.5 0 0.2 1 0 0 0"/></equality>
        <actuator><position name="servo" joint="j" kp="10" kv="1"/></actuator></mujoco>"#;

    fn changes(model: &Model) -> Vec<Change> {
        let thing = model.body("thing").unwrap();
        vec![
            Change::Friction(1.5),
            Change::Mass(vec![thing], 2.0),
            Change::Damping(vec![model.joint("j").unwrap()], 3.0),
            Change::Gain(vec![model.actuator("servo").unwrap()], 1.2),
            Change::Size(vec![thing], 1.1),
            Change::Payload(model.body("arm").unwrap(), 0.4),
            Change::GravityTilt(1, 0.03),
            Change::WeldShift(model.equality("w").unwrap(), 2, 0.005),
        ]
    }

    /// Returns all numbers of a model.
    fn bytes(model: &Model) -> Vec<u8> {
        let mut bytes = vec![0; model.inner.size()];
        model.inner.save_to_buffer(&mut bytes).unwrap();
        bytes
    }

    /// Returns whether the model with these fields of its changed copy is that copy.
    fn is_complete(model: &Model, changes: &[Change], fields: &[ModelField]) -> bool {
        let changed = model.changed(changes);
        let mut values = Vec::new();
        changed.read_fields(fields, &mut values);
        bytes(&model.with_fields(fields, &values)) == bytes(&changed)
    }

    #[test]
    fn the_fields_of_changes_are_all_that_they_modify_and_no_more() {
        let model = Model::from_xml(XML).unwrap();
        let all = changes(&model);
        for change in &all {
            let change = std::slice::from_ref(change);
            assert!(!is_complete(&model, change, &[]), "{change:?} modifies nothing");
            assert!(is_complete(&model, change, &ModelField::of(change)), "{change:?}");
        }
        let fields = ModelField::of(&all);
        assert!(is_complete(&model, &all, &fields));
        for left_out in fields.iter().filter(|field| model.fields_size(&[**field]) > 0) {
            let rest: Vec<_> = fields.iter().copied().filter(|field| field != left_out).collect();
            assert!(!is_complete(&model, &all, &rest), "no change modifies {}", left_out.name());
        }
    }
}
