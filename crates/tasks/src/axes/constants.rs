//! Axes of the model's constants, and the elements of the model that axes change.

use mishandle_rollout::{Axis, AxisKind, AxisValues};
use mishandle_world::{Actuator, Body, Change, Equality, Joint, Mocap, Model, World, WorldError};

use super::Parameter;
use crate::definition::{Attachment, Definition};
use crate::robot::{ARM_JOINTS, JOINT_NAMES, JOINTS, Panda};

/// Constant of the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Constant {
    /// Factor of the sliding friction of all contacts.
    Friction,
    /// Factor of the mass of an entry of [`Variations::masses`](crate::Variations::masses).
    Mass(usize),
    /// Factor of the size of an entry of [`Variations::sizes`](crate::Variations::sizes).
    Size(usize),
    /// Factor of the stiffness and damping of the arm servos.
    Gain,
    /// Additional damping of the arm joints, N m s/rad.
    Damping,
    /// Mass at the hand, kg.
    Payload,
    /// Rotation of gravity about the world's x or y axis, rad.
    GravityTilt(usize),
}

/// Largest tilt of gravity about each axis, rad.
const MAX_TILT: f64 = 0.04;

/// Returns the name of the axis of the size of a body.
pub(crate) fn size_axis(body: &str) -> String {
    format!("{body}_size_scale")
}

pub(super) fn constants(definition: &Definition) -> Vec<(Axis, Parameter)> {
    let scale = |name: &str, [low, high]: [f64; 2], meaning: &str| {
        let axis = Axis::new(AxisKind::Model, name, "", [low, high], Some(1.0));
        axis.with_values(AxisValues::Logarithmic).meaning(meaning)
    };
    let mut axes = Vec::new();
    if definition.variations.friction {
        let meaning = "factor of the sliding friction of all contacts";
        axes.push((scale("friction_scale", [0.5, 2.0], meaning), Constant::Friction));
    }
    for (index, body) in definition.variations.masses.iter().enumerate() {
        let meaning = format!("factor of the mass and inertia of the {body}");
        axes.push((scale(&format!("{body}_mass_scale"), [0.5, 2.0], &meaning), Constant::Mass(index)));
    }
    for (index, body) in definition.variations.sizes.iter().enumerate() {
        let meaning = format!("factor of the size of the {body}; its mass does not change");
        axes.push((scale(&size_axis(body), [0.95, 1.05], &meaning), Constant::Size(index)));
    }
    let gain = "factor of the stiffness and damping of the arm servos; their velocity limits do not change";
    axes.push((scale("servo_gain_scale", [0.8, 1.25], gain), Constant::Gain));
    let damping = Axis::new(AxisKind::Model, "joint_damping", "N m s/rad", [0.0, 10.0], Some(0.0))
        .meaning("additional viscous damping of each arm joint");
    axes.push((damping, Constant::Damping));
    let payload = Axis::new(AxisKind::Model, "payload", "kg", [0.0, 0.5], Some(0.0))
        .meaning("point mass at the hand, which the gravity compensation does not know");
    axes.push((payload, Constant::Payload));
    if definition.variations.friction {
        for (index, axis) in ["x", "y"].into_iter().enumerate() {
            let tilt = Axis::new(
                AxisKind::Model,
                &format!("gravity_tilt_{axis}"),
                "rad",
                [-MAX_TILT, MAX_TILT],
                Some(0.0),
            );
            let meaning =
                format!("rotation of gravity about the world's {axis} axis, as on a table that is not level");
            axes.push((tilt.meaning(&meaning), Constant::GravityTilt(index)));
        }
    }
    axes.into_iter().map(|(axis, constant)| (axis, Parameter::Constant(constant))).collect()
}

/// Elements of the model that axes modify.
#[derive(Clone, Debug)]
pub(crate) struct Elements {
    masses: Vec<Vec<Body>>,
    sizes: Vec<Body>,
    pub hand: Body,
    /// Bodies that start where the hand holds them, see [`followers`].
    followers: Vec<Body>,
    weld: Option<Equality>,
    arm: Panda,
    actuators: Vec<Actuator>,
    pub thrown: Option<Joint>,
    pub push: Vec<Body>,
    pub jump: Option<Mocap>,
}

