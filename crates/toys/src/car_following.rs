//! A car that follows another car: a dynamic system with every kind of axis.
//!
//! The follower uses the intelligent driver model of Treiber, Hennecke and Helbing, "Congested
//! traffic states in empirical observations and microscopic simulations", Physical Review E 62,
//! 2000, with a bounded deceleration:
//!
//! ```text
//! a  = A (1 - (v / v₀)⁴ - (s* / s)²)        s* = s₀ + v T + v Δv / (2 sqrt(A B))
//! ```
//!
//! with gap s, speed v and closing speed Δv.

use std::collections::VecDeque;

use mishandle_rollout::{Axis, AxisKind, AxisValues, Distribution, Seed, Stream};

use crate::Toy;

pub(crate) struct CarFollowing;

/// Duration of a step, s, and steps of an episode: 20 s.
const DT: f64 = 0.1;
const STEPS: usize = 200;

/// Parameters of the model: desired speed v₀ (m/s), time headway T (s), minimum gap s₀ (m),
/// acceleration A and comfortable deceleration B (m/s²).
const DESIRED_SPEED: f64 = 33.0;
const HEADWAY: f64 = 1.0;
const MIN_GAP: f64 = 2.0;
const ACCELERATION: f64 = 1.5;
const DECELERATION: f64 = 2.0;

/// The follower's maximum deceleration on a dry road, m/s².
const MAX_DECELERATION: f64 = 8.0;

/// Steps between the knots of the front car's acceleration.
const KNOT: usize = 50;
const KNOTS: usize = STEPS / KNOT + 1;

/// Standard deviation of the gap measurement's error, m. The error is constant in each of these
/// parts of the episode.
const GAP_STD: f64 = 0.5;
const PARTS: usize = 4;

/// Indices of the axes.
const GAP: usize = 0;
const SPEED: usize = 1;
const DELAY: usize = 2;
const BRAKES: usize = 3;
const EVENT: usize = 4;
const FRONT: usize = 7;
const ERRORS: usize = FRONT + KNOTS;

impl Toy for CarFollowing {
    fn name(&self) -> &'static str {
        "car-following"
    }

    fn summary(&self) -> &'static str {
        "A car follows another car for 20 s: safe from every initial state, unsafe if the front car brakes on a wet road."
    }

    fn axes(&self) -> Vec<Axis> {
        let event = |name: &str, unit: &str, bounds, nominal| {
            Axis::new(AxisKind::Event, name, unit, bounds, Some(nominal))
        };
        let mut axes = vec![
            Axis::start("gap", "m", 15.0, 60.0).meaning("gap between the cars at the start"),
            Axis::start("speed", "m/s", 15.0, 30.0).meaning("speed of both cars at the start"),
            Axis::new(AxisKind::Model, "reaction_delay", "steps", [0.0, 10.0], Some(0.0))
                .with_values(AxisValues::Integer)
                .meaning("steps of 0.1 s until the follower reacts"),
            Axis::new(AxisKind::Model, "braking_scale", "", [0.25, 1.0], Some(1.0))
                .with_values(AxisValues::Logarithmic)
                .meaning("factor of the follower's hardest deceleration, 8 m/s² on a dry road"),
            event("brake_time", "s", [0.0, 15.0], 0.0).meaning("when the front car begins to brake"),
            event("brake_duration", "s", [0.5, 5.0], 1.0).meaning("how long it brakes"),
            event("brake_deceleration", "m/s²", [0.0, 8.0], 0.0).meaning("how hard it brakes"),
        ];
        axes.extend((0..KNOTS).map(|knot| {
            let name = format!("front_acceleration_{}", knot + 1);
            Axis::new(AxisKind::Input, &name, "m/s²", [-1.0, 1.0], Some(0.0))
                .acting_from(knot.saturating_sub(1), KNOTS - 1)
                .meaning("acceleration of the front car at this knot, 5 s apart, linear between them")
        }));
        axes.extend((0..PARTS).map(|part| {
            let name = format!("gap_error_{}", part + 1);
            let mut axis = Axis::new(AxisKind::Noise, &name, "", [-4.0, 4.0], None)
                .acting_from(part, PARTS)
                .meaning("error of the measured gap in this quarter, in units of 0.5 m");
            axis.distribution = Distribution::Normal;
            axis
        }));
        axes
    }

    fn signals(&self) -> &'static [(&'static str, &'static str)] {
        &[("gap", "m"), ("speed", "m/s"), ("closing_speed", "m/s")]
    }

    fn formulas(&self) -> &'static [(&'static str, &'static str)] {
        &[("success", "always(gap >= 2)"), ("strict", "always(gap >= 5)"), ("safe", "gap >= 5")]
    }

    fn control_dt(&self) -> f64 {
        DT
    }

    fn episode_steps(&self) -> usize {
        STEPS
    }

    fn simulate(&self, values: &[Option<f64>], seed: Seed, push: &mut dyn FnMut(&[f64])) {
        let value = |index: usize| values[index].unwrap_or_default();
        let mut gap = value(GAP);
        let mut speed = value(SPEED);
        let mut front = value(SPEED);
        let mut drawn = [0.0; PARTS];
        seed.normals(Stream::ObservationNoise, 0, &mut drawn);
        let error = |step: usize| {
            let part = step * PARTS / STEPS;
            GAP_STD * values[ERRORS + part].unwrap_or(drawn[part])
        };
        let mut commands = VecDeque::from(vec![0.0; value(DELAY) as usize]);
        push(&[gap, speed, speed - front]);
        for step in 0..STEPS {
            commands.push_back(acceleration(gap + error(step), speed, speed - front));
            let command = commands.pop_front().unwrap_or_default().max(-MAX_DECELERATION * value(BRAKES));
            let front_acceleration = interpolate(&values[FRONT..][..KNOTS], step)
                - braking(step as f64 * DT, [value(EVENT), value(EVENT + 1), value(EVENT + 2)]);
            let before = speed;
            let front_before = front;
            speed = (speed + DT * command).max(0.0);
            front = (front + DT * front_acceleration).max(0.0);
            gap += 0.5 * DT * (front + front_before - speed - before);
            if gap <= 0.0 {
                // After a collision both cars stop.
                (speed, front) = (0.0, 0.0);
            }
            push(&[gap, speed, speed - front]);
        }
    }
}

