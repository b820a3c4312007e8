//! Action interfaces: how the actions of a policy become joint targets.
//!
//! The world is the same for all controllers: an action moves the targets of the joints. An
//! [`ActionInterface`] belongs to the controller and stands between its policy and that action.

use std::fmt::Write;

use serde::{Deserialize, Serialize};

use crate::{ControllerError, bytes_hash};

/// The name of the part of an observation with the joint targets, mapped from the ranges of the
/// joints to [-1, 1].
pub const JOINT_TARGETS: &str = "joint_targets";

/// How the first actions of a policy, one for each joint of an arm, become its targets.
///
/// An action of 1 asks for the largest velocity of the commanded motion. A [limiter](ActionLimiter)
/// keeps velocity and acceleration of this motion, and stops it before the ends of the range. The
/// other actions pass unchanged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActionInterface {
    /// Largest commanded velocity of each joint, rad/s.
    pub velocity: Vec<f64>,
    /// Largest commanded acceleration of each joint, rad/s².
    pub acceleration: Vec<f64>,
    /// Largest velocity of the target of each joint, rad/s. A servo demands a torque in proportion
    /// to the step of its target.
    pub target_velocity: Vec<f64>,
    /// Distance that each target keeps from the ends of the range of its joint, rad.
    pub margin: f64,
    /// Time by which the targets lead the commanded motion, s. With the lag of the servos, the
    /// joints follow the commanded motion; with 0, the targets are the commanded motion.
    pub lead: f64,
}

/// Returns the hash of a controller from the hash of its policy and its action interface. Without
/// an interface, it is the hash of the policy.
pub fn interface_hash(policy_hash: String, interface: Option<&ActionInterface>) -> String {
    let Some(ActionInterface { velocity, acceleration, target_velocity, margin, lead }) = interface else {
        return policy_hash;
    };
    let mut text = policy_hash;
    for (name, numbers) in [
        ("velocity", velocity.as_slice()),
        ("acceleration", acceleration),
        ("target velocity", target_velocity),
        ("margin", &[*margin]),
        ("lead", &[*lead]),
    ] {
        // Writing to a text cannot fail.
        let _ = write!(text, "\n{name} {numbers:?}");
    }
    bytes_hash(text.as_bytes())
}

/// The targets of an environment, which an interface moves.
#[derive(Clone, Debug, PartialEq)]
pub struct JointTargets {
    /// Index of the first joint position in an observation, mapped from its range to [-1, 1].
    pub positions: usize,
    /// Index of the first target in an observation, mapped in the same way.
    pub targets: usize,
    /// Ends of the range of each joint of the arm, rad.
    pub ranges: Vec<[f64; 2]>,
    /// Change of a target per control step under an action of 1, rad.
    pub step: f64,
    /// Duration of a control step, s.
    pub control_dt: f64,
}

