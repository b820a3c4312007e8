//! The plant before the sensor: throttle, intake manifold, wall wetting.
//!
//! The pressure is stiff: near that of the atmosphere the flow through the throttle has an infinite
//! slope. It depends on no state but the throttle's, so that an implicit method for one number is
//! enough; all else takes explicit steps.

use super::controller::{Measured, air_estimate};

/// R T / V of the intake manifold, bar/g.
pub(crate) const MANIFOLD: f64 = 0.41328;
/// Factor of the pumped air in the plant, which the controller does not know.
const PUMPED: f64 = 0.9;
/// Opening of the throttle at rest, degrees, and time constant of the throttle, s.
const BASE_ANGLE: f64 = 8.8;
const THROTTLE_TIME: f64 = 0.1;
/// Pressure ratio below which the flow is sonic.
const SONIC: f64 = 0.5;

/// Steps of the manifold in half a step of all else: after a pedal step, the pressure settles
/// within milliseconds.
const MANIFOLD_STEPS: usize = 4;

/// First values: manifold pressure, bar, and fuel on the walls, g.
const FIRST_PRESSURE: f64 = 0.982;
const FIRST_PUDDLE: f64 = 0.0112;

/// A table over engine speed (rpm) and air charge (g per cylinder), linear between its points and
/// beyond them.
struct Table {
    speeds: [f64; 5],
    charges: [f64; 4],
    /// One row per charge.
    values: [[f64; 5]; 4],
}

const SPEEDS: [f64; 5] = [1000.0, 1500.0, 2000.0, 2500.0, 3000.0];
const CHARGES: [f64; 4] = [0.1, 0.2, 0.3, 0.4];

/// Share of the injected fuel that enters the cylinder as vapor.
const VAPOR: Table = Table {
    speeds: SPEEDS,
    charges: CHARGES,
    values: [
        [0.8, 0.7, 0.7, 0.8, 0.9],
        [0.7, 0.66, 0.65, 0.73, 0.85],
        [0.66, 0.66, 0.63, 0.66, 0.8],
        [0.6, 0.6, 0.6, 0.6, 0.7],
    ],
};

/// Time constant of the fuel on the walls, s.
const WALL_TIME: Table = Table {
    speeds: SPEEDS,
    charges: CHARGES,
    values: [
        [0.4, 0.3, 0.35, 0.3, 0.2],
        [0.22, 0.22, 0.4, 0.35, 0.5],
        [0.2, 0.22, 0.5, 0.4, 0.35],
        [0.35, 0.3, 0.45, 0.5, 0.4],
    ],
};

/// Delay from the cylinders to the sensor, s.
const DELAY: Table = Table {
    speeds: [800.0, 1000.0, 1500.0, 2000.0, 3000.0],
    charges: [0.05, 0.15, 0.2, 0.25],
    values: [
        [0.8, 0.6, 0.4, 0.3, 0.2],
        [0.4, 0.3, 0.2, 0.2, 0.2],
        [0.3, 0.25, 0.2, 0.2, 0.2],
        [0.25, 0.2, 0.2, 0.2, 0.2],
    ],
};

impl Table {
    fn at(&self, rpm: f64, charge: f64) -> f64 {
        let (column, x) = place(&self.speeds, rpm);
        let (row, y) = place(&self.charges, charge);
        let along = |row: usize| (1.0 - x) * self.values[row][column] + x * self.values[row][column + 1];
        (1.0 - y) * along(row) + y * along(row + 1)
    }
}

/// Returns the interval of `points` that is nearest to a value, and the value's share of it, which
/// is outside \[0, 1\] beyond the points.
fn place(points: &[f64], value: f64) -> (usize, f64) {
    let interval = points[1..points.len() - 1].iter().filter(|point| **point <= value).count();
    (interval, (value - points[interval]) / (points[interval + 1] - points[interval]))
}

/// Air, fuel and delay at the begin, the middle and the end of a step.
pub(crate) struct Flow {
    /// Ratio of air to fuel in the cylinders.
    pub ratio: [f64; 3],
    /// Delay from the cylinders to the sensor, s.
    pub delay: [f64; 3],
}

