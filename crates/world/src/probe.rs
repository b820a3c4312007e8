//! Measurements over the physics steps of a control step: contact forces of the robot, and the
//! motion of its arm.

use crate::frame::{add, cross, norm, sub};
use crate::{Actuator, Body, Equality, Joint, Model, Part, PartForces, PartMap, Rows, Servo, Site, World};

/// Number of forces: those of the robot on fixtures, on the ground, on itself and on the object,
/// that of the robot without its fingers on the object, and all of the robot but those on an object
/// that it carries. What the hand holds belongs to the robot.
pub const FORCES: usize = 6;

/// The elements of a model whose forces and motion are measured.
#[derive(Clone, Debug)]
pub struct Probe {
    /// The part of each shape.
    pub parts: PartMap,
    /// The weld that holds the object in the hand.
    pub weld: Option<Equality>,
    /// Whether the robot carries the object without a weld, as on a tray.
    pub carries: bool,
    /// The joints of the arm, which are hinges.
    pub joints: Vec<ProbedJoint>,
    /// The body of the tool.
    pub hand: Body,
    /// The center of the tool, which is fixed to the body.
    pub tool: Site,
}

/// A joint of the arm, and the limits that its motion is compared with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbedJoint {
    /// The joint.
    pub joint: Joint,
    /// Its servo.
    pub actuator: Actuator,
    /// Velocity limit, rad/s.
    pub max_velocity: f64,
    /// Acceleration limit, rad/s².
    pub max_acceleration: f64,
    /// Torque limit, N m.
    pub max_torque: f64,
}

/// Measurements over the physics steps of one control step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Readings {
    /// Largest forces, N.
    pub largest: [f64; FORCES],
    /// Sums of the forces over the physics steps, N.
    pub sums: [f64; FORCES],
    /// Largest speed of a joint, rad/s.
    pub speed: f64,
    /// Largest speed of a joint, as a share of its limit.
    pub speed_share: f64,
    /// Largest change of a joint's velocity over the control step, divided by its duration, as a
    /// share of the limit of the acceleration.
    pub acceleration_share: f64,
    /// Largest torque that a servo demands before it is limited, as a share of its limit.
    pub torque_share: f64,
    /// Largest speed of the tool, m/s, between the physics steps. The speed after the last one is
    /// that of the new state, and not measured.
    pub tool_speed: f64,
    /// Smallest distance of a joint to the end of its range, rad.
    pub limit_distance: f64,
}

impl Default for Readings {
    fn default() -> Readings {
        Readings { limit_distance: f64::INFINITY, ..Readings::read(&[0.0; Readings::SIZE]) }
    }
}

impl Readings {
    /// Number of numbers.
    pub const SIZE: usize = 2 * FORCES + 6;

    /// Returns the numbers, in the order of the fields.
    pub fn numbers(&self) -> [f64; Readings::SIZE] {
        let Readings { largest, sums, speed, speed_share, acceleration_share, torque_share, .. } = *self;
        let rest =
            [speed, speed_share, acceleration_share, torque_share, self.tool_speed, self.limit_distance];
        let mut numbers = [0.0; Readings::SIZE];
        let all = largest.iter().chain(&sums).chain(&rest);
        numbers.iter_mut().zip(all).for_each(|(to, from)| *to = *from);
        numbers
    }

    /// Returns the readings with these numbers.
    pub fn read(numbers: &[f64; Readings::SIZE]) -> Readings {
        let forces = |first: usize| std::array::from_fn(|force| numbers[first + force]);
        let rest = |index: usize| numbers[2 * FORCES + index];
        Readings {
            largest: forces(0),
            sums: forces(FORCES),
            speed: rest(0),
            speed_share: rest(1),
            acceleration_share: rest(2),
            torque_share: rest(3),
            tool_speed: rest(4),
            limit_distance: rest(5),
        }
    }
}

impl Probe {
    /// Returns the speed of the tool, m/s.
    pub fn tool_speed(&self, rows: &Rows<'_>) -> f64 {
        let (linear, angular) = rows.twist(self.hand);
        let arm = sub(rows.site_position(self.tool), rows.position(self.hand));
        norm(add(linear, cross(angular, arm)))
    }

    /// Returns the smallest distance of a joint to the end of its range, rad.
    pub fn limit_distance(&self, qpos: &[f64]) -> f64 {
        let distances = self.joints.iter().map(|ProbedJoint { joint, .. }| {
            let q = qpos[joint.qpos];
            (q - joint.low).min(joint.high - q)
        });
        distances.fold(f64::INFINITY, f64::min)
    }

    /// Returns which forces contain the contacts of each pair of parts, `[parts, parts]`: bit i is
    /// that of force i.
    pub fn pairs(&self, holds: bool) -> Pairs {
        pairs(holds, self.carries)
    }
}

/// For each pair of parts, the forces that contain its contacts, as bits.
type Pairs = [u8; Part::ALL.len() * Part::ALL.len()];

fn pairs(holds: bool, carries: bool) -> Pairs {
    let mut pairs = [0; Part::ALL.len() * Part::ALL.len()];
    for a in Part::ALL {
        for b in Part::ALL {
            let mut unit = PartForces::default();
            unit.add(a, b, 1.0);
            let bits = forces(&unit, holds, carries).into_iter().enumerate();
            pairs[a as usize * Part::ALL.len() + b as usize] =
                bits.map(|(force, size)| u8::from(size > 0.0) << force).sum();
        }
    }
    pairs
}