/// The rate limiter of an interface.
///
/// The target r of a joint leads the commanded position c, which moves at v, by the lead L:
/// r = c + L v. With the velocity v₀ of the control step before, the limits V and A, the duration h
/// of a control step, and the distances D of c from the ends of the range (less the margin),
///
/// ```text
/// v = clamp(V a, -b(D_low), b(D_high)) within v₀ ± A h, ± V and (L v₀ ± R h) / (L + h)
/// r moves by v h + L (v - v₀)
/// ```
///
/// where R is the limit of the target's velocity and b is the [`stopping_velocity`]. So the
/// commanded motion keeps V and A, the target keeps R, and a target whose motion starts at rest
/// inside its range never leaves it. The acceleration changes by at most 2 A
/// in a control step, so the jerk is at most 2 A / h.
///
/// A controller that starts, also one that takes over in motion, has a joint at its position q with
/// the velocity that its target demands: v₀ = (r - q) / L, at most V. Without a lead, it has it at
/// the target, at rest. At the start of an episode, both are the same.
///
/// Noise and faults act on actions after the limiter and move a target away from c + L v, by m. The
/// limiter sees m, and the next action also takes back the share k of it. Where actions or
/// observations are late, the whole of it would be taken back again and again until the first
/// action shows, and the target would oscillate. So k is the regression of what was undone on what
/// was taken back, t = k m, over all joints and about half a second:
///
/// ```text
/// k = Σ (m₀ - m) t₀ / Σ t₀², at least 0.1 and at most 1
/// ```
///
/// It is 1 without a delay, whatever the noise is. With a delay of d control steps, a target
/// oscillates without end at the gain 2 sin(π / (4 d + 2)). The regression finds half of that gain
/// in this oscillation, so k falls before it grows.
///
/// # Example
/// ```
/// use mishandle_controllers::{ActionInterface, ActionLimiter, JointTargets};
/// let interface =
///     ActionInterface { velocity: vec![2.0], acceleration: vec![10.0], target_velocity: vec![2.0], margin: 0.0, lead: 0.0 };
/// let targets = JointTargets {
///     positions: 0,
///     targets: 1,
///     ranges: vec![[-1.0, 1.0]],
///     step: 0.25,
///     control_dt: 0.1,
/// };
/// let limiter = ActionLimiter::new(&interface, targets)?;
/// let (mut memory, mut action) = (vec![0.0; limiter.memory_size()], [1.0, 0.5]);
/// limiter.reset(&mut memory);
/// limiter.limit(&[0.0, 0.0], &mut memory, &mut action);
/// // 10 rad/s² for 0.1 s: 1 rad/s, which moves the target by 0.1 rad, 0.4 of a step.
/// assert!((limiter.commanded_velocity(0, &[0.0, 0.4 * 0.25], &memory) - 1.0).abs() < 1e-6);
/// assert_eq!(action, [0.4, 0.5]);
/// # Ok::<(), mishandle_controllers::ControllerError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ActionLimiter {
    joints: Vec<JointLimiter>,
    lead: f64,
    targets: JointTargets,
}

impl ActionLimiter {
    /// Creates the limiter of an interface for these targets.
    ///
    /// # Errors
    /// If the interface has another number of joints, a limit is not a positive number, the margin
    /// leaves nothing of a range, or the lead is not a duration.
    pub fn new(interface: &ActionInterface, targets: JointTargets) -> Result<ActionLimiter, ControllerError> {
        let ActionInterface { velocity, acceleration, target_velocity, margin, lead } = interface;
        let expected = targets.ranges.len();
        for (what, limits) in [
            ("velocities", velocity),
            ("accelerations", acceleration),
            ("velocities of the targets", target_velocity),
        ] {
            if limits.len() != expected {
                return Err(ControllerError::InterfaceJoints { what, expected, found: limits.len() });
            }
            if let Some(found) = limits.iter().find(|limit| !(**limit > 0.0 && limit.is_finite())) {
                return Err(ControllerError::InterfaceLimit { what, found: *found });
            }
        }
        let narrowest = targets.ranges.iter().map(|[low, high]| high - low).fold(f64::INFINITY, f64::min);
        let bounds = [("margin", *margin, 0.5 * narrowest, "rad"), ("lead", *lead, MAX_LEAD, "s")];
        for (what, found, below, unit) in bounds {
            if !(0.0..below).contains(&found) {
                return Err(ControllerError::InterfaceNumber { what, found, below, unit });
            }
        }
        let dt = targets.control_dt;
        for joint in 0..expected {
            // A target at rest must be able to begin to brake.
            let least = acceleration[joint] * (dt + lead);
            if target_velocity[joint] < least {
                return Err(ControllerError::TargetVelocity { joint, found: target_velocity[joint], least });
            }
        }
        let joints = targets.ranges.iter().enumerate().map(|(joint, range)| JointLimiter {
            range: *range,
            ends: [range[0] + margin, range[1] - margin],
            velocity: velocity[joint],
            change: acceleration[joint] * dt,
            target_step: target_velocity[joint] * dt,
        });
        Ok(ActionLimiter { joints: joints.collect(), lead: *lead, targets })
    }

    /// Returns the length of the memory of a simulation: the two sums of the regression, and what
    /// is known of each joint.
    pub fn memory_size(&self) -> usize {
        SUMS + KNOWN * self.joints.len()
    }

    /// Writes the memory of a controller that starts.
    pub fn reset(&self, memory: &mut [f64]) {
        memory.fill(NOT_STARTED);
    }

