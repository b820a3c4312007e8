//! Changes of numbers of MuJoCo's model that a user names.

use mujoco_rs::prelude::*;
use mujoco_rs::wrappers::mj_model::{MjtGeomBase, MjtSameFrame};

use crate::fields::{Values, field_mut};
use crate::frame::{add, norm, rotate, rotate_back, sub};
use crate::{Change, FieldOperation, Model, ModelField, WorldError};

/// Distance above which two frames are apart, m. MuJoCo's compiler uses a smaller one.
const APART: f64 = 1e-12;

impl Model {
    /// Checks that a change can be made and has an effect.
    ///
    /// # Errors
    /// If a [`Change::Field`] names a field or element that cannot be changed after the model is
    /// compiled, or a value out of its range.
    ///
    /// # Example
    /// ```
    /// use mishandle_world::{Change, FieldOperation, Model, ModelField};
    /// let xml = r#"<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/></worldbody></mujoco>"#;
    /// let model = Model::from_xml(xml)?;
    /// let slide = |value| Change::Field {
    ///     field: ModelField::GeomFriction,
    ///     entries: vec![0],
    ///     operation: FieldOperation::Set,
    ///     value,
    /// };
    /// assert!(model.check_change(&slide(0.8)).is_ok());
    /// let error = model.check_change(&slide(-0.8)).unwrap_err();
    /// assert_eq!(error.to_string(), "cannot change geom_friction of geom `floor`: -0.8 is negative");
    /// # Ok::<(), mishandle_world::WorldError>(())
    /// ```
    pub fn check_change(&self, change: &Change) -> Result<(), WorldError> {
        let Change::Field { field, entries, operation, value } = change else { return Ok(()) };
        let values = self.field(*field);
        for entry in entries {
            let row = entry / field.width();
            let refuse = |reason: String| {
                Err(WorldError::Field { field: field.name(), element: self.row_label(*field, row), reason })
            };
            let Some(old) = values.get(*entry) else {
                return refuse(format!(
                    "entry {entry} does not exist; the field has {} numbers",
                    values.len()
                ));
            };
            let new = operation.apply(*old, *value);
            if !new.is_finite() {
                return refuse(format!("{new} is not finite"));
            }
            if field.values() == Values::NotNegative && new < 0.0 {
                return refuse(format!("{new} is negative"));
            }
            if field.values() == Values::Derived {
                return refuse("MuJoCo derives it from other fields".to_string());
            }
            if let Err(reason) = self.check_entry(*field, row, entry % field.width(), *old, new) {
                return refuse(reason);
            }
        }
        Ok(())
    }

