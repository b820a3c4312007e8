//! Chasing cars: five cars in a row, of which the first has throttle and brake and each other one
//! follows the car before it by three modes. Positions fall: the first car drives toward −∞.
//!
//! Hu, Lygeros and Sastry, "Towards a theory of stochastic hybrid systems", HSCC 2000, describe the
//! cars; the model of the competition is that of its Simulink file `cars.mdl`. With throttle u and
//! brake b, both in \[0, 1\]:
//!
//! ```text
//! car 1              v' = -u - b v    y' =  v
//! car i, chasing     v' = 1           y' = -v    until gap <= 10, then keeping
//! car i, keeping     v' = 0           y' =  v    until gap >= 15, then chasing; or gap <= 5, then braking
//! car i, braking     v' = -v          y' = -v    until gap >= 20, then chasing
//! ```
//!
//! with the gap yᵢ − yᵢ₋₁. A car that keeps moves away from the car before it with the speed it
//! reached, so gaps oscillate between 10 and 15: the modes chatter. All cars start at rest, 10
//! apart, keeping. The model has no units; here they are meters and seconds.

use crate::Toy;
use mishandle_rollout::{Axis, Seed};

use crate::arch::inputs::{Input, Signal, ramp, spaces};
use crate::arch::integration::{event, runge_kutta};

/// A problem: a formula about the cars.
#[derive(Clone, Copy)]
pub(crate) enum Problem {
    Cc1,
    Cc2,
    Cc3,
    Cc4,
    Cc5,
    Ccx,
}

pub(crate) struct ChasingCars(pub Problem);

/// Duration of a step of the integrator and of the trace, s, and steps of an episode: 100 s.
const DT: f64 = 0.05;
const STEPS: usize = 2000;

/// Accuracy of a gap at which a mode ends, m.
const LOCATED: f64 = 1e-9;

const CARS: usize = 5;
/// Position and speed of each car.
type State = [f64; 2 * CARS];

const THROTTLE: Input = input("throttle", "throttle of the first car");
const BRAKE: Input = input("brake", "brake of the first car");

const fn input(name: &'static str, meaning: &'static str) -> Input {
    Input { name, unit: "", bounds: [0.0, 1.0], pieces: 20, meaning }
}

/// The behavior of a car that follows.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mode {
    Chasing,
    Keeping,
    Braking,
}

impl Mode {
    /// Returns the mode that follows this one, and how far a gap exceeds the bound at which it
    /// does, m: 0 or more ends this mode.
    fn next(self, gap: f64) -> (Mode, f64) {
        match self {
            Mode::Chasing => (Mode::Keeping, 10.0 - gap),
            Mode::Keeping if gap >= 10.0 => (Mode::Chasing, gap - 15.0),
            Mode::Keeping => (Mode::Braking, 5.0 - gap),
            Mode::Braking => (Mode::Chasing, gap - 20.0),
        }
    }

    /// Returns the derivatives of position and speed.
    fn derivative(self, speed: f64) -> [f64; 2] {
        match self {
            Mode::Chasing => [-speed, 1.0],
            Mode::Keeping => [speed, 0.0],
            Mode::Braking => [-speed, -speed],
        }
    }
}

