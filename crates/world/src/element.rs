//! Elements of a model, looked up by name once and then plain indices.

use mujoco_rs::prelude::{MjtJoint, MjtObjBase};

/// A kind of element that a model has a list of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ElementKind {
    /// Bodies. The first one is the world.
    Body,
    /// Joints.
    Joint,
    /// Geoms, the shapes of bodies.
    Geom,
    /// Sites.
    Site,
    /// Cameras.
    Camera,
    /// Pairs of geoms whose contact has its own parameters.
    Pair,
    /// Flexes: deformable objects.
    Flex,
    /// Equality constraints.
    Equality,
    /// Tendons.
    Tendon,
    /// Actuators.
    Actuator,
    /// Sensors.
    Sensor,
    /// Keyframes.
    Key,
}

impl ElementKind {
    /// All kinds.
    pub const ALL: [ElementKind; 12] = [
        ElementKind::Body,
        ElementKind::Joint,
        ElementKind::Geom,
        ElementKind::Site,
        ElementKind::Camera,
        ElementKind::Pair,
        ElementKind::Flex,
        ElementKind::Equality,
        ElementKind::Tendon,
        ElementKind::Actuator,
        ElementKind::Sensor,
        ElementKind::Key,
    ];

    /// Returns the name of the kind in messages.
    pub fn label(self) -> &'static str {
        self.row().1
    }

    pub(crate) fn object(self) -> MjtObjBase {
        self.row().0
    }

    fn row(self) -> (MjtObjBase, &'static str) {
        match self {
            ElementKind::Body => (MjtObjBase::mjOBJ_BODY, "body"),
            ElementKind::Joint => (MjtObjBase::mjOBJ_JOINT, "joint"),
            ElementKind::Geom => (MjtObjBase::mjOBJ_GEOM, "geom"),
            ElementKind::Site => (MjtObjBase::mjOBJ_SITE, "site"),
            ElementKind::Camera => (MjtObjBase::mjOBJ_CAMERA, "camera"),
            ElementKind::Pair => (MjtObjBase::mjOBJ_PAIR, "contact pair"),
            ElementKind::Flex => (MjtObjBase::mjOBJ_FLEX, "flex"),
            ElementKind::Equality => (MjtObjBase::mjOBJ_EQUALITY, "equality constraint"),
            ElementKind::Tendon => (MjtObjBase::mjOBJ_TENDON, "tendon"),
            ElementKind::Actuator => (MjtObjBase::mjOBJ_ACTUATOR, "actuator"),
            ElementKind::Sensor => (MjtObjBase::mjOBJ_SENSOR, "sensor"),
            ElementKind::Key => (MjtObjBase::mjOBJ_KEY, "keyframe"),
        }
    }
}

/// A kind of joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// A point and a quaternion; linear velocity in the world frame, angular in the body's own.
    Free,
    /// A quaternion; the angular velocity is in the body's own frame.
    Ball,
    /// A length along an axis.
    Slide,
    /// An angle about an axis.
    Hinge,
}

impl JointKind {
    /// Returns the number of generalized positions.
    pub fn positions(self) -> usize {
        match self {
            JointKind::Free => 7,
            JointKind::Ball => 4,
            JointKind::Slide | JointKind::Hinge => 1,
        }
    }

    /// Returns the number of generalized velocities.
    pub fn velocities(self) -> usize {
        match self {
            JointKind::Free => 6,
            JointKind::Ball => 3,
            JointKind::Slide | JointKind::Hinge => 1,
        }
    }

    pub(crate) fn of(kind: MjtJoint) -> JointKind {
        match kind {
            MjtJoint::mjJNT_FREE => JointKind::Free,
            MjtJoint::mjJNT_BALL => JointKind::Ball,
            MjtJoint::mjJNT_SLIDE => JointKind::Slide,
            MjtJoint::mjJNT_HINGE => JointKind::Hinge,
        }
    }
}

/// A body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Body(pub(crate) usize);

impl Body {
    /// The world.
    pub const WORLD: Body = Body(0);

    /// Returns the index of the body in the model.
    pub fn index(self) -> usize {
        self.0
    }
}

/// A site: a named frame on a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Site(pub(crate) usize);

impl Site {
    /// Returns the index of the site in the model.
    pub fn index(self) -> usize {
        self.0
    }
}

/// An actuator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Actuator(pub(crate) usize);

impl Actuator {
    /// Returns the index of the actuator in the model.
    pub fn index(self) -> usize {
        self.0
    }
}

/// An equality constraint, which can be switched on and off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Equality(pub(crate) usize);

impl Equality {
    /// Returns the index of the constraint in the model.
    pub fn index(self) -> usize {
        self.0
    }
}

/// A mocap body: its pose is set and not simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mocap(pub(crate) usize);

impl Mocap {
    /// Returns the index of the body among the mocap bodies of the model.
    pub fn index(self) -> usize {
        self.0
    }
}

/// A deformable object (flex) such as a cloth, whose vertices are bodies that translate but do not
/// rotate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flex {
    pub(crate) body: usize,
    pub(crate) dof: usize,
    /// The number of vertices.
    pub vertices: usize,
}

impl Flex {
    /// Returns the bodies of the vertices.
    pub fn bodies(&self) -> impl Iterator<Item = Body> {
        (self.body..self.body + self.vertices).map(Body)
    }
}

/// A joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint {
    /// Its kind, which says how many positions and velocities it has.
    pub kind: JointKind,
    /// The index of its first generalized position.
    pub qpos: usize,
    /// The index of its first generalized velocity.
    pub dof: usize,
    /// The lower limit, rad or m.
    pub low: f64,
    /// The upper limit, rad or m.
    pub high: f64,
}
