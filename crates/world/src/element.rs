//! Elements of a model, looked up by name once and then plain indices.

/// A body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Body(pub(crate) usize);

impl Body {
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

/// A joint. A free joint has seven positions (point, quaternion) and six velocities (linear in the
/// world frame, angular in the body's own).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint {
    /// The index of its first generalized position.
    pub qpos: usize,
    /// The index of its first generalized velocity.
    pub dof: usize,
    /// The lower limit, rad or m.
    pub low: f64,
    /// The upper limit, rad or m.
    pub high: f64,
}
