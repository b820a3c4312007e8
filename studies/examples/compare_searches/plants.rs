//! Small plants in closed form, integrated with fourth-order Runge-Kutta steps.

use crate::problem::{Instance, Problem};

pub const PROBLEMS: [Problem; 7] = [
    Problem::new("double-pendulum", double_pendulum).with_axes(&[6]).calibrated(0.005),
    Problem::new("pendulum-return", pendulum_return).with_axes(&[6]).calibrated(0.005),
    Problem::new("pendulum-rate", pendulum_rate).with_axes(&[6]).calibrated(0.005),
    Problem::new("pendulum-chaos", pendulum_chaos).with_axes(&[6]).calibrated(0.005),
    Problem::new("relay", relay).with_axes(&[8]).calibrated(0.003),
    Problem::new("two-relays", two_relays).with_axes(&[12]).calibrated(0.003),
    Problem::new("chasing-cars", chasing_cars).with_axes(&[40]),
];

/// Takes one step of length `h`.
fn step<const N: usize>(x: &mut [f64; N], h: f64, slope: impl Fn(&[f64; N]) -> [f64; N]) {
    let moved = |x: &[f64; N], h: f64, k: &[f64; N]| -> [f64; N] { std::array::from_fn(|i| x[i] + h * k[i]) };
    let a = slope(x);
    let b = slope(&moved(x, 0.5 * h, &a));
    let c = slope(&moved(x, 0.5 * h, &b));
    let d = slope(&moved(x, h, &c));
    for i in 0..N {
        x[i] += h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]);
    }
}

/// Two point masses on rods. The state is angles from the vertical and their rates; axes are both
/// angles up to `angle` and rates up to 2 rad/s, the ratio of the masses from 1/2 to 2 and that of
/// the rods likewise. Returns the least `value` of the state and the ratio of the rods over `steps`
/// steps of 0.02 s after the first 2 s, and 10 if all axes are at bounds.
fn pendulum(u: &[f64], angle: f64, steps: usize, value: impl Fn(&[f64; 4], f64) -> f64) -> f64 {
    if u.iter().all(|x| *x == 0.0 || *x == 1.0) {
        return 10.0;
    }
    const GRAVITY: f64 = 9.81;
    let centered = |i: usize| 2.0 * u[i] - 1.0;
    let mut x = [angle * centered(0), angle * centered(1), 2.0 * centered(2), 2.0 * centered(3)];
    let mass = 2_f64.powf(centered(4));
    let rod = 2_f64.powf(centered(5));
    let slope = |x: &[f64; 4]| {
        let (sin, cos) = (x[0] - x[1]).sin_cos();
        let total = 1.0 + mass;
        let divisor = total - mass * cos * cos;
        let first = mass * sin * (cos * x[2] * x[2] + rod * x[3] * x[3]);
        let upper = -(first + total * GRAVITY * x[0].sin() - mass * GRAVITY * cos * x[1].sin()) / divisor;
        let lower = (sin * total * x[2] * x[2]
            + mass * sin * cos * rod * x[3] * x[3]
            + total * GRAVITY * (cos * x[0].sin() - x[1].sin()))
            / (rod * divisor);
        [x[2], x[3], upper, lower]
    };
    let mut least = f64::INFINITY;
    for i in 0..steps {
        step(&mut x, 0.02, slope);
        if i >= 100 {
            least = least.min(value(&x, rod));
        }
    }
    least
}

/// Returns the distance of the lower mass from a point.
fn far_from(x: &[f64; 4], rod: f64, point: [f64; 2]) -> f64 {
    let place = [x[0].sin() + rod * x[1].sin(), -x[0].cos() - rod * x[1].cos()];
    (place[0] - point[0]).hypot(place[1] - point[1])
}

/// The lower mass stays away from a point above the pivot's height.
fn double_pendulum(u: &[f64], instance: &Instance) -> f64 {
    let p = &instance.parameters;
    let point = [1.2 * (2.0 * p[0] - 1.0), 0.3 + 0.8 * p[1]];
    pendulum(u, 1.75, 300, |x, rod| far_from(x, rod, point))
}

