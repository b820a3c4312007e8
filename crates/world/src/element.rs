//! Elements of a model, found by name once: plain indices in a step.

/// A body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Body(pub(crate) usize);

/// A site: a named frame on a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Site(pub(crate) usize);

/// An actuator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Actuator(pub(crate) usize);

/// An equality constraint, which can be switched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Equality(pub(crate) usize);

/// A body whose pose is set, not simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mocap(pub(crate) usize);

/// A flex whose vertices are bodies that move along the world's axes and do not turn: a cloth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flex {
    pub(crate) body: usize,
    pub(crate) dof: usize,
    /// Number of vertices.
    pub vertices: usize,
}

impl Flex {
    /// The bodies that are its vertices.
    pub fn bodies(&self) -> impl Iterator<Item = Body> {
        (self.body..self.body + self.vertices).map(Body)
    }
}

/// A joint. A free joint has seven positions (point, quaternion) and six velocities (linear in the world frame,
/// angular in the body's own).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint {
    /// Index of its first generalised position.
    pub qpos: usize,
    /// Index of its first generalised velocity.
    pub dof: usize,
    /// Lower limit, rad or m.
    pub low: f64,
    /// Upper limit, rad or m.
    pub high: f64,
}
