//! Fields of a model that differ between the worlds of a batch.

use std::ops::Range;
use std::sync::Arc;

use mujoco_rs::mujoco_c::mjModel;
use mujoco_rs::prelude::MjModel;

use self::RowOwner::{Dof, Model as Whole, Of};
use self::Values::{Any, Derived, NotNegative};
use crate::ElementKind as Kind;
use crate::{Change, ElementKind, Model, WorldError, field_change};

/// Declares the fields of [`ModelField`] that are arrays of MuJoCo's model: number of rows, numbers
/// per row, to which elements the rows belong, and which numbers a user may write.
macro_rules! model_fields {
    ($($field:ident $array:ident [$count:ident, $width:literal] $rows:expr, $values:expr;)*) => {
        /// A field of the model that may have another value in each world of a batch.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum ModelField {
            $(#[doc = concat!("MuJoCo's array `", stringify!($array), "`.")] $field,)*
            /// Gravity, `opt.gravity`.
            Gravity,
            /// Velocity of the air or liquid, `opt.wind`. It matters if the model has a density.
            Wind,
        }

        impl ModelField {
            /// All fields.
            const ALL: &[ModelField] = &[$(ModelField::$field,)* ModelField::Gravity, ModelField::Wind];

            /// Returns MuJoCo's name, such as `geom_friction` or `opt.gravity`.
            pub fn name(self) -> &'static str {
                match self {
                    $(ModelField::$field => stringify!($array),)*
                    ModelField::Gravity => "opt.gravity",
                    ModelField::Wind => "opt.wind",
                }
            }

            /// Returns the number of numbers per row.
            pub fn width(self) -> usize {
                match self {
                    $(ModelField::$field => $width,)*
                    ModelField::Gravity | ModelField::Wind => 3,
                }
            }

            pub(crate) fn row_owner(self) -> RowOwner {
                match self {
                    $(ModelField::$field => $rows,)*
                    ModelField::Gravity | ModelField::Wind => Whole,
                }
            }

            pub(crate) fn values(self) -> Values {
                match self {
                    $(ModelField::$field => $values,)*
                    ModelField::Gravity | ModelField::Wind => Any,
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
                        ModelField::Wind => ((&raw mut (*model).opt.wind).cast(), 3),
                    }
                }
            }
        }
    };
}

/// The elements that the rows of a field belong to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RowOwner {
    /// One row for each element.
    Of(ElementKind),
    /// One row for each generalized velocity of the joints.
    Dof,
    /// One row for the model.
    Model,
}

/// The numbers that a user may write into a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Values {
    /// Finite numbers.
    Any,
    /// Finite numbers that are not negative.
    NotNegative,
    /// None: they follow from other fields, or have a meaning that depends on the element.
    Derived,
}

