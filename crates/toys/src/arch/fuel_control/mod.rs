//! Fuel control of an automotive powertrain: a controller holds the ratio of air to fuel at its
//! reference while the driver moves the throttle.
//!
//! Model 1 of Jin, Deshmukh, Kapinski, Ueda and Butts, "Powertrain control verification benchmark",
//! HSCC 2014, the one with tables and a variable transport delay, and the one that the competition
//! runs (`AbstractFuelControl_M1`). Its units stay: degrees, bar, g/s, g per cylinder, rpm.
//!
//! - `plant`: throttle, intake manifold, wall wetting
//! - `transport`: the delay between the cylinders and the sensor, and the sensor
//! - `controller`: the controller that runs each 10 ms, with its modes

mod controller;
mod plant;
mod transport;

use crate::Toy;
use mishandle_rollout::{Axis, Seed};

use crate::arch::inputs::{Input, Signal, ramp, spaces};
use controller::{Controller, TICK};
use plant::Plant;
use transport::Sensor;

/// A problem: a requirement and the mode of the controller that the range of the pedal selects.
#[derive(Clone, Copy)]
pub(crate) enum Problem {
    Afc27,
    Afc29,
    Afc33,
}

pub(crate) struct FuelControl(pub Problem);

/// Ticks of the controller in an episode of 50 s, and steps of the integrator in a tick.
const TICKS: usize = 5000;
const STEPS_PER_TICK: usize = 2;
const STEPS: usize = STEPS_PER_TICK * TICKS;
/// Duration of a step, s.
const DT: f64 = TICK / STEPS_PER_TICK as f64;

/// The tick from which `mu` is measured: 1 s. Before it `mu` is 0.
const MEASURED_FROM: usize = 100;

/// Pedal angle above which the controller enters power mode, degrees: 70 less the base opening of
/// 8.8. At this angle, and in floating point at the next one, the throttle approaches 70 from below
/// without end. So the range of power mode, which excludes it, begins a little above.
const POWER: f64 = 61.2;
const ABOVE: f64 = 1e-9;

/// Pieces of the pedal; the engine speed is constant.
const PIECES: usize = 10;

const SPEED: Input =
    Input { name: "engine_speed", unit: "rpm", bounds: [900.0, 1100.0], pieces: 1, meaning: "engine speed" };

impl FuelControl {
    fn pedal(&self) -> Input {
        let bounds = match self.0 {
            Problem::Afc27 | Problem::Afc29 => [0.0, POWER],
            Problem::Afc33 => [POWER + ABOVE, 81.2],
        };
        Input { name: "throttle", unit: "deg", bounds, pieces: PIECES, meaning: "pedal angle" }
    }
}

impl Toy for FuelControl {
    fn name(&self) -> &'static str {
        match self.0 {
            Problem::Afc27 => "afc27",
            Problem::Afc29 => "afc29",
            Problem::Afc33 => "afc33",
        }
    }

    fn summary(&self) -> &'static str {
        match self.0 {
            Problem::Afc27 => {
                "Fuel control: the error of air to fuel settles after the pedal rises or falls."
            }
            Problem::Afc29 => "Fuel control: the error of air to fuel stays below 0.7 %.",
            Problem::Afc33 => {
                "Fuel control in power mode: the error of air to fuel stays below 0.7 %; a control."
            }
        }
    }

    fn axes(&self) -> Vec<Axis> {
        let pedal = self.pedal();
        let nominal = 0.5 * (pedal.bounds[0] + pedal.bounds[1]);
        [pedal.axes(&[nominal]), SPEED.axes(&[1000.0]), vec![ramp()]].concat()
    }

    fn spaces(&self) -> Vec<(&'static str, Vec<Axis>)> {
        spaces(self.axes())
    }

    fn signals(&self) -> &'static [(&'static str, &'static str)] {
        &[
            ("mu", ""),
            ("open_loop", ""),
            ("air_fuel_ratio", ""),
            ("manifold_pressure", "bar"),
            ("fuel", "g/s"),
            ("throttle", "deg"),
            ("engine_speed", "rpm"),
        ]
    }

    fn formulas(&self) -> &'static [(&'static str, &'static str)] {
        match self.0 {
            Problem::Afc27 => &[(
                "success",
                "always[11:45s](\
                 ((throttle < 8.8 and eventually[0:0.05s](throttle > 40)) or \
                 (throttle > 40 and eventually[0:0.05s](throttle < 8.8))) implies always[1:5s](abs(mu) < 0.008))",
            )],
            Problem::Afc29 | Problem::Afc33 => &[("success", "always[11:50s](abs(mu) < 0.007)")],
        }
    }

    fn control_dt(&self) -> f64 {
        TICK
    }

    fn episode_steps(&self) -> usize {
        TICKS
    }

    fn simulate(&self, values: &[Option<f64>], _seed: Seed, push: &mut dyn FnMut(&[f64])) {
        let (pedal, rest) = values.split_at(PIECES);
        let pedal = Signal::new(pedal, STEPS, rest[1]);
        let rpm = rest[0].unwrap_or_default();
        let mut plant = Plant::new(rpm);
        let mut sensor = Sensor::new();
        let mut controller = Controller::new();
        for tick in 0..=TICKS {
            let first = STEPS_PER_TICK * tick;
            if tick > 0 {
                controller.tick(&plant.measured(), sensor.ratio());
            }
            let ratio = sensor.ratio();
            let mu = if tick >= MEASURED_FROM { ratio / controller.reference() - 1.0 } else { 0.0 };
            // The last sample has the input of the last piece.
            let angle = if tick < TICKS { pedal.at(first, 0.0) } else { pedal.at(STEPS - 1, 1.0) };
            let open_loop = f64::from(u8::from(controller.is_open_loop()));
            push(&[mu, open_loop, ratio, plant.pressure(), controller.fuel(), angle, rpm]);
            if tick < TICKS {
                for step in first..first + STEPS_PER_TICK {
                    let flow = plant.step(DT, [pedal.at(step, 0.0), pedal.at(step, 1.0)], controller.fuel());
                    sensor.step(DT, &flow);
                }
            }
        }
    }
}