    /// Returns the commanded velocity of a joint in the control step before, rad/s.
    pub fn commanded_velocity(&self, joint: usize, observation: &[f32], memory: &[f64]) -> f64 {
        self.commanded(joint, observation, memory)[0]
    }

    /// Returns the commanded position of a joint, rad.
    pub fn commanded_position(&self, joint: usize, observation: &[f32], memory: &[f64]) -> f64 {
        self.commanded(joint, observation, memory)[1]
    }

    /// Returns velocity (rad/s) and position (rad) of the commanded motion of a joint.
    fn commanded(&self, joint: usize, observation: &[f32], memory: &[f64]) -> [f64; 2] {
        let [velocity, position, _] = known(joint, memory);
        if velocity != NOT_STARTED {
            return [velocity, position];
        }
        let target = self.target(joint, observation);
        if self.lead == 0.0 {
            return [0.0, target];
        }
        let most = self.joints[joint].velocity;
        let position = self.position(joint, observation);
        [((target - position) / self.lead).clamp(-most, most), position]
    }

    /// Returns the distance by which the target of a joint was moved away, rad.
    fn moved_away(&self, joint: usize, observation: &[f32], memory: &[f64]) -> f64 {
        let [velocity, position] = self.commanded(joint, observation, memory);
        self.target(joint, observation) - (position + self.lead * velocity)
    }

    /// Continues the regression, and returns the share that this action takes back.
    fn share_to_take_back(&self, observation: &[f32], memory: &mut [f64]) -> f64 {
        if memory[0] == NOT_STARTED {
            memory[..SUMS].fill(PRIOR);
            return 1.0;
        }
        let last = share(memory);
        let mut sums = [memory[0], memory[1]].map(|sum| KEPT * sum + LEAST_SUM);
        for joint in 0..self.joints.len() {
            let [velocity, _, before] = known(joint, memory);
            if velocity != NOT_STARTED {
                let taken = last * before;
                sums[0] += (before - self.moved_away(joint, observation, memory)) * taken;
                sums[1] += taken * taken;
            }
        }
        memory[..SUMS].copy_from_slice(&sums);
        share(memory)
    }

    fn target(&self, joint: usize, observation: &[f32]) -> f64 {
        self.joints[joint].unmapped(observation[self.targets.targets + joint])
    }

    fn position(&self, joint: usize, observation: &[f32]) -> f64 {
        self.joints[joint].unmapped(observation[self.targets.positions + joint])
    }

    /// Replaces the action of a policy by an action of the environment. It does not change NaN.
    pub fn limit(&self, observation: &[f32], memory: &mut [f64], action: &mut [f32]) {
        let dt = self.targets.control_dt;
        let share = self.share_to_take_back(observation, memory);
        for (index, (joint, action)) in self.joints.iter().zip(action).enumerate() {
            if action.is_nan() {
                continue;
            }
            let [last, commanded] = self.commanded(index, observation, memory);
            let moved = self.moved_away(index, observation, memory);
            let desired = f64::from(*action).clamp(-1.0, 1.0) * joint.velocity;
            let velocity = joint.velocity(last, commanded, desired, dt, self.lead);
            let way = velocity * dt + self.lead * (velocity - last) - share * moved;
            *action = (way / self.targets.step) as f32;
            let known = [velocity, commanded + velocity * dt, moved];
            memory[SUMS + KNOWN * index..][..KNOWN].copy_from_slice(&known);
        }
    }
}

/// Numbers of the memory for the regression.
const SUMS: usize = 2;

/// Numbers of the memory for each joint: velocity (rad/s) and position (rad) of its commanded
/// motion, and the distance by which its target was moved away (rad).
const KNOWN: usize = 3;

/// The content of both sums at the start, and an addition to both in each control step, rad². So
/// the share begins at 1, and it is a number after a long rest.
const PRIOR: f64 = 1e-4;
const LEAST_SUM: f64 = 1e-18;

/// The smallest share. It is stable for all delays of the tasks, and shows what was undone.
const LEAST_SHARE: f64 = 0.1;

/// Factor by which the sums forget in a control step.
const KEPT: f64 = 0.97;

fn known(joint: usize, memory: &[f64]) -> [f64; KNOWN] {
    std::array::from_fn(|i| memory[SUMS + KNOWN * joint + i])
}