impl Elements {
    pub(crate) fn new(definition: &Definition, model: &Model, panda: Panda) -> Result<Elements, WorldError> {
        let variations = &definition.variations;
        Ok(Elements {
            masses: variations.masses.iter().map(|name| bodies(model, name)).collect::<Result<_, _>>()?,
            sizes: variations.sizes.iter().map(|name| model.body(name)).collect::<Result<_, _>>()?,
            hand: model.body("hand")?,
            followers: followers(definition, model)?,
            weld: definition
                .held
                .filter(|held| held.attachment == Attachment::Weld)
                .map(|held| model.equality(held.name))
                .transpose()?,
            thrown: variations.thrown.map(|name| model.joint(name)).transpose()?,
            arm: panda,
            actuators: JOINT_NAMES[..ARM_JOINTS]
                .iter()
                .map(|name| model.actuator(name))
                .collect::<Result<_, _>>()?,
            push: variations.push.map_or(Ok(Vec::new()), |(name, _)| bodies(model, name))?,
            jump: variations.jump.map(|name| model.mocap(name)).transpose()?,
        })
    }

    /// Moves the joints from their `usual` positions to `q`, and what starts in the hand with it.
    pub(crate) fn move_start(
        &self,
        panda: &Panda,
        usual: &[f64; JOINTS],
        q: &[f64; JOINTS],
        world: &mut World,
    ) {
        panda.place(usual, world);
        world.refresh();
        let from = world.pose(self.hand);
        panda.place(q, world);
        world.refresh();
        let to = world.pose(self.hand);
        world.carry(&self.followers, from, to);
    }

    /// Returns the change of the model for a value of a constant.
    pub(crate) fn change(&self, constant: Constant, value: f64) -> Change {
        match constant {
            Constant::Friction => Change::Friction(value),
            Constant::Mass(index) => Change::Mass(self.masses[index].clone(), value),
            Constant::Size(index) => Change::Size(vec![self.sizes[index]], value),
            Constant::Payload => Change::Payload(self.hand, value),
            Constant::GravityTilt(axis) => Change::GravityTilt(axis, value),
            Constant::Gain => Change::Gain(self.actuators.clone(), value),
            Constant::Damping => Change::Damping(self.arm.joints()[..ARM_JOINTS].to_vec(), value),
        }
    }

    /// Returns the changes of the model for a slip along the x and z axes of the hand, m.
    pub(crate) fn slip(&self, slip: [f64; 2]) -> impl Iterator<Item = Change> {
        let weld = self.weld;
        [(0, slip[0]), (2, slip[1])].into_iter().filter_map(move |(axis, shift)| {
            (shift != 0.0).then(|| weld.map(|weld| Change::WeldShift(weld, axis, shift))).flatten()
        })
    }
}

/// Returns the bodies besides the hand whose start moves with it: a welded object, or the object of
/// the task that a part of the hand carries or is about to carry. A thrown object flies where it
/// was thrown.
fn followers(definition: &Definition, model: &Model) -> Result<Vec<Body>, WorldError> {
    let Some(held) = definition.held else { return Ok(Vec::new()) };
    match (held.attachment, definition.object) {
        (Attachment::Weld, _) => bodies(model, held.name),
        (Attachment::Fixed, Some(object)) if definition.variations.thrown.is_none() => bodies(model, object),
        (Attachment::Fixed, _) => Ok(Vec::new()),
    }
}

/// Returns the body with this name, or the bodies of the vertices of the flex with this name.
fn bodies(model: &Model, name: &str) -> Result<Vec<Body>, WorldError> {
    match model.flex(name) {
        Ok(flex) => Ok(flex.bodies().collect()),
        Err(_) => model.body(name).map(|body| vec![body]),
    }
}