pub(crate) struct Plant {
    rpm: f64,
    /// rad/s.
    speed: f64,
    /// Throttle angle without the base opening, degrees; manifold pressure, bar; fuel on the
    /// walls, g.
    throttle: f64,
    pressure: f64,
    puddle: f64,
}

impl Plant {
    pub fn new(rpm: f64) -> Plant {
        let speed = rpm * std::f64::consts::PI / 30.0;
        Plant { rpm, speed, throttle: 0.0, pressure: FIRST_PRESSURE, puddle: FIRST_PUDDLE }
    }

    /// Returns the manifold pressure, bar.
    pub fn pressure(&self) -> f64 {
        self.pressure
    }

    /// Returns the measured values.
    pub fn measured(&self) -> Measured {
        let throttle = opening(self.throttle);
        Measured { throttle, throttle_flow: throttle_flow(throttle, self.pressure).0, speed: self.speed }
    }

    /// Takes a step of `dt` with a pedal that moves linearly, and constant injected fuel, g/s.
    pub fn step(&mut self, dt: f64, [begin, end]: [f64; 2], fuel: f64) -> Flow {
        let moved = Actuator { angle: self.throttle, pedal: begin, rate: (end - begin) / dt };
        let part = 0.5 * dt / MANIFOLD_STEPS as f64;
        let half = |first: usize, pressure: f64| {
            (first..first + MANIFOLD_STEPS).fold(pressure, |pressure, step| {
                self.manifold_step(part * step as f64, part, pressure, &moved)
            })
        };
        let middle = half(0, self.pressure);
        let last = half(MANIFOLD_STEPS, middle);
        let pressures = [self.pressure, middle, last];
        self.throttle = moved.at(dt).0;
        self.pressure = last;

        let air = pressures.map(|pressure| PUMPED * air_estimate(pressure, self.speed));
        // The engine has four cylinders and pumps every second revolution.
        let charge = air.map(|air| std::f64::consts::PI * air / self.speed);
        let vapor = charge.map(|charge| VAPOR.at(self.rpm, charge));
        let wall_time = charge.map(|charge| WALL_TIME.at(self.rpm, charge));
        let slope = |place: usize, puddle: f64| (1.0 - vapor[place]) * fuel - puddle / wall_time[place];
        let puddle = self.puddle;
        let first = slope(0, puddle);
        let second = slope(1, puddle + 0.5 * dt * first);
        let third = slope(1, puddle + 0.5 * dt * second);
        let fourth = slope(2, puddle + dt * third);
        self.puddle += dt / 6.0 * (first + 2.0 * (second + third) + fourth);
        // The cubic through both ends and their slopes.
        let between = 0.5 * (puddle + self.puddle) + dt / 8.0 * (first - slope(2, self.puddle));
        let puddles = [puddle, between, self.puddle];
        Flow {
            ratio: std::array::from_fn(|i| air[i] / (vapor[i] * fuel + puddles[i] / wall_time[i])),
            delay: charge.map(|charge| DELAY.at(self.rpm, charge)),
        }
    }

    /// Takes a step of Rodas3, a Rosenbrock method of order 3 that is L-stable (Sandu et al.,
    /// "Benchmarking stiff ODE solvers for atmospheric chemistry problems II", Atmospheric
    /// Environment 31, 1997).
    fn manifold_step(&self, time: f64, dt: f64, pressure: f64, throttle: &Actuator) -> f64 {
        let ends = [throttle.at(time), throttle.at(time + dt)];
        let derivative = |end: usize, pressure: f64| {
            let flow = throttle_flow(opening(ends[end].0), pressure).0;
            MANIFOLD * (flow - PUMPED * air_estimate(pressure, self.speed))
        };
        let (angle, rate) = ends[0];
        let (_, by_pressure, by_angle) = throttle_flow(opening(angle), pressure);
        let pumped = self.speed * (0.08979 - 0.0674 * pressure + 0.0001 * self.speed);
        let jacobian = MANIFOLD * (by_pressure - PUMPED * pumped);
        let by_time = MANIFOLD * by_angle * rate;
        let inverse = 1.0 / (2.0 / dt - jacobian);
        let begin = derivative(0, pressure);
        let first = inverse * (begin + 0.5 * dt * by_time);
        let second = inverse * (begin + 4.0 / dt * first + 1.5 * dt * by_time);
        let third = inverse * (derivative(1, pressure + 2.0 * first) + (first - second) / dt);
        let fourth = inverse
            * (derivative(1, pressure + 2.0 * first + third) + (first - second - 8.0 / 3.0 * third) / dt);
        pressure + 2.0 * first + third + fourth
    }
}