model_fields! {
    GeomFriction geom_friction [ngeom, 3] Of(Kind::Geom), NotNegative;
    GeomSize geom_size [ngeom, 3] Of(Kind::Geom), NotNegative;
    GeomPos geom_pos [ngeom, 3] Of(Kind::Geom), Any;
    GeomSolref geom_solref [ngeom, 2] Of(Kind::Geom), Any;
    GeomSolimp geom_solimp [ngeom, 5] Of(Kind::Geom), NotNegative;
    GeomAabb geom_aabb [ngeom, 6] Of(Kind::Geom), Derived;
    GeomRbound geom_rbound [ngeom, 1] Of(Kind::Geom), Derived;
    PairFriction pair_friction [npair, 5] Of(Kind::Pair), NotNegative;
    BvhAabb bvh_aabb [nbvhstatic, 6] Whole, Derived;
    BodyPos body_pos [nbody, 3] Of(Kind::Body), Any;
    BodyMass body_mass [nbody, 1] Of(Kind::Body), NotNegative;
    BodyInertia body_inertia [nbody, 3] Of(Kind::Body), NotNegative;
    BodyIpos body_ipos [nbody, 3] Of(Kind::Body), Any;
    BodyGravcomp body_gravcomp [nbody, 1] Of(Kind::Body), Derived;
    BodySubtreemass body_subtreemass [nbody, 1] Of(Kind::Body), Derived;
    BodyInvweight0 body_invweight0 [nbody, 2] Of(Kind::Body), Derived;
    JntStiffness jnt_stiffness [njnt, 1] Of(Kind::Joint), NotNegative;
    DofDamping dof_damping [nv, 1] Dof, NotNegative;
    DofArmature dof_armature [nv, 1] Dof, NotNegative;
    DofFrictionloss dof_frictionloss [nv, 1] Dof, NotNegative;
    DofInvweight0 dof_invweight0 [nv, 1] Dof, Derived;
    DofM0 dof_M0 [nv, 1] Dof, Derived;
    DofLength dof_length [nv, 1] Dof, Derived;
    SitePos site_pos [nsite, 3] Of(Kind::Site), Any;
    ActuatorGainprm actuator_gainprm [nactuator, 10] Of(Kind::Actuator), Any;
    ActuatorBiasprm actuator_biasprm [nactuator, 10] Of(Kind::Actuator), Any;
    ActuatorForcerange actuator_forcerange [nactuator, 2] Of(Kind::Actuator), Any;
    ActuatorGear actuator_gear [nout, 6] Of(Kind::Actuator), Any;
    ActuatorAcc0 actuator_acc0 [nout, 1] Of(Kind::Actuator), Derived;
    ActuatorLength0 actuator_length0 [nout, 1] Of(Kind::Actuator), Derived;
    TendonInvweight0 tendon_invweight0 [ntendon, 1] Of(Kind::Tendon), Derived;
    TendonLength0 tendon_length0 [ntendon, 1] Of(Kind::Tendon), Derived;
    FlexedgeInvweight0 flexedge_invweight0 [nflexedge, 1] Of(Kind::Flex), Derived;
    EqData eq_data [neq, 12] Of(Kind::Equality), Derived;
}

/// Fields that `mj_setConst` derives from masses and inertias, except those of cameras and lights.
const FROM_INERTIA: &[ModelField] = &[
    ModelField::BodySubtreemass,
    ModelField::BodyInvweight0,
    ModelField::DofInvweight0,
    ModelField::DofM0,
    ModelField::DofLength,
    ModelField::ActuatorAcc0,
    ModelField::TendonInvweight0,
    ModelField::FlexedgeInvweight0,
];

/// Fields that `mj_setConst` derives from lengths as well.
const FROM_LENGTHS: &[ModelField] = &[ModelField::ActuatorLength0, ModelField::TendonLength0];

impl ModelField {
    /// Returns the field with MuJoCo's name, if a [`Change::Field`] may name it.
    ///
    /// # Errors
    /// If there is no such field.
    pub fn from_name(name: &str) -> Result<ModelField, WorldError> {
        let fields = || ModelField::ALL.iter().filter(|field| field.values() != Derived);
        fields().copied().find(|field| field.name() == name).ok_or_else(|| WorldError::Element {
            kind: "field that can be changed",
            name: name.to_string(),
            known: fields().map(|field| field.name().to_string()).collect(),
        })
    }

    /// Returns the kind of the elements that the rows belong to; `None` if the model has one row.
    /// A joint may have several rows: see [`Model::field_rows`].
    pub fn rows(self) -> Option<ElementKind> {
        match self.row_owner() {
            Of(kind) => Some(kind),
            Dof => Some(ElementKind::Joint),
            Whole => None,
        }
    }
}

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
            Change::Field { field, .. } => match field {
                F::GeomSize => &[F::GeomSize, F::GeomAabb, F::GeomRbound, F::BvhAabb],
                F::GeomPos => &[F::GeomPos, F::BvhAabb],
                F::BodyIpos => &[F::BodyIpos, F::BvhAabb],
                F::BodyPos => &[F::BodyPos, F::EqData],
                F::ActuatorGear => &[F::ActuatorGear, F::ActuatorLength0],
                field => std::slice::from_ref(field),
            },
        };
        let [inertia, lengths] = self.changes_constants();
        let none: &[ModelField] = &[];
        [own, if inertia { FROM_INERTIA } else { none }, if lengths { FROM_LENGTHS } else { none }].concat()
    }
}