impl Toy for ChasingCars {
    fn name(&self) -> &'static str {
        match self.0 {
            Problem::Cc1 => "cc1",
            Problem::Cc2 => "cc2",
            Problem::Cc3 => "cc3",
            Problem::Cc4 => "cc4",
            Problem::Cc5 => "cc5",
            Problem::Ccx => "ccx",
        }
    }

    fn summary(&self) -> &'static str {
        match self.0 {
            Problem::Cc1 => "Chasing cars: the last gap stays below 40.",
            Problem::Cc2 => "Chasing cars: every 30 s the last gap reaches 15.",
            Problem::Cc3 => "Chasing cars: where the first gap exceeds 20, the last one reaches 40.",
            Problem::Cc4 => "Chasing cars: every 30 s the last gap begins 5 s above 8.",
            Problem::Cc5 => "Chasing cars: after a large first gap the last gap is large.",
            Problem::Ccx => "Chasing cars: all gaps stay above 7.5 for 50 s.",
        }
    }

    fn axes(&self) -> Vec<Axis> {
        // At rest the gap is 10, which CC2 does not allow.
        let throttle = if matches!(self.0, Problem::Cc2) { 1.0 } else { 0.0 };
        [THROTTLE.axes(&[throttle]), BRAKE.axes(&[0.0]), vec![ramp()]].concat()
    }

    fn spaces(&self) -> Vec<(&'static str, Vec<Axis>)> {
        spaces(self.axes())
    }

    fn signals(&self) -> &'static [(&'static str, &'static str)] {
        &[("y1", "m"), ("y2", "m"), ("y3", "m"), ("y4", "m"), ("y5", "m"), ("throttle", ""), ("brake", "")]
    }

    fn formulas(&self) -> &'static [(&'static str, &'static str)] {
        match self.0 {
            Problem::Cc1 => &[("success", "always[0:100s](y5 - y4 <= 40)")],
            Problem::Cc2 => &[("success", "always[0:70s](eventually[0:30s](y5 - y4 >= 15))")],
            Problem::Cc3 => &[(
                "success",
                "always[0:80s](always[0:20s](y2 - y1 <= 20) or eventually[0:20s](y5 - y4 >= 40))",
            )],
            Problem::Cc4 => &[("success", "always[0:65s](eventually[0:30s](always[0:5s](y5 - y4 >= 8)))")],
            Problem::Cc5 => &[(
                "success",
                "always[0:72s](eventually[0:8s](always[0:5s](y2 - y1 >= 9) implies always[5:20s](y5 - y4 >= 9)))",
            )],
            Problem::Ccx => &[(
                "success",
                "always[0:50s](y2 - y1 > 7.5) and always[0:50s](y3 - y2 > 7.5) \
                 and always[0:50s](y4 - y3 > 7.5) and always[0:50s](y5 - y4 > 7.5)",
            )],
        }
    }

    fn control_dt(&self) -> f64 {
        DT
    }

    fn episode_steps(&self) -> usize {
        STEPS
    }

    fn simulate(&self, values: &[Option<f64>], _seed: Seed, push: &mut dyn FnMut(&[f64])) {
        let (knots, ramp) = values.split_at(2 * THROTTLE.pieces);
        let (throttle, brake) = knots.split_at(THROTTLE.pieces);
        let [throttle, brake] = [throttle, brake].map(|knots| Signal::new(knots, STEPS, ramp[0]));
        let mut state: State = std::array::from_fn(|i| if i % 2 == 0 { 5.0 * i as f64 } else { 0.0 });
        let mut modes = [Mode::Keeping; CARS - 1];
        for step in 0..STEPS {
            let inputs = |share: f64| [throttle.at(step, share), brake.at(step, share)];
            sample(&state, inputs(0.0), push);
            advance(&mut state, &mut modes, inputs);
        }
        sample(&state, [throttle.at(STEPS - 1, 1.0), brake.at(STEPS - 1, 1.0)], push);
    }
}

fn sample(state: &State, [throttle, brake]: [f64; 2], push: &mut dyn FnMut(&[f64])) {
    push(&[state[0], state[2], state[4], state[6], state[8], throttle, brake]);
}

/// Returns the gap before a follower, counted from 0.
fn gap(state: &State, follower: usize) -> f64 {
    state[2 * follower + 2] - state[2 * follower]
}

/// Takes one step. Where a mode ends inside it, the step is divided there.
fn advance(state: &mut State, modes: &mut [Mode; CARS - 1], inputs: impl Fn(f64) -> [f64; 2]) {
    let mut done = 0.0;
    while done < 1.0 {
        let moved = |end: f64| {
            runge_kutta(state, DT, [done, end], |state, share| {
                let [throttle, brake] = inputs(share);
                let mut slope = [0.0; 2 * CARS];
                slope[0] = state[1];
                slope[1] = -throttle - brake * state[1];
                for (follower, mode) in modes.iter().enumerate() {
                    let i = 2 * follower + 2;
                    [slope[i], slope[i + 1]] = mode.derivative(state[i + 1]);
                }
                slope
            })
        };
        let excess = |state: &State| {
            (0..CARS - 1).map(|i| modes[i].next(gap(state, i)).1).fold(f64::NEG_INFINITY, f64::max)
        };
        let end = if excess(&moved(1.0)) >= 0.0 {
            event([done, 1.0], LOCATED, |end| excess(&moved(end)))
        } else {
            1.0
        };
        *state = moved(end);
        for (follower, mode) in modes.iter_mut().enumerate() {
            let (next, excess) = mode.next(gap(state, follower));
            if excess >= 0.0 {
                *mode = next;
            }
        }
        done = end;
    }
}