/// The throttle's lag of first order behind a pedal that moves linearly.
struct Actuator {
    angle: f64,
    pedal: f64,
    rate: f64,
}

impl Actuator {
    /// Returns the angle and its rate after a time, exactly.
    fn at(&self, time: f64) -> (f64, f64) {
        let lag = THROTTLE_TIME * self.rate;
        let rest = (self.angle - self.pedal + lag) * (-time / THROTTLE_TIME).exp();
        (self.pedal + self.rate * time - lag + rest, self.rate - rest / THROTTLE_TIME)
    }
}

fn opening(throttle: f64) -> f64 {
    (throttle + BASE_ANGLE).clamp(0.0, 90.0)
}

/// Returns the flow through the throttle, g/s, and its derivatives by pressure and by angle, at an
/// angle (degrees) and a manifold pressure (bar); the atmosphere has 1 bar.
fn throttle_flow(angle: f64, pressure: f64) -> (f64, f64, f64) {
    let area = 2.821 - 0.05231 * angle + 0.10299 * angle * angle - 0.00063 * angle.powi(3);
    let area_by_angle = -0.05231 + 0.20598 * angle - 0.00189 * angle * angle;
    let (ratio, sign) = if pressure <= 1.0 { (pressure, 1.0) } else { (1.0 / pressure, -1.0) };
    if ratio < SONIC {
        return (sign * area, 0.0, sign * area_by_angle);
    }
    let root = (ratio - ratio * ratio).max(0.0).sqrt();
    // The slope at equal pressures is infinite; this bound only keeps the step of an implicit
    // method finite.
    let slope = (1.0 - 2.0 * ratio) / root.max(1e-9) * if sign > 0.0 { 1.0 } else { ratio * ratio };
    (sign * 2.0 * area * root, area * slope, sign * 2.0 * area_by_angle * root)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_exact_at_their_points_and_linear_between_and_beyond_them() {
        assert_eq!(
            [VAPOR.at(1000.0, 0.1), WALL_TIME.at(3000.0, 0.2), DELAY.at(800.0, 0.25)],
            [0.8, 0.5, 0.25]
        );
        assert!((DELAY.at(900.0, 0.1) - 0.25 * (0.8 + 0.6 + 0.4 + 0.3)).abs() < 1e-12);
        // One step of 500 rpm lowers the share by 0.1, so 100 rpm less raise it by 0.02.
        assert!((VAPOR.at(900.0, 0.1) - 0.82).abs() < 1e-12);
        assert!((VAPOR.at(1000.0, 0.05) - 0.85).abs() < 1e-12);
    }

    #[test]
    fn the_derivatives_of_the_flow_are_those_of_differences() {
        for (angle, pressure) in [(8.8, 0.7), (40.0, 0.95), (70.0, 0.4), (30.0, 1.1)] {
            let (flow, by_pressure, by_angle) = throttle_flow(angle, pressure);
            let step = 1e-6;
            let differences = [
                (throttle_flow(angle, pressure + step).0 - flow) / step,
                (throttle_flow(angle + step, pressure).0 - flow) / step,
            ];
            assert!((by_pressure - differences[0]).abs() < 1e-3 * by_pressure.abs().max(1.0));
            assert!((by_angle - differences[1]).abs() < 1e-3);
        }
    }

    #[test]
    fn the_pressure_settles_where_inflow_and_outflow_are_equal() {
        for pedal in [0.0, 30.0, 61.2, 81.2] {
            let mut plant = Plant::new(1000.0);
            for _ in 0..4000 {
                plant.step(0.005, [pedal, pedal], 0.4);
            }
            let inflow = throttle_flow(pedal + 8.8, plant.pressure).0;
            let outflow = 0.9 * air_estimate(plant.pressure, plant.speed);
            assert!((inflow - outflow).abs() < 1e-9 && plant.pressure < 1.0, "{pedal}: {inflow} {outflow}");
        }
    }
}