/// The lower mass stays away from a point below the pivot.
fn pendulum_return(u: &[f64], instance: &Instance) -> f64 {
    let p = &instance.parameters;
    let point = [2.2 * (2.0 * p[0] - 1.0), -0.2 - 0.5 * p[1]];
    pendulum(u, 1.75, 300, |x, rod| far_from(x, rod, point))
}

/// From starts with more energy, the lower mass stays away from a point for 16 s: small changes of
/// the start decide.
fn pendulum_chaos(u: &[f64], instance: &Instance) -> f64 {
    let p = &instance.parameters;
    let point = [1.5 * (2.0 * p[0] - 1.0), 1.2 + 0.6 * p[1]];
    pendulum(u, 2.2, 800, |x, rod| far_from(x, rod, point))
}

/// From starts with more energy, the rate of the lower mass stays below a bound for 10 s.
fn pendulum_rate(u: &[f64], instance: &Instance) -> f64 {
    let sign = (instance.parameters[0] - 0.5).signum();
    pendulum(u, 2.6, 500, |x, _| 0.1 * sign * x[3])
}

/// A mass under a relay that pushes against x + v/2, and a piecewise-constant disturbance: the
/// relay chatters. Returns the least distance of the state from a point after 6 s.
fn relay(u: &[f64], instance: &Instance) -> f64 {
    let p = &instance.parameters;
    let mut x = [2.0 * p[0] - 1.0, 0.0, 0.0];
    let mut least = f64::INFINITY;
    for i in 0..1000 {
        let push = 1.5 * (2.0 * u[i * u.len() / 1000] - 1.0);
        let control = -(x[0] + 0.5 * x[1] + 0.3 * x[2]).signum();
        step(&mut x, 0.01, |x| [x[1], control + push - 0.2 * x[1], x[0] - 0.1 * x[2]]);
        if i >= 600 {
            least = least.min((x[0] - p[1]).hypot(x[1] - 2.0 * p[2] + 1.0));
        }
    }
    least
}

/// Two coupled tanks whose valves switch with hysteresis that differs by the other tank's valve;
/// the first 6 axes are inflows of the first, the others of the second. Returns the least of minus
/// the level of the second while the valve of the first is closed.
fn two_relays(u: &[f64], instance: &Instance) -> f64 {
    let p = &instance.parameters;
    let mut x = [0.5, 0.5];
    let mut open = [false, false];
    let mut worst = -1.0_f64;
    let upper = 0.8 + 0.3 * p[0];
    let lower = 0.5 + 0.2 * p[1];
    for i in 0..1200 {
        let inflow = [0.3 + 0.6 * u[i / 200], 0.2 + 0.6 * u[6 + i / 200]];
        for k in 0..2 {
            let shift = if open[1 - k] { 0.1 } else { 0.0 };
            open[k] = x[k] > upper - shift || (open[k] && x[k] > lower + 2.0 * shift);
        }
        let out = [if open[0] { 1.1 } else { 0.0 }, if open[1] { 1.3 } else { 0.1 }];
        step(&mut x, 0.01, |x| {
            let across = 0.4 * (x[0] - x[1]);
            [
                inflow[0] - out[0] * x[0].max(0.0).sqrt() - across,
                inflow[1] - out[1] * x[1].max(0.0).sqrt() + across,
            ]
        });
        if !open[0] && i > 400 {
            worst = worst.max(x[1] - 0.5 * x[0]);
        }
    }
    -worst
}

/// A car that follows: it chases, keeps or brakes.
#[derive(Clone, Copy)]
enum Mode {
    Chase,
    Keep,
    Brake,
}

impl Mode {
    /// Returns the mode that follows this one at a gap, if one does.
    fn next(self, gap: f64) -> Option<Mode> {
        match self {
            Mode::Chase if gap <= 10.0 => Some(Mode::Keep),
            Mode::Keep if gap >= 15.0 => Some(Mode::Chase),
            Mode::Keep if gap <= 5.0 => Some(Mode::Brake),
            Mode::Brake if gap >= 20.0 => Some(Mode::Chase),
            _ => None,
        }
    }
}