    /// Checks what depends on the element.
    fn check_entry(
        &self,
        field: ModelField,
        row: usize,
        column: usize,
        old: f64,
        new: f64,
    ) -> Result<(), String> {
        use ModelField as F;
        let model = &self.inner;
        let refuse = |reason: &str| Err(reason.to_string());
        match field {
            F::GeomSize => {
                let sizes = match model.geom_type()[row] {
                    MjtGeomBase::mjGEOM_SPHERE => 1,
                    MjtGeomBase::mjGEOM_CAPSULE | MjtGeomBase::mjGEOM_CYLINDER => 2,
                    MjtGeomBase::mjGEOM_BOX | MjtGeomBase::mjGEOM_ELLIPSOID => 3,
                    MjtGeomBase::mjGEOM_PLANE => {
                        return refuse("the collisions of a plane have no size");
                    }
                    _ => {
                        return refuse("only primitive shapes have a size; scale its mesh in the model");
                    }
                };
                if column >= sizes {
                    return Err(format!("this shape has {sizes} sizes, so number {column} has no effect"));
                }
                if new == 0.0 {
                    return refuse("0 is not a size");
                }
            }
            F::BodyMass | F::BodyInertia | F::BodyIpos if row == 0 => {
                return refuse("the world has no mass");
            }
            F::BodyMass | F::BodyInertia if new == 0.0 && old > 0.0 => {
                return refuse("a body that had a mass needs one");
            }
            F::BodyIpos if model.body_simple()[row] != 0 && (new - old).abs() > APART => {
                return refuse(
                    "its center of mass is the origin of its frame, and MuJoCo has compiled it as a body without \
                     coupled inertia; give it an <inertial> with a small offset in the model",
                );
            }
            F::BodyPos if row == 0 => return refuse("the world does not move"),
            F::BodyPos if model.body_mocapid()[row] >= 0 => {
                return refuse("it is a mocap body, whose position belongs to the state");
            }
            F::BodyPos if self.starts_free(row) => {
                return refuse("it has a free joint, so its position belongs to the state");
            }
            F::ActuatorForcerange if !model.actuator_forcelimited()[row] => {
                return refuse("its force is not limited; give it a `forcerange` in the model");
            }
            F::ActuatorGainprm => {
                if !matches!(model.actuator_gaintype()[row], MjtGain::mjGAIN_FIXED | MjtGain::mjGAIN_AFFINE) {
                    return refuse("only fixed and affine gains can be changed");
                }
                if column > 2 {
                    return refuse("a gain has the numbers 0 to 2");
                }
            }
            F::ActuatorBiasprm => {
                if model.actuator_biastype()[row] != MjtBias::mjBIAS_AFFINE {
                    return refuse("only an affine bias can be changed, such as that of a position servo");
                }
                if column > 2 {
                    return refuse("a bias has the numbers 0 to 2");
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn starts_free(&self, body: usize) -> bool {
        let first = self.inner.body_jntadr()[body];
        usize::try_from(first).is_ok_and(|first| self.inner.jnt_type()[first] == MjtJoint::mjJNT_FREE)
    }

    /// Returns the kind and the name of the element that a row belongs to.
    fn row_label(&self, field: ModelField, row: usize) -> String {
        let Some(kind) = field.rows() else { return "the model".to_string() };
        let owner = (0..self.count(kind)).find(|element| self.field_rows(field, *element).contains(&row));
        let name = owner.map(|element| self.names(kind).swap_remove(element)).unwrap_or_default();
        if name.is_empty() { format!("{} {row}", kind.label()) } else { format!("{} `{name}`", kind.label()) }
    }
}

/// Changes numbers of a field, and what follows from them except what MuJoCo derives itself.
pub(crate) fn apply(
    field: ModelField,
    entries: &[usize],
    operation: FieldOperation,
    value: f64,
    model: &mut MjModel,
) {
    let values = field_mut(model, field);
    for entry in entries {
        values[*entry] = operation.apply(values[*entry], value);
    }
    let mut rows: Vec<usize> = entries.iter().map(|entry| entry / field.width()).collect();
    rows.sort_unstable();
    rows.dedup();
    let of_geoms = |model: &MjModel| rows.iter().map(|geom| model.geom_bodyid()[*geom] as usize).collect();
    let mut bodies: Vec<usize> = match field {
        ModelField::GeomSize => {
            rows.iter().for_each(|geom| bound(*geom, model));
            of_geoms(model)
        }
        ModelField::GeomPos => of_geoms(model),
        ModelField::BodyIpos => rows,
        _ => return,
    };
    bodies.dedup();
    bodies.into_iter().for_each(|body| refit(body, model));
}

/// Computes the bounds of a geom of a primitive shape from its size.
fn bound(geom: usize, model: &mut MjModel) {
    let [a, b, c] = model.geom_size()[geom];
    let (half, radius) = match model.geom_type()[geom] {
        MjtGeomBase::mjGEOM_SPHERE => ([a; 3], a),
        MjtGeomBase::mjGEOM_CAPSULE => ([a, a, a + b], a + b),
        MjtGeomBase::mjGEOM_CYLINDER => ([a, a, b], a.hypot(b)),
        MjtGeomBase::mjGEOM_ELLIPSOID => ([a, b, c], a.max(b).max(c)),
        _ => ([a, b, c], norm([a, b, c])),
    };
    model.geom_aabb_mut()[geom][3..].copy_from_slice(&half);
    model.geom_rbound_mut()[geom] = radius;
}

/// Computes the boxes of a body's collision tree from those of its geoms. They are in the frame of
/// the body's inertia.
fn refit(body: usize, model: &mut MjModel) {
    let first = model.body_bvhadr()[body];
    let Ok(first) = usize::try_from(first) else { return };
    let ipos = model.body_ipos()[body];
    let iquat = model.body_iquat()[body];
    // Children come after their parents.
    for volume in (first..first + model.body_bvhnum()[body] as usize).rev() {
        let (low, high) = match usize::try_from(model.bvh_nodeid()[volume]) {
            Ok(geom) => {
                let aabb = model.geom_aabb()[geom];
                let center = [aabb[0], aabb[1], aabb[2]];
                let half = [aabb[3], aabb[4], aabb[5]];
                let quaternion = model.geom_quat()[geom];
                let turned = |v: [f64; 3]| rotate_back(iquat, rotate(quaternion, v));
                let middle = add(rotate_back(iquat, sub(model.geom_pos()[geom], ipos)), turned(center));
                let axes: [[f64; 3]; 3] = std::array::from_fn(|i| {
                    turned(std::array::from_fn(|j| if i == j { half[i] } else { 0.0 }))
                });
                let extent: [f64; 3] = std::array::from_fn(|i| axes.iter().map(|axis| axis[i].abs()).sum());
                (sub(middle, extent), add(middle, extent))
            }
            Err(_) => {
                let bounds = model.bvh_child()[volume].map(|child| {
                    let [x, y, z, half @ ..] = model.bvh_aabb()[first + child as usize];
                    (sub([x, y, z], half), add([x, y, z], half))
                });
                let [(low_a, high_a), (low_b, high_b)] = bounds;
                (
                    std::array::from_fn(|i| low_a[i].min(low_b[i])),
                    std::array::from_fn(|i| high_a[i].max(high_b[i])),
                )
            }
        };
        let aabb = &mut model.bvh_aabb_mut()[volume];
        for i in 0..3 {
            (aabb[i], aabb[3 + i]) = (0.5 * (low[i] + high[i]), 0.5 * (high[i] - low[i]));
        }
    }
}

/// Clears MuJoCo's notes that the frame of a geom, of a site or of an inertia is that of its body
/// where they are apart now. MuJoCo would otherwise ignore the position.
pub(crate) fn separate_frames(model: &mut MjModel) {
    use MjtSameFrame as Same;
    let separated = |same: Same, position: [f64; 3], ipos: [f64; 3]| match same {
        Same::mjSAMEFRAME_BODY if norm(position) > APART => Same::mjSAMEFRAME_BODYROT,
        Same::mjSAMEFRAME_INERTIA if norm(sub(position, ipos)) > APART => Same::mjSAMEFRAME_INERTIAROT,
        same => same,
    };
    for body in 0..model.nbody() as usize {
        model.body_sameframe_mut()[body] =
            separated(model.body_sameframe()[body], model.body_ipos()[body], [0.0; 3]);
    }
    for geom in 0..model.ngeom() as usize {
        let ipos = model.body_ipos()[model.geom_bodyid()[geom] as usize];
        model.geom_sameframe_mut()[geom] =
            separated(model.geom_sameframe()[geom], model.geom_pos()[geom], ipos);
    }
    for site in 0..model.nsite() as usize {
        let ipos = model.body_ipos()[model.site_bodyid()[site] as usize];
        model.site_sameframe_mut()[site] =
            separated(model.site_sameframe()[site], model.site_pos()[site], ipos);
    }
}
