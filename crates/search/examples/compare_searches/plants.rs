//! Small plants in closed form, integrated with fourth-order Runge-Kutta steps.

use crate::problem::{Instance, Problem};

pub const PROBLEMS: [Problem; 4] = [
    Problem::new("double-pendulum", double_pendulum).with_axes(&[6]).calibrated(0.005),
    Problem::new("pendulum-return", pendulum_return).with_axes(&[6]).calibrated(0.005),
    Problem::new("relay", relay).with_axes(&[8]).calibrated(0.003),
    Problem::new("two-relays", two_relays).with_axes(&[12]).calibrated(0.003),
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
/// angles up to 100° and rates up to 2 rad/s, the ratio of the masses from 1/2 to 2 and that of the
/// rods likewise. Returns the least distance of the lower mass from a point in the time from 2 s to
/// 6 s, and 10 if all axes are at bounds.
fn pendulum(u: &[f64], point: [f64; 2]) -> f64 {
    if u.iter().all(|x| *x == 0.0 || *x == 1.0) {
        return 10.0;
    }
    const GRAVITY: f64 = 9.81;
    let centered = |i: usize| 2.0 * u[i] - 1.0;
    let mut x = [1.75 * centered(0), 1.75 * centered(1), 2.0 * centered(2), 2.0 * centered(3)];
    let (mass, rod) = (2_f64.powf(centered(4)), 2_f64.powf(centered(5)));
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
    for i in 0..300 {
        step(&mut x, 0.02, slope);
        if i >= 100 {
            let place = [x[0].sin() + rod * x[1].sin(), -x[0].cos() - rod * x[1].cos()];
            least = least.min((place[0] - point[0]).hypot(place[1] - point[1]));
        }
    }
    least
}

/// The lower mass stays away from a point above the pivot's height.
fn double_pendulum(u: &[f64], instance: &Instance) -> f64 {
    let p = &instance.parameters;
    pendulum(u, [1.2 * (2.0 * p[0] - 1.0), 0.3 + 0.8 * p[1]])
}

/// The lower mass stays away from a point below the pivot.
fn pendulum_return(u: &[f64], instance: &Instance) -> f64 {
    let p = &instance.parameters;
    pendulum(u, [2.2 * (2.0 * p[0] - 1.0), -0.2 - 0.5 * p[1]])
}

/// A mass under a relay that pushes against x + v, and a piecewise-constant disturbance: the relay
/// chatters. Returns minus the largest distance from 0 after 6 s.
fn relay(u: &[f64], instance: &Instance) -> f64 {
    let p = &instance.parameters;
    let mut x = [2.0 * p[0] - 1.0, 0.0, 0.0];
    let mut largest = 0.0_f64;
    for i in 0..1000 {
        let push = 1.5 * (2.0 * u[i * u.len() / 1000] - 1.0)
            + 0.3 * (3.0 + 4.0 * p[1] * f64::from(i as u32) * 0.01).sin();
        let control = -(x[0] + 0.5 * x[1] + 0.3 * x[2]).signum();
        step(&mut x, 0.01, |x| [x[1], control + push - 0.2 * x[1], x[0] - 0.1 * x[2]]);
        if i >= 600 {
            largest = largest.max(x[0].abs());
        }
    }
    -largest
}

/// Two coupled tanks whose valves switch with hysteresis that differs by the other tank's valve;
/// the first 6 axes are inflows of the first, the others of the second. Returns the least of minus
/// the level of the second while the valve of the first is closed.
fn two_relays(u: &[f64], instance: &Instance) -> f64 {
    let p = &instance.parameters;
    let mut x = [0.5, 0.5];
    let (mut open, mut worst) = ([false, false], -1.0_f64);
    let (upper, lower) = (0.8 + 0.3 * p[0], 0.5 + 0.2 * p[1]);
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
