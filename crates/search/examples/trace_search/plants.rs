//! Plants with two signals, driven by two inputs.

/// Samples of an episode, after the first.
pub const STEPS: usize = 120;

/// A plant: returns the signals a and b after each step, for inputs in [0, 1] at each step, and
/// random parameters in [0, 1].
pub type Plant = fn(&dyn Fn(f64) -> [f64; 2], &[f64]) -> Vec<[f64; 2]>;

/// Name, plant, and the ends of the windows of a and b as fractions of the episode.
pub const PLANTS: [(&str, Plant, [f64; 2]); 7] = [
    ("heaters", heaters, [1.0, 0.5]),
    ("tanks", tanks, [1.0, 0.6]),
    ("masses", masses, [1.0, 0.6]),
    ("reactor", reactor, [0.9, 0.5]),
    ("vehicle", vehicle, [1.0, 0.7]),
    ("relay", relay, [1.0, 0.5]),
    ("switching", switching, [1.0, 0.6]),
];

fn steps(
    input: &dyn Fn(f64) -> [f64; 2],
    mut state: Vec<f64>,
    mut step: impl FnMut(&mut Vec<f64>, [f64; 2]),
    signals: impl Fn(&[f64]) -> [f64; 2],
) -> Vec<[f64; 2]> {
    let mut trace = vec![signals(&state)];
    for i in 0..STEPS {
        step(&mut state, input(i as f64 / STEPS as f64));
        trace.push(signals(&state));
    }
    trace
}

/// Two rooms with a heater each, °C and m°C.
fn heaters(input: &dyn Fn(f64) -> [f64; 2], p: &[f64]) -> Vec<[f64; 2]> {
    let coupling = 0.4 + 0.4 * p[0];
    let loss = [0.3 + 0.4 * p[1], 0.3 + 0.4 * p[2]];
    let dt = 6.0 / STEPS as f64;
    steps(
        input,
        vec![15.0, 15.0],
        |x, u| {
            let flow = coupling * (x[0] - x[1]);
            let d =
                [8.0 * u[0] - loss[0] * (x[0] - 10.0) - flow, 8.0 * u[1] - loss[1] * (x[1] - 10.0) + flow];
            (0..2).for_each(|k| x[k] += dt * d[k]);
        },
        |x| [x[0], 1e3 * x[1]],
    )
}

/// Two tanks in a row, m and mm.
fn tanks(input: &dyn Fn(f64) -> [f64; 2], p: &[f64]) -> Vec<[f64; 2]> {
    let c = [0.5 + 0.4 * p[0], 0.5 + 0.4 * p[1]];
    let dt = 8.0 / STEPS as f64;
    steps(
        input,
        vec![0.5, 0.5],
        |h, q| {
            let out = [c[0] * h[0].max(0.0).sqrt(), c[1] * h[1].max(0.0).sqrt()];
            let d = [q[0] - out[0], 0.5 * q[1] + out[0] - out[1]];
            (0..2).for_each(|k| h[k] = (h[k] + dt * d[k]).max(0.0));
        },
        |h| [h[0], 1e3 * h[1]],
    )
}

/// Two masses and springs, m and mm.
fn masses(input: &dyn Fn(f64) -> [f64; 2], p: &[f64]) -> Vec<[f64; 2]> {
    let k = [1.0 + p[0], 0.5 + p[1]];
    let c = 0.3 + 0.3 * p[2];
    let dt = 8.0 / STEPS as f64;
    steps(
        input,
        vec![0.0; 4],
        |x, u| {
            let spring = k[1] * (x[1] - x[0]);
            let force =
                [2.0 * u[0] - 1.0 - k[0] * x[0] + spring - c * x[2], 2.0 * u[1] - 1.0 - spring - c * x[3]];
            (0..2).for_each(|i| x[2 + i] += dt * force[i]);
            (0..2).for_each(|i| x[i] += dt * x[2 + i]);
        },
        |x| [x[0], 1e3 * x[1]],
    )
}

/// A stirred tank with an exothermic reaction: temperature K, concentration mmol/m³ of the product.
fn reactor(input: &dyn Fn(f64) -> [f64; 2], p: &[f64]) -> Vec<[f64; 2]> {
    let rate = 0.6 + 0.4 * p[0];
    let cooling = 0.8 + 0.4 * p[1];
    let dt = 6.0 / STEPS as f64;
    steps(
        input,
        vec![0.5, 0.0],
        |x, u| {
            let speed = rate * x[0] * (2.0 * x[1]).min(4.0).exp();
            let feed = 0.3 + 0.7 * u[0];
            let d = [feed * (1.0 - x[0]) - speed, -feed * x[1] + speed - cooling * (0.5 + u[1]) * x[1]];
            (0..2).for_each(|k| x[k] += dt * d[k]);
        },
        |x| [x[1], 1e3 * (1.0 - x[0])],
    )
}

/// A car: speed m/s, and slip of the tires in thousandths, both driven by throttle and grade.
fn vehicle(input: &dyn Fn(f64) -> [f64; 2], p: &[f64]) -> Vec<[f64; 2]> {
    let mass = 0.8 + 0.4 * p[0];
    let drag = 0.05 + 0.05 * p[1];
    let dt = 10.0 / STEPS as f64;
    steps(
        input,
        vec![1.0, 0.0],
        |x, u| {
            let push = 2.0 * u[0] - u[1] - drag * x[0] * x[0].abs();
            x[1] += dt * 2.0 * (push.tanh() - x[1]);
            x[0] += dt * x[1] / mass;
        },
        |x| [x[0], 1e3 * x[1]],
    )
}

/// A room with a thermostat whose relay chatters.
fn relay(input: &dyn Fn(f64) -> [f64; 2], p: &[f64]) -> Vec<[f64; 2]> {
    let gain = 4.0 + 2.0 * p[0];
    let dt = 8.0 / STEPS as f64;
    steps(
        input,
        vec![0.0, 0.0],
        |x, u| {
            let relay = if x[0] > u[0] { -1.0 } else { 1.0 };
            let other = if x[1] > x[0] { -0.6 } else { 0.8 };
            let d = [gain * relay * (0.3 + u[1]) - 0.5 * x[0], 2.0 * other - x[1] + 1.5 * (u[1] - 0.5)];
            (0..2).for_each(|k| x[k] += dt * d[k]);
        },
        |x| [x[0], 1e3 * x[1]],
    )
}

/// Gears: the dynamics jump between three modes, with a delay.
fn switching(input: &dyn Fn(f64) -> [f64; 2], p: &[f64]) -> Vec<[f64; 2]> {
    let shift = 1.0 + 0.5 * p[0];
    let dt = 10.0 / STEPS as f64;
    let mut gear = 0_usize;
    let mut wait = 0;
    steps(
        input,
        vec![0.0, 0.0],
        |x, u| {
            wait = (wait - 1).max(0);
            let required = usize::from(x[0] > shift) + usize::from(x[0] > 2.0 * shift);
            if required != gear && wait == 0 {
                (gear, wait) = (required, 8);
            }
            let ratio = [2.0, 1.2, 0.8][gear];
            let torque = ratio * (u[0] + 0.2) - 0.25 * x[0] - 1.5 * u[1] * u[1];
            x[0] = (x[0] + dt * torque).max(0.0);
            x[1] = ratio * x[0] + 0.3 * u[0];
        },
        |x| [x[0], 1e3 * x[1]],
    )
}