/// Returns the follower's acceleration by the intelligent driver model, m/s².
fn acceleration(gap: f64, speed: f64, closing: f64) -> f64 {
    let desired_gap =
        MIN_GAP + (speed * HEADWAY + speed * closing / (2.0 * (ACCELERATION * DECELERATION).sqrt())).max(0.0);
    let ratio = desired_gap / gap.max(0.1);
    ACCELERATION * (1.0 - (speed / DESIRED_SPEED).powi(4) - ratio * ratio)
}

/// Returns the front car's deceleration at `time`, m/s².
fn braking(time: f64, [begin, duration, deceleration]: [f64; 3]) -> f64 {
    if (begin..begin + duration).contains(&time) { deceleration } else { 0.0 }
}

/// Interpolates linearly between the knots.
fn interpolate(values: &[Option<f64>], step: usize) -> f64 {
    let knot = step / KNOT;
    let weight = (step % KNOT) as f64 / KNOT as f64;
    let value = |knot: usize| values.get(knot).copied().flatten().unwrap_or_default();
    (1.0 - weight) * value(knot) + weight * value(knot + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn in_equilibrium_the_follower_keeps_its_gap() {
        // At 20 m/s without closing speed the acceleration is 0 at s = s* / sqrt(1 - (v / v₀)⁴).
        let gap = (MIN_GAP + 20.0 * HEADWAY) / (1.0 - (20.0_f64 / DESIRED_SPEED).powi(4)).sqrt();
        assert!(acceleration(gap, 20.0, 0.0).abs() < 1e-12);
        assert!(acceleration(gap - 1.0, 20.0, 0.0) < 0.0 && acceleration(gap + 1.0, 20.0, 0.0) > 0.0);
    }

    #[test]
    fn cars_stop_after_a_collision() {
        let mut values: Vec<Option<f64>> = CarFollowing.axes().iter().map(|axis| axis.nominal).collect();
        // The front car brakes with maximum deceleration, the follower with a quarter of it.
        values[BRAKES] = Some(0.25);
        values[EVENT..EVENT + 3].copy_from_slice(&[Some(1.0), Some(5.0), Some(8.0)]);
        let mut gaps = Vec::new();
        CarFollowing.simulate(&values, Seed(0), &mut |signals| gaps.push(signals[0]));
        let contact = gaps.iter().position(|gap| *gap <= 0.0).unwrap();
        // 30 m/s for one step of 0.1 s.
        assert!(gaps[contact] > -3.0 && gaps[contact..].iter().all(|gap| *gap == gaps[contact]));
    }

    #[test]
    fn the_front_car_brakes_for_the_duration_and_follows_its_knots() {
        assert_eq!([0.9, 1.0, 2.9, 3.0].map(|time| braking(time, [1.0, 2.0, 6.0])), [0.0, 6.0, 6.0, 0.0]);
        let values = [Some(0.0), Some(1.0), Some(-1.0), None, None];
        assert_eq!([0, 25, 50, 75, 100].map(|step| interpolate(&values, step)), [0.0, 0.5, 1.0, 0.0, -1.0]);
    }
}