fn share(memory: &[f64]) -> f64 {
    (memory[0] / memory[1]).clamp(LEAST_SHARE, 1.0)
}

/// The memory of a controller that starts.
const NOT_STARTED: f64 = f64::INFINITY;

/// Bound of the lead, s. A longer one would move the targets by more than an action can.
const MAX_LEAD: f64 = 1.0;

#[derive(Clone, Debug, PartialEq)]
struct JointLimiter {
    range: [f64; 2],
    /// Ends between which the target stays.
    ends: [f64; 2],
    velocity: f64,
    /// Largest change of the velocity in a control step.
    change: f64,
    /// Largest step of the target, rad.
    target_step: f64,
}

impl JointLimiter {
    /// Returns a position or target from its number in the observation.
    fn unmapped(&self, seen: f32) -> f64 {
        let [low, high] = self.range;
        low + 0.5 * (f64::from(seen) + 1.0) * (high - low)
    }

    fn velocity(&self, last: f64, commanded: f64, desired: f64, dt: f64, lead: f64) -> f64 {
        let [low, high] = self.ends;
        let forward = stopping_velocity(high - commanded, self.change, dt, lead);
        let backward = stopping_velocity(commanded - low, self.change, dt, lead);
        let allowed = desired.clamp(-backward, forward);
        let [least, most] = [-1.0, 1.0].map(|sign| {
            let by_target = (lead * last + sign * self.target_step) / (lead + dt);
            let by_change = last + sign * self.change;
            if sign < 0.0 { by_target.max(by_change) } else { by_target.min(by_change) }
        });
        allowed.clamp(least, most).clamp(-self.velocity, self.velocity)
    }
}