impl Model {
    /// Returns the values of a field, row-major.
    pub fn field(&self, field: ModelField) -> &[f64] {
        // SAFETY: the model is valid and only read. It has this many numbers at this address (the
        // table above repeats mjmodel.h), and they live as long as the model.
        #[allow(unsafe_code)]
        unsafe {
            let (start, length) = field.part(std::ptr::from_ref(self.inner.ffi()).cast_mut());
            if length == 0 { &[] } else { std::slice::from_raw_parts(start, length) }
        }
    }

    /// Returns the rows of a field that belong to an element of the kind [`ModelField::rows`]. A
    /// field of the whole model has one row.
    ///
    /// # Panics
    /// If the index is too large.
    ///
    /// # Example
    /// ```
    /// use mishandle_world::{ElementKind, Model, ModelField, PANDA};
    /// let model = Model::from_xml(PANDA)?;
    /// let field = ModelField::from_name("dof_damping")?;
    /// assert_eq!((field.width(), field.rows()), (1, Some(ElementKind::Joint)));
    /// let joint = model.find(ElementKind::Joint, "joint3")?;
    /// assert_eq!(model.field_rows(field, joint), 2..3);
    /// # Ok::<(), mishandle_world::WorldError>(())
    /// ```
    pub fn field_rows(&self, field: ModelField, element: usize) -> Range<usize> {
        match field.row_owner() {
            Of(_) => element..element + 1,
            Dof => {
                let joint = self.joint_at(element);
                joint.dof..joint.dof + joint.kind.velocities()
            }
            Whole => 0..1,
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
        field_change::separate_frames(&mut inner);
        Model { inner: Arc::new(inner), ..self.clone() }
    }
}

/// Returns the values of a field of a model for writing, row-major.
pub(crate) fn field_mut(model: &mut MjModel, field: ModelField) -> &mut [f64] {
    // SAFETY: as in `Model::field`; the model is borrowed exclusively.
    #[allow(unsafe_code)]
    unsafe {
        let (start, length) = field.part(model.ffi_mut());
        if length == 0 { &mut [] } else { std::slice::from_raw_parts_mut(start, length) }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    /// A model with everything that changes modify. It has no camera or light, whose derived fields
    /// are left out.
    const XML: &str = r#"<mujoco><worldbody><geom name="floor" type="plane" size="1 1 0.1"/>
        <body name="arm" gravcomp="1"><joint name="j" axis="0 1 0" damping="0.1"/>
        <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.02" mass="2"/>
        <body name="finger" pos="0.5 0 0"><joint name="k" type="slide"/><geom size="0.01" mass="0.1"/><site name="tip"/></body></body>
        <body name="thing" pos="0.5 0 0.2"><freejoint/><site name="s" pos="0.01 0 0"/>
        <geom name="box" type="box" size="0.03 0.02 0.04" pos="0.05 0 0" mass="0.3"/><geom size="0.02" mass="0.1"/></body></worldbody>
        <contact><pair geom1="floor" geom2="box" friction="1 1 0.1 0.1 0.1"/></contact>
        <equality><weld name="w" body1="arm" body2="thing" relpose="0.5 0 0.2 1 0 0 0"/></equality>
        <tendon><spatial name="string" stiffness="1"><site site="s"/><site site="tip"/></spatial></tendon>
        <actuator><position name="servo" joint="j" kp="10" kv="1" forcerange="-9 9"/>
        <motor name="winch" tendon="string"/></actuator></mujoco>"#;

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

    /// Returns a change of the first number of each field that can be changed there.
    fn field_changes(model: &Model) -> Vec<Change> {
        let variable = ModelField::ALL.iter().filter(|field| field.values() != Derived);
        let change = |field: &ModelField| {
            let change = |entry| Change::Field {
                field: *field,
                entries: vec![entry],
                operation: crate::FieldOperation::Add,
                value: 0.01,
            };
            let mut entries = 0..model.field(*field).len();
            change(entries.find(|entry| model.check_change(&change(*entry)).is_ok()).unwrap())
        };
        variable.map(change).collect()
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
        let all = [changes(&model), field_changes(&model)].concat();
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