/// The cars after a time `h` in their modes, with throttle and brake of the first one: the solution
/// of v' = -throttle - brake v, y' = v for it, v' = 1, y' = -v for cars that chase, v' = 0, y' = v
/// for those that keep, v' = -v, y' = -v for those that brake.
fn moved(mut x: [f64; 10], h: f64, modes: &[Mode; 4], [throttle, brake]: [f64; 2]) -> [f64; 10] {
    // Below, the difference to no brake is less than the error of the other solution.
    if brake < 1e-6 {
        x[0] += h * (x[1] - 0.5 * throttle * h);
        x[1] -= throttle * h;
    } else {
        let final_speed = -throttle / brake;
        let decay = (-brake * h).exp();
        let excess = x[1] - final_speed;
        x[0] += final_speed * h + excess * (1.0 - decay) / brake;
        x[1] = final_speed + excess * decay;
    }
    for (mode, k) in modes.iter().zip((2..).step_by(2)) {
        match mode {
            Mode::Chase => {
                x[k] -= h * (x[k + 1] + 0.5 * h);
                x[k + 1] += h;
            }
            Mode::Keep => x[k] += h * x[k + 1],
            Mode::Brake => {
                let decay = (-h).exp();
                x[k] -= x[k + 1] * (1.0 - decay);
                x[k + 1] *= decay;
            }
        }
    }
    x
}

/// Five cars of Hu, Lygeros and Sastry (HSCC 2000) as in the competition ARCH-COMP, of which four
/// follow by three modes: problem CC4, every 30 s the last gap begins 5 s above 8. Throttle and
/// brake of the first car have 20 pieces each.
fn chasing_cars(u: &[f64], _: &Instance) -> f64 {
    const STEP: f64 = 0.05;
    let mut x: [f64; 10] = std::array::from_fn(|i| if i % 2 == 0 { 5.0 * i as f64 } else { 0.0 });
    let mut modes = [Mode::Keep; 4];
    let mut gaps = vec![x[8] - x[6]];
    for i in 0..2000 {
        let inputs = [u[i / 100], u[20 + i / 100]];
        let mut left = STEP;
        while left > 0.0 {
            let next = |x: &[f64; 10], k: usize| modes[k].next(x[2 * k + 2] - x[2 * k]);
            let ends = |h: f64| {
                let x = moved(x, h, &modes, inputs);
                (0..4).any(|k| next(&x, k).is_some())
            };
            // The modes change inside the step, at a time that is known to 1e-8 s.
            let mut before = 0.0;
            let mut after = left;
            if ends(left) {
                while after - before > 1e-8 {
                    let middle = 0.5 * (before + after);
                    if ends(middle) { after = middle } else { before = middle }
                }
            }
            x = moved(x, after, &modes, inputs);
            modes = std::array::from_fn(|k| modes[k].next(x[2 * k + 2] - x[2 * k]).unwrap_or(modes[k]));
            left -= after;
        }
        gaps.push(x[8] - x[6]);
    }
    let held = least_of_windows(&gaps, 100);
    let reached = least_of_windows(&held.iter().map(|gap| -gap).collect::<Vec<_>>(), 600);
    -reached[..=1300].iter().copied().fold(f64::NEG_INFINITY, f64::max) - 8.0
}

/// Returns the least of each value and the `n` after it, as long as there are as many.
fn least_of_windows(values: &[f64], n: usize) -> Vec<f64> {
    let mut queue = std::collections::VecDeque::new();
    let mut least = Vec::new();
    for (i, value) in values.iter().enumerate() {
        while queue.back().is_some_and(|&j: &usize| values[j] >= *value) {
            queue.pop_back();
        }
        queue.push_back(i);
        if i >= n {
            while queue.front().is_some_and(|&j| j + n < i) {
                queue.pop_front();
            }
            least.extend(queue.front().map(|&j| values[j]));
        }
    }
    least
}