/// Returns the [`FORCES`].
fn forces(forces: &PartForces, holds: bool, carries: bool) -> [f64; FORCES] {
    use Part as P;
    let of_robot = |part| forces.between(P::Fingers, part) + forces.between(P::Arm, part);
    let of_held = |part| if holds { forces.between(P::Object, part) } else { 0.0 };
    let on_fixtures = of_robot(P::Fixture) + of_held(P::Fixture);
    let on_ground = of_robot(P::Ground) + of_held(P::Ground);
    let on_itself = of_robot(P::Arm) + forces.between(P::Fingers, P::Fingers);
    let on_object = of_robot(P::Object);
    let on_free_object = if holds || carries { 0.0 } else { on_object };
    [
        on_fixtures,
        on_ground,
        on_itself,
        on_object,
        forces.between(P::Arm, P::Object),
        on_fixtures + on_ground + on_itself + on_free_object,
    ]
}

/// A probe of worlds of MuJoCo C.
#[derive(Clone, Debug)]
pub struct ProbeRecorder {
    probe: Probe,
    /// Velocities at the start of the control step, and before the physics step.
    start: Vec<f64>,
    before: Vec<f64>,
    steps: u32,
    readings: Readings,
}

impl ProbeRecorder {
    /// Makes a recorder for worlds of `model`, or of models with the same document.
    pub fn new(probe: Probe, model: &Model) -> ProbeRecorder {
        let velocities = vec![0.0; model.qvel_size()];
        let readings = Readings::default();
        ProbeRecorder { probe, start: velocities.clone(), before: velocities, steps: 0, readings }
    }

    /// Starts a control step.
    pub fn clear(&mut self) {
        (self.steps, self.readings) = (0, Readings::default());
    }

    /// Returns the readings since the last [`clear`](Self::clear).
    pub fn readings(&self) -> &Readings {
        &self.readings
    }

    /// Takes a physics step, as [`World::step_servos`], and measures it.
    ///
    /// # Panics
    /// As [`World::step_servos`].
    pub fn step(&mut self, servos: &[Servo], targets: &[f64], world: &mut World) {
        self.before.copy_from_slice(world.qvel());
        if self.steps == 0 {
            self.start.copy_from_slice(&self.before);
        }
        self.steps += 1;
        world.step_servos(servos, targets);
        let probe = &self.probe;
        let readings = &mut self.readings;
        let world = &*world;
        let duration = f64::from(self.steps) * world.model().timestep();
        readings.acceleration_share = 0.0;
        let holds = probe.weld.is_some_and(|weld| world.rows().is_active(weld));
        let measured = forces(&world.part_forces(&probe.parts), holds, probe.carries);
        for (index, force) in measured.into_iter().enumerate() {
            readings.largest[index] = readings.largest[index].max(force);
            readings.sums[index] += force;
        }
        for probed in &probe.joints {
            let velocity = world.qvel()[probed.joint.dof];
            let acceleration = (velocity - self.start[probed.joint.dof]) / duration;
            let torque = world.servo_demand(probed.actuator);
            readings.speed = readings.speed.max(velocity.abs());
            readings.speed_share = readings.speed_share.max(velocity.abs() / probed.max_velocity);
            let acceleration = acceleration.abs() / probed.max_acceleration;
            readings.acceleration_share = readings.acceleration_share.max(acceleration);
            readings.torque_share = readings.torque_share.max(torque.abs() / probed.max_torque);
        }
        readings.limit_distance = readings.limit_distance.min(probe.limit_distance(world.qpos()));
        if self.steps > 1 {
            // Poses after a step are those of its start, where the velocities were these.
            let mut rows = world.rows();
            rows.qvel = &self.before;
            readings.tool_speed = readings.tool_speed.max(probe.tool_speed(&rows));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Forces between pairs of parts, each twice the one before, so that a sum has one meaning.
    const PAIRS: [(Part, Part, f64); 10] = [
        (Part::Object, Part::Fixture, 1.0),
        (Part::Fingers, Part::Fixture, 2.0),
        (Part::Arm, Part::Fixture, 4.0),
        (Part::Ground, Part::Object, 8.0),
        (Part::Arm, Part::Ground, 16.0),
        (Part::Arm, Part::Arm, 32.0),
        (Part::Fingers, Part::Arm, 64.0),
        (Part::Fingers, Part::Fingers, 128.0),
        (Part::Object, Part::Fingers, 256.0),
        (Part::Object, Part::Arm, 512.0),
    ];

    #[test]
    fn what_the_hand_holds_belongs_to_the_robot() {
        let mut between = PartForces::default();
        PAIRS.iter().for_each(|(a, b, force)| between.add(*a, *b, *force));
        for (holds, carries, expected) in [
            (true, false, [7.0, 24.0, 224.0, 768.0, 512.0, 255.0]),
            (false, true, [6.0, 16.0, 224.0, 768.0, 512.0, 246.0]),
            (false, false, [6.0, 16.0, 224.0, 768.0, 512.0, 1014.0]),
        ] {
            assert_eq!(forces(&between, holds, carries), expected);
            let pairs = pairs(holds, carries);
            let mut sums = [0.0; FORCES];
            for (a, b, size) in PAIRS {
                let bits = pairs[a as usize * Part::ALL.len() + b as usize];
                assert_eq!(bits, pairs[b as usize * Part::ALL.len() + a as usize]);
                for (force, sum) in sums.iter_mut().enumerate() {
                    *sum += f64::from(bits >> force & 1) * size;
                }
            }
            assert_eq!(sums, expected);
        }
    }

    #[test]
    fn readings_have_their_numbers_in_the_order_of_the_fields() {
        let numbers = std::array::from_fn(|index| index as f64);
        let readings = Readings::read(&numbers);
        assert_eq!(readings.numbers(), numbers);
        assert_eq!((readings.largest[5], readings.sums[0], readings.speed), (5.0, 6.0, 12.0));
        assert_eq!((readings.torque_share, readings.limit_distance), (15.0, 17.0));
    }
}
