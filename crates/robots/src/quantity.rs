//! Quantities that expressions read from a simulation.

use std::ops::Range;

use crate::expression::Reader;
use mishandle_world::{Body, Site, World};

/// A quantity of a simulation.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Quantity {
    /// Time since the start of the episode, s: control steps times their duration.
    Time,
    /// The value of an axis.
    Parameter(usize),
    /// Numbers that the episode remembers.
    Remembered(Range<usize>),
    /// The action of the control step, or of the last one.
    Action,
    /// Numbers of the model that no axis changes.
    Constants(Vec<f64>),
    /// Numbers of the observation, for policies that are expressions.
    Observed(Range<usize>),
    Positions(Vec<usize>),
    Velocities(Vec<usize>),
    Controls(Vec<usize>),
    ActuatorForces(Vec<usize>),
    BiasForces(Vec<usize>),
    BodyPosition(Body),
    BodyQuaternion(Body),
    BodyVelocity(Body),
    BodyAngularVelocity(Body),
    BodyAxis(Body, usize),
    InertialPosition(Body),
    CenterOfMass(Body),
    SitePosition(Site),
    SiteRotation(Site),
    GeomPosition(usize),
    Sensor(Range<usize>),
    ContactForces(ContactOwner),
    ExternalForces(Vec<Body>),
}

/// The element whose contacts are meant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ContactOwner {
    Geom(usize),
    Body(Body),
}

/// When a quantity is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Currency {
    /// At once.
    Plain,
    /// After forward kinematics.
    Pose,
    /// After a physics step: the values of its start.
    Dynamic,
}

impl Quantity {
    pub(crate) fn currency(&self) -> Currency {
        use Quantity as Q;
        match self {
            Q::Time | Q::Parameter(_) | Q::Remembered(_) | Q::Action | Q::Observed(_) | Q::Constants(_) => {
                Currency::Plain
            }
            Q::Positions(_) | Q::Velocities(_) | Q::Controls(_) => Currency::Plain,
            Q::BodyPosition(_) | Q::BodyQuaternion(_) | Q::BodyVelocity(_) | Q::BodyAngularVelocity(_) => {
                Currency::Pose
            }
            Q::BodyAxis(..) | Q::InertialPosition(_) => Currency::Pose,
            Q::SitePosition(_) | Q::SiteRotation(_) | Q::GeomPosition(_) => Currency::Pose,
            Q::ActuatorForces(_) | Q::BiasForces(_) | Q::CenterOfMass(_) => Currency::Dynamic,
            Q::Sensor(_) | Q::ContactForces(_) | Q::ExternalForces(_) => Currency::Dynamic,
        }
    }
}

/// The part of a simulation that expressions see.
pub(crate) struct View<'a> {
    pub world: &'a World,
    pub time: f64,
    pub parameters: &'a [f64],
    pub memory: &'a [f64],
    pub action: &'a [f64],
}

fn gather(from: &[f64], indices: &[usize], out: &mut [f64]) {
    out.iter_mut().zip(indices).for_each(|(out, index)| *out = from[*index]);
}

/// The column of a rotation matrix: an axis of the frame in world axes.
fn column(matrix: &[f64; 9], axis: usize) -> [f64; 3] {
    [matrix[axis], matrix[3 + axis], matrix[6 + axis]]
}

impl Reader<Quantity> for View<'_> {
    fn read(&mut self, what: &Quantity, out: &mut [f64]) {
        use Quantity as Q;
        let world = self.world;
        match what {
            Q::Time => out[0] = self.time,
            Q::Parameter(index) => out[0] = self.parameters[*index],
            Q::Remembered(range) => out.copy_from_slice(&self.memory[range.clone()]),
            Q::Action => out.copy_from_slice(self.action),
            Q::Constants(values) => out.copy_from_slice(values),
            // Only policies read it, which have a reader of their own.
            Q::Observed(_) => out.fill(f64::NAN),
            Q::Positions(indices) => gather(world.qpos(), indices, out),
            Q::Velocities(indices) => gather(world.qvel(), indices, out),
            Q::Controls(indices) => gather(world.ctrl(), indices, out),
            Q::ActuatorForces(indices) => gather(world.actuator_forces(), indices, out),
            Q::BiasForces(indices) => gather(world.bias_forces(), indices, out),
            Q::BodyPosition(body) => out.copy_from_slice(&world.rows().position(*body)),
            Q::BodyQuaternion(body) => out.copy_from_slice(&world.rows().quaternion(*body)),
            Q::BodyVelocity(body) => out.copy_from_slice(&world.rows().twist(*body).0),
            Q::BodyAngularVelocity(body) => out.copy_from_slice(&world.rows().twist(*body).1),
            Q::BodyAxis(body, axis) => out.copy_from_slice(&column(&world.body_rotation(*body), *axis)),
            Q::InertialPosition(body) => out.copy_from_slice(&world.body_inertial_position(*body)),
            Q::CenterOfMass(body) => out.copy_from_slice(&world.subtree_com(*body)),
            Q::ExternalForces(bodies) => {
                for (out, body) in out.chunks_exact_mut(6).zip(bodies) {
                    out.copy_from_slice(&world.external_force(*body));
                }
            }
            Q::SitePosition(site) => out.copy_from_slice(&world.rows().site_position(*site)),
            Q::SiteRotation(site) => out.copy_from_slice(&world.rows().site_rotation(*site)),
            Q::GeomPosition(geom) => out.copy_from_slice(&world.geom_position(*geom)),
            Q::Sensor(range) => out.copy_from_slice(&world.sensordata()[range.clone()]),
            Q::ContactForces(_) => out.fill(f64::NAN),
        }
    }

    fn list(&mut self, what: &Quantity, each: &mut dyn FnMut(f64)) {
        match what {
            Quantity::ContactForces(ContactOwner::Geom(geom)) => {
                self.world.contact_forces_of_geom(*geom, each);
            }
            Quantity::ContactForces(ContactOwner::Body(body)) => {
                self.world.contact_forces_of_body(*body, each);
            }
            _ => {}
        }
    }
}