/// Returns the largest velocity from which a motion stops such that neither it nor a target that
/// leads it by `lead` passes an end at `distance`, if the velocity changes by at most `change`
/// between control steps of the duration `dt`; 0 beyond the end.
///
/// The motion continues at b for one control step, then at b - change, and so on. Its target is
/// farthest when the velocity is l = lead · change / dt: at lower velocities, the lead shrinks
/// faster than the motion advances.
///
/// # Example
/// ```
/// use mishandle_controllers::stopping_velocity;
/// // 3 + 2 + 1 steps of 0.5 s.
/// assert_eq!(stopping_velocity(3.0, 1.0, 0.5, 0.0), 3.0);
/// // 0.25 s at 1 m/s, and a lead of 0.75 s.
/// assert_eq!(stopping_velocity(1.0, 1.0, 0.25, 0.75), 1.0);
/// ```
pub fn stopping_velocity(distance: f64, change: f64, dt: f64, lead: f64) -> f64 {
    let distance = distance.max(0.0);
    let turning = lead * change / dt;
    let rest = distance - turning * (dt + lead);
    if rest <= 0.0 {
        return distance / (dt + lead);
    }
    // Above l, a velocity of l + x in n < x / change <= n + 1 needs the distance
    // ((n + 1) x - change n (n + 1) / 2) dt + lead x besides that of l.
    let slope = 1.0 + 2.0 * lead / dt;
    let steps = (0.5 * ((slope * slope + 8.0 * rest / (change * dt)).sqrt() - slope)).floor();
    turning + (rest + 0.5 * dt * change * steps * (steps + 1.0)) / (dt * (steps + 1.0) + lead)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use mishandle_rollout::{Seed, Stream};

    use super::*;

    const DT: f64 = 1.0 / 60.0;
    const STEP: f64 = 0.125;

    /// Franka's limits of two joints, with the jerk, rad/s³.
    const VELOCITY: [f64; 2] = [2.175, 2.61];
    const ACCELERATION: [f64; 2] = [7.5, 20.0];
    const TARGET_VELOCITY: [f64; 2] = [2.5, 5.0];
    const JERK: [f64; 2] = [3750.0, 10000.0];
    const RANGES: [[f64; 2]; 2] = [[-1.7628, 1.7628], [-0.0175, 3.7525]];
    const MARGIN: f64 = 0.05;

    /// Rounding of an observed target and of an action to single precision.
    const TINY: f64 = 1e-6;

    /// The lag of the servos, s.
    const LAG: f64 = 0.2;

    fn interface(lead: f64) -> ActionInterface {
        let (velocity, acceleration) = (VELOCITY.to_vec(), ACCELERATION.to_vec());
        let target_velocity = TARGET_VELOCITY.to_vec();
        ActionInterface { velocity, acceleration, target_velocity, margin: MARGIN, lead }
    }

    fn targets() -> JointTargets {
        JointTargets { positions: 0, targets: 2, ranges: RANGES.to_vec(), step: STEP, control_dt: DT }
    }

    /// An environment whose actions move targets, and what a limiter remembers.
    struct Arm {
        limiter: ActionLimiter,
        lead: f64,
        targets: [f64; 2],
        memory: Vec<f64>,
        /// Velocity of the commanded motion.
        velocity: [f64; 2],
    }

    impl Arm {
        /// Makes an arm whose targets belong to a commanded motion with these positions and
        /// velocities.
        fn new(lead: f64, positions: [f64; 2], velocity: [f64; 2]) -> Arm {
            let limiter = ActionLimiter::new(&interface(lead), targets()).unwrap();
            let targets = [0, 1].map(|i| positions[i] + lead * velocity[i]);
            let mut memory = vec![PRIOR; SUMS];
            (0..2).for_each(|i| memory.extend([velocity[i], positions[i], 0.0]));
            Arm { limiter, lead, targets, memory, velocity }
        }

        /// Takes a control step and updates the velocity of the commanded motion, of which the
        /// targets are the only trace.
        fn step(&mut self, desired: [f32; 2]) {
            let action = self.limited(desired, self.targets);
            self.apply(action);
        }

        /// Returns what the limiter makes of an action when it sees these targets.
        fn limited(&mut self, desired: [f32; 2], seen: [f64; 2]) -> [f32; 2] {
            let mut observation = [9.0; 4];
            for (number, (target, [low, high])) in observation[2..].iter_mut().zip(seen.iter().zip(RANGES)) {
                *number = (2.0 * (target - low) / (high - low) - 1.0) as f32;
            }
            let mut action = desired;
            self.limiter.limit(&observation, &mut self.memory, &mut action);
            action
        }

        fn apply(&mut self, action: [f32; 2]) {
            for i in 0..2 {
                let [low, high] = RANGES[i];
                let before = self.targets[i];
                self.targets[i] = (before + STEP * f64::from(action[i])).clamp(low, high);
                let moved = self.targets[i] - before;
                self.velocity[i] = (moved + self.lead * self.velocity[i]) / (DT + self.lead);
            }
        }
    }

    /// Actions of one episode: random ones far beyond the range, held for random times.
    fn actions(episode: u64) -> impl Iterator<Item = [f32; 2]> {
        let number = move |step: u64, i: u32| Seed(episode).uniform(Stream::Policy, step, i);
        (0..300).map(move |step| {
            let held = step / (1 + (40.0 * number(step / 40, 4)) as u64);
            [0, 1].map(|joint| match (8.0 * number(held, joint)) as u32 {
                0 => f32::INFINITY,
                1 => f32::NEG_INFINITY,
                2 => 1.0,
                3 => -1.0,
                _ => (6.0 * number(held, 2 + joint) - 3.0) as f32,
            })
        })
    }

    #[test]
    fn any_actions_keep_all_limits_and_the_range() {
        for (episode, lead) in (0..500).flat_map(|episode| [(episode, 0.0), (episode, LAG)]) {
            let draw = |i: usize| Seed(episode).uniform(Stream::Reset, 0, i as u32);
            // A feasible state: a motion that can still stop in its range.
            let positions = [0, 1].map(|i| {
                let [low, high] = RANGES[i];
                low + MARGIN + draw(i) * (high - low - 2.0 * MARGIN)
            });
            let velocity = [0, 1].map(|i| {
                let change = ACCELERATION[i] * DT;
                let stop = |distance: f64| stopping_velocity(distance, change, DT, lead).min(VELOCITY[i]);
                let [low, high] = RANGES[i];
                let ends = [stop(positions[i] - low - MARGIN), stop(high - MARGIN - positions[i])];
                // One control step later, the motion has passed neither point.
                draw(2 + i) * (ends[0] + ends[1]) - ends[0]
            });

            let mut arm = Arm::new(lead, positions, velocity);
            let mut acceleration: [Option<f64>; 2] = [None; 2];
            for action in actions(episode) {
                let targets = arm.targets;
                let before = [0, 1].map(|i| known(i, &arm.memory)[0]);
                arm.step(action);
                for i in 0..2 {
                    let [v, position, _] = known(i, &arm.memory);
                    let a = (v - before[i]) / DT;
                    let commanded = position + lead * v;
                    assert!(
                        (arm.targets[i] - commanded).abs() < TINY,
                        "target {} of {commanded}",
                        arm.targets[i]
                    );
                    let [low, high] = RANGES[i];
                    assert!(v.abs() <= VELOCITY[i] + TINY, "velocity {v}");
                    assert!(a.abs() <= ACCELERATION[i] + TINY / DT, "acceleration {a}");
                    assert!(acceleration[i].is_none_or(|last| (a - last).abs() <= JERK[i] * DT), "jerk");
                    let moved = arm.targets[i] - targets[i];
                    assert!(moved.abs() <= TARGET_VELOCITY[i] * DT + TINY, "target moves by {moved}");
                    let range = low + MARGIN - TINY..=high - MARGIN + TINY;
                    assert!(range.contains(&arm.targets[i]), "target {} of {range:?}", arm.targets[i]);
                    acceleration[i] = Some(a);
                }
            }
        }
    }

    #[test]
    fn the_jerk_stays_below_that_of_the_data_sheet() {
        // The acceleration changes by at most twice its limit.
        for (acceleration, jerk) in ACCELERATION.into_iter().zip(JERK) {
            assert!(2.0 * acceleration / DT <= 0.5 * jerk);
        }
    }

    #[test]
    fn the_stopping_velocity_is_the_largest_one() {
        let change = 0.125;
        // How far a motion and its target come.
        let way = |mut velocity: f64, lead: f64| {
            let (mut way, mut farthest) = (0.0_f64, 0.0_f64);
            while velocity > 0.0 {
                way += velocity * DT;
                farthest = farthest.max(way + lead * velocity);
                velocity -= change;
            }
            farthest.max(way)
        };
        for (i, lead) in (1..2000).flat_map(|i| [(i, 0.0), (i, 0.02), (i, LAG)]) {
            let distance = 1e-3 * f64::from(i);
            let velocity = stopping_velocity(distance, change, DT, lead);
            assert!(way(velocity - 1e-9, lead) <= distance, "{velocity} overshoots {distance}");
            assert!(way(velocity + 1e-9, lead) >= distance, "{velocity} is too slow for {distance}");
        }
        assert_eq!(stopping_velocity(-1.0, change, DT, LAG), 0.0);
    }

    #[test]
    fn a_held_action_of_1_reaches_the_end_and_stays_there() {
        for lead in [0.0, LAG] {
            let mut arm = Arm::new(lead, [0.0, 1.0], [0.0; 2]);
            let mut fastest = [0.0_f64; 2];
            for _ in 0..400 {
                arm.step([1.0, 1.0]);
                fastest = [0, 1].map(|i| arm.velocity[i].max(fastest[i]));
            }
            for i in 0..2 {
                assert!((arm.targets[i] - (RANGES[i][1] - MARGIN)).abs() < 1e-5, "target {}", arm.targets[i]);
                assert!(fastest[i] > 0.9 * VELOCITY[i], "velocity {}", fastest[i]);
            }
        }
    }

    #[test]
    fn a_target_beyond_the_end_only_moves_back() {
        // An episode may start there, and noise may lead there.
        let mut arm = Arm::new(LAG, [1.75, 0.0], [0.0; 2]);
        arm.step([1.0, -1.0]);
        assert!(arm.velocity.iter().all(|velocity| velocity.abs() < 1e-5), "{:?}", arm.velocity);
        arm.step([-1.0, 1.0]);
        assert!(arm.velocity[0] < 0.0 && arm.velocity[1] > 0.0);
    }

    #[test]
    fn a_controller_that_takes_over_goes_on_with_the_motion() {
        let (position, velocity) = (0.4, 1.5);
        let mapped = |x: f64, [low, high]: [f64; 2]| (2.0 * (x - low) / (high - low) - 1.0) as f32;
        let target = position + LAG * velocity;
        let seen = [position, 1.0, target, 1.0];
        let observation = [0, 1, 2, 3].map(|i| mapped(seen[i], RANGES[i % 2]));
        for (lead, expected) in [(LAG, velocity), (0.0, 0.0)] {
            let limiter = ActionLimiter::new(&interface(lead), targets()).unwrap();
            let mut memory = vec![0.0; limiter.memory_size()];
            limiter.reset(&mut memory);
            // It may change by the limit of the acceleration, here to less.
            limiter.limit(&observation, &mut memory, &mut [-1.0, 0.0]);
            let [first, second] = [0, 1].map(|i| limiter.commanded_velocity(i, &observation, &memory));
            assert!((first - (expected - ACCELERATION[0] * DT)).abs() < 1e-5, "{memory:?}");
            assert!(second.abs() < 1e-5);
        }
    }

    /// Returns the root mean square of the distances of the first target from rest, in the last 600
    /// of 800 control steps: a motion for 60 of them, then none, with noise of this size on each
    /// action and actions that are late by some control steps.
    fn deviation(noise: f64, delay: usize) -> f64 {
        let mut arm = Arm::new(LAG, [-1.0, 1.0], [0.0; 2]);
        let mut late = std::collections::VecDeque::from(vec![[0.0_f32; 2]; delay]);
        let mut squares = 0.0;
        for step in 0..800 {
            let desired = if step < 60 { [0.5, 0.0] } else { [0.0; 2] };
            late.push_back(arm.limited(desired, arm.targets));
            let mut action = late.pop_front().unwrap();
            let drawn = |i: u32| Seed(3).uniform(Stream::ActionNoise, step, i) - 0.5;
            // The variance of a uniform number is 1/12.
            (0..2).for_each(|i| action[i] += (noise * 12_f64.sqrt() * drawn(i as u32)) as f32);
            arm.apply(action);
            let rest = known(0, &arm.memory)[1];
            squares += if step < 200 { 0.0 } else { (arm.targets[0] - rest).powi(2) };
        }
        (squares / 600.0).sqrt()
    }

    #[test]
    fn noise_after_the_limiter_moves_a_target_by_one_step_of_it() {
        // A limiter that took nothing back would let the target walk by 0.5 STEP √600 = 1.5 rad.
        let found = deviation(0.5, 0);
        assert!((0.9..1.1).contains(&(found / (0.5 * STEP))), "{found} rad");
    }

    #[test]
    fn late_actions_make_no_target_oscillate() {
        for delay in 1..=6 {
            let found = deviation(0.0, delay);
            assert!(found < 2e-3, "{found} rad with a delay of {delay} control steps");
            // No controller can take noise back before `delay` more steps of it have come.
            let least = 0.5 * STEP * ((delay + 1) as f64).sqrt();
            let found = deviation(0.5, delay);
            assert!(found < 1.5 * least, "{found} rad with noise and a delay of {delay} control steps");
        }
    }

    #[test]
    fn wrong_interfaces_are_errors() {
        let message =
            |interface: ActionInterface| ActionLimiter::new(&interface, targets()).unwrap_err().to_string();
        let good = interface(LAG);
        for (wrong, expected) in [
            (
                ActionInterface { velocity: vec![1.0], ..good.clone() },
                "the action interface has 1 velocities; the arm has 2 joints",
            ),
            (
                ActionInterface { acceleration: vec![1.0, 0.0], ..good.clone() },
                "one of the accelerations of the action interface is 0; expected positive numbers",
            ),
            (
                ActionInterface { target_velocity: vec![1.0, 5.0], ..good.clone() },
                "the target of joint 1 may move at 1 rad/s; with its acceleration and lead, it needs 1.625 rad/s",
            ),
            (
                ActionInterface { margin: 2.0, ..good.clone() },
                "the margin of the action interface is 2 rad; expected a number from 0 to below 1.7628 rad",
            ),
            (
                ActionInterface { lead: f64::NAN, ..good },
                "the lead of the action interface is NaN s; expected a number from 0 to below 1 s",
            ),
        ] {
            assert_eq!(message(wrong), expected);
        }
    }
}
