//! The way from the cylinders to the sensor, and the sensor.
//!
//! Exhaust moves through a pipe. It enters at time s and reaches the sensor at the time t at which
//! the integral of 1 / delay from s to t is 1 (the variable transport delay of Simulink). With φ,
//! the integral of 1 / delay from the begin, that is φ(t) = φ(s) + 1. The fuel jumps at each tick
//! of the controller, so steps are divided where the begin of an earlier step arrives.

use std::collections::VecDeque;

use super::plant::Flow;
use crate::arch::integration::runge_kutta;

/// Ratio of air to fuel that fills pipe and sensor at first.
const FIRST_RATIO: f64 = 14.7;
/// Rates of the two filters in a row, 1/s.
const EXHAUST: f64 = 10.0;
const SENSOR: f64 = 50.0;
/// Steps that the pipe holds without an allocation: 5 s.
const CAPACITY: usize = 1024;

/// A step of the past: φ and the ratio at its begin, middle and end.
#[derive(Clone, Copy)]
struct Past {
    phase: [f64; 3],
    ratio: [f64; 3],
}

impl Past {
    /// Returns the share of the step at which φ has a value.
    fn share_of(&self, phase: f64) -> f64 {
        let [begin, middle, end] = self.phase;
        let mut share = (phase - begin) / (end - begin);
        // φ is nearly linear in a step: Newton's method on the parabola converges at once.
        for _ in 0..3 {
            let slope = parabola_slope([begin, middle, end], share);
            share -= (parabola([begin, middle, end], share) - phase) / slope;
        }
        share
    }
}

/// Returns the value at a share of the parabola through three values at 0, 1/2 and 1.
fn parabola([begin, middle, end]: [f64; 3], share: f64) -> f64 {
    let slope = 4.0 * middle - 3.0 * begin - end;
    let bend = 2.0 * (begin + end) - 4.0 * middle;
    begin + share * (slope + share * bend)
}

fn parabola_slope([begin, middle, end]: [f64; 3], share: f64) -> f64 {
    4.0 * middle - 3.0 * begin - end + 2.0 * share * (2.0 * (begin + end) - 4.0 * middle)
}

pub(crate) struct Sensor {
    /// Steps whose exhaust is in the pipe, the oldest first; the first one is arriving.
    pipe: VecDeque<Past>,
    /// Whether exhaust has reached the sensor.
    has_arrived: bool,
    /// φ at the end of the last step.
    phase: f64,
    /// States of the two filters.
    filters: [f64; 2],
}

impl Sensor {
    pub fn new() -> Sensor {
        let pipe = VecDeque::with_capacity(CAPACITY);
        Sensor { pipe, has_arrived: false, phase: 0.0, filters: [FIRST_RATIO; 2] }
    }

    /// Returns the measured ratio of air to fuel.
    pub fn ratio(&self) -> f64 {
        self.filters[1]
    }

    /// Takes a step of `dt` in which the cylinders have this flow.
    pub fn step(&mut self, dt: f64, flow: &Flow) {
        let [begin, middle, end] = flow.delay.map(|delay| 1.0 / delay);
        // The integral of the parabola through the three rates, to the middle and to the end.
        let half = dt / 24.0 * (5.0 * begin + 8.0 * middle - end);
        let whole = dt / 6.0 * (begin + 4.0 * middle + end);
        let now = Past { phase: [self.phase, self.phase + half, self.phase + whole], ratio: flow.ratio };
        self.pipe.push_back(now);
        self.phase = now.phase[2];

        let mut done = 0.0;
        while done < 1.0 {
            let arriving = self.pipe.front().copied().unwrap_or(now);
            // Until the first exhaust arrives, the pipe holds the first ratio.
            let until = arriving.phase[if self.has_arrived { 2 } else { 0 }] + 1.0;
            let ends_within = until < now.phase[2];
            let end = if ends_within { now.share_of(until).clamp(done, 1.0) } else { 1.0 };
            let arrived = |share: f64| {
                let left = || arriving.share_of(parabola(now.phase, share) - 1.0);
                if self.has_arrived { parabola(arriving.ratio, left()) } else { FIRST_RATIO }
            };
            self.filters = runge_kutta(&self.filters, dt, [done, end], |[exhaust, sensor], share| {
                [EXHAUST * (arrived(share) - exhaust), SENSOR * (exhaust - sensor)]
            });
            if ends_within && self.has_arrived {
                self.pipe.pop_front();
            }
            self.has_arrived |= ends_within;
            done = end;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_delay_shifts_the_answer_of_the_filters() {
        // The ratio rises from 14.7 by 1 at time 0. Two lags of rates a and b answer with
        // 1 - (b exp(-a t) - a exp(-b t)) / (b - a), later by the delay. It is not a whole number
        // of steps.
        let dt = 0.005;
        let delay = 0.2513;
        let mut sensor = Sensor::new();
        for step in 1..=400 {
            sensor.step(dt, &Flow { ratio: [15.7; 3], delay: [delay; 3] });
            let t = (dt * f64::from(step) - delay).max(0.0);
            let answer = 1.0 - (50.0 * (-10.0 * t).exp() - 10.0 * (-50.0 * t).exp()) / 40.0;
            assert!((sensor.ratio() - 14.7 - answer).abs() < 1e-6, "{t}: {} {answer}", sensor.ratio());
        }
    }

    #[test]
    fn a_delay_that_grows_keeps_the_integral_of_its_inverse_at_1() {
        // With delay 0.2 + t / 2, φ(t) = 2 ln(1 + 2.5 t): what enters at 0 arrives when φ is 1.
        let arrival = (0.5_f64.exp() - 1.0) / 2.5;
        let mut sensor = Sensor::new();
        for step in 0..200 {
            let times = [0.0, 0.5, 1.0].map(|share| 0.005 * (f64::from(step) + share));
            let is_before = times[2] <= arrival;
            sensor.step(0.005, &Flow { ratio: [15.7; 3], delay: times.map(|time| 0.2 + 0.5 * time) });
            assert_eq!(sensor.ratio() == 14.7, is_before, "{}", times[2]);
        }
        assert!(sensor.pipe.len() < 200);
    }
}
