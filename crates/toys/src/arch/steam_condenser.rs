//! Steam condenser: a recurrent network holds the pressure of a condenser by the flow of cooling
//! water while the flow of steam varies.
//!
//! The plant is the competition's (Yaghoubi and Fainekos, "Gray-box adversarial testing for
//! control systems with machine learning components", HSCC 2019): energy and mass balances with
//! tables of saturated steam,
//!
//! ```text
//! p' = R / V Tₛ(p) (Fₛ - Q / λ(p))               T' = (F (T₀ - T) + Q / c) / M
//! Q  = ΔT / (r₁ F^-0.8 + r₂)                     ΔT = (T - T₀) / ln((Tₛ - T₀) / (Tₛ - T))
//! ```
//!
//! with a lag of 1 s of the valve and of 0.5 s of the sensor. Temperatures are in °C, in the first
//! equation too, as in the model. The controller has the form of the competition's: three neurons
//! that see the error and, through two lags each, their own outputs. Its weights were trained by
//! studies/experiments/arch/train_condenser.py, because the competition's may not be copied.

use crate::Toy;
use mishandle_rollout::{Axis, Seed};

use crate::arch::inputs::{Input, Signal, ramp, spaces};
use crate::arch::integration::runge_kutta;

pub(crate) struct SteamCondenser;

/// Duration of a step of the integrator and of the trace, s, and steps of an episode: 35 s.
const DT: f64 = 0.01;
const STEPS: usize = 3500;
/// The step at which the set point changes from the first pressure to the second, kPa: 2 s.
const CHANGE: usize = 200;
const SET_POINTS: [f64; 2] = [90.0, 87.0];

const STEAM: Input =
    Input { name: "steam", unit: "kg/s", bounds: [3.99, 4.01], pieces: 20, meaning: "flow of steam" };

/// Saturated steam: pressure, kPa; temperature, °C; latent heat, kJ/kg.
const SATURATED: [[f64; 3]; 7] = [
    [50.0, 81.3167, 2305.42],
    [60.0, 85.9258, 2293.64],
    [70.0, 89.9315, 2283.30],
    [80.0, 93.4854, 2274.05],
    [90.0, 96.6870, 2265.65],
    [100.0, 99.6059, 2257.92],
    [110.0, 102.2923, 2250.76],
];
/// R / V of steam, kPa/(kg K). Water: inlet temperature, °C, heat, kJ/(kg K), and mass, kg.
const STEAM_VOLUME: f64 = 0.461526 / 3.0;
const INLET: f64 = 60.0;
const WATER_HEAT: f64 = 4.2;
const WATER_MASS: f64 = 500.0;
/// Resistance of the heat exchange, K/kW: the part that falls with the flow, and the rest.
const RESISTANCE: [f64; 2] = [0.0872924756541668, 0.00073786772008033];
/// Flow of water at the first set point and its largest value, kg/s. Time constants of the valve
/// and of the sensor, s.
const WATER: f64 = 107.8880952381;
const MOST_WATER: f64 = 200.0;
const VALVE: f64 = 1.0;
const SENSOR: f64 = 0.5;
/// First temperature of the water, °C.
const FIRST_TEMPERATURE: f64 = 80.0;

const NEURONS: usize = 3;
/// Rate of the lags through which neurons see their own outputs, 1/s.
const LAG: f64 = 10.0;
/// Pressure, temperature of the water, its flow, measured pressure, and two lags of each neuron.
type State = [f64; 4 + 2 * NEURONS];

/// Weights of the error, of the lags, and biases of the neurons; weights and bias of the output.
const INWARD: [f64; NEURONS] = [-0.179, 0.2123, 1.4132];
const RECURRENT: [[f64; 2 * NEURONS]; NEURONS] = [
    [-3.8626, 2.006, -1.4135, -0.0763, -0.0847, 0.4483],
    [0.1245, -3.0931, -2.1393, 1.0473, 4.2517, 1.0852],
    [-0.5905, -0.9952, -0.9903, -1.0464, 2.0795, -2.9861],
];
const BIASES: [f64; NEURONS] = [0.892, -2.2, 0.7552];
const OUTWARD: [f64; NEURONS] = [-0.7418, -0.3495, 0.6305];
const OUTPUT_BIAS: f64 = -0.6327;

impl Toy for SteamCondenser {
    fn name(&self) -> &'static str {
        "sc"
    }

    fn summary(&self) -> &'static str {
        "Steam condenser: a recurrent network holds the pressure between 87 and 87.5 kPa; a control."
    }

    fn axes(&self) -> Vec<Axis> {
        [STEAM.axes(&[4.0]), vec![ramp()]].concat()
    }

    fn spaces(&self) -> Vec<(&'static str, Vec<Axis>)> {
        spaces(self.axes())
    }

    fn signals(&self) -> &'static [(&'static str, &'static str)] {
        &[("pressure", "kPa"), ("temperature", "°C"), ("water", "kg/s"), ("heat", "kW"), ("steam", "kg/s")]
    }

    fn formulas(&self) -> &'static [(&'static str, &'static str)] {
        &[("success", "always[30:35s](pressure >= 87 and pressure <= 87.5)")]
    }

    fn control_dt(&self) -> f64 {
        DT
    }

    fn episode_steps(&self) -> usize {
        STEPS
    }

    fn simulate(&self, values: &[Option<f64>], _seed: Seed, push: &mut dyn FnMut(&[f64])) {
        let steam = Signal::new(&values[..STEAM.pieces], STEPS, values[STEAM.pieces]);
        let mut state: State = [0.0; 4 + 2 * NEURONS];
        state[..4].copy_from_slice(&[SET_POINTS[0], FIRST_TEMPERATURE, WATER, SET_POINTS[0]]);
        for step in 0..STEPS {
            let set_point = SET_POINTS[usize::from(step >= CHANGE)];
            sample(&state, steam.at(step, 0.0), push);
            state = runge_kutta(&state, DT, [0.0, 1.0], |state, share| {
                slope(state, steam.at(step, share), set_point)
            });
        }
        sample(&state, steam.at(STEPS - 1, 1.0), push);
    }
}

fn sample(state: &State, steam: f64, push: &mut dyn FnMut(&[f64])) {
    push(&[state[3], state[1], state[2], heat(state), steam]);
}

/// Returns temperature and latent heat of saturated steam, linear between the points of the table
/// and beyond them.
fn saturated(pressure: f64) -> [f64; 2] {
    let rows = SATURATED.len();
    let row = SATURATED[1..rows - 1].iter().filter(|row| row[0] <= pressure).count();
    let [low, high] = [SATURATED[row], SATURATED[row + 1]];
    let share = (pressure - low[0]) / (high[0] - low[0]);
    [1, 2].map(|column| (1.0 - share) * low[column] + share * high[column])
}

/// Returns the exchanged heat, kW.
fn heat(state: &State) -> f64 {
    let [pressure, temperature, water] = [state[0], state[1], state[2]];
    let [boiling, _] = saturated(pressure);
    let difference = (temperature - INLET) / ((boiling - INLET) / (boiling - temperature)).ln();
    difference / (RESISTANCE[0] / water.powf(0.8) + RESISTANCE[1])
}

fn slope(state: &State, steam: f64, set_point: f64) -> State {
    let [pressure, temperature, water, measured] = [state[0], state[1], state[2], state[3]];
    let memory = &state[4..];
    let [boiling, latent] = saturated(pressure);
    let heat = heat(state);
    let hidden = hidden(measured - set_point, memory);
    let mut slope: State = [0.0; 4 + 2 * NEURONS];
    slope[0] = STEAM_VOLUME * boiling * (steam - heat / latent);
    slope[1] = (water * (INLET - temperature) + heat / WATER_HEAT) / WATER_MASS;
    slope[2] = (demand(&hidden) - water) / VALVE;
    slope[3] = (pressure - measured) / SENSOR;
    for neuron in 0..NEURONS {
        slope[4 + neuron] = hidden[neuron] - LAG * memory[neuron];
        slope[4 + NEURONS + neuron] = memory[neuron] - LAG * memory[NEURONS + neuron];
    }
    slope
}

/// Returns the outputs of the neurons for an error of the pressure, kPa.
fn hidden(error: f64, memory: &[f64]) -> [f64; NEURONS] {
    // Errors between -4 and 6 kPa are between -1 and 1.
    let scaled = 0.2 * (error - 1.0);
    std::array::from_fn(|neuron| {
        let recurrent: f64 = RECURRENT[neuron].iter().zip(memory).map(|(weight, value)| weight * value).sum();
        (INWARD[neuron] * scaled + recurrent + BIASES[neuron]).tanh()
    })
}

/// Returns the flow of water that the network demands, kg/s.
fn demand(hidden: &[f64; NEURONS]) -> f64 {
    let output: f64 = OUTWARD.iter().zip(hidden).map(|(weight, value)| weight * value).sum();
    (WATER + 20.0 + 50.0 * (output + OUTPUT_BIAS)).clamp(0.0, MOST_WATER)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_state_is_in_equilibrium_at_4_kg_per_second() {
        // The published first state: heat balances, and the exchanged heat condenses the steam.
        let mut state: State = [0.0; 4 + 2 * NEURONS];
        state[..4].copy_from_slice(&[90.0, 80.0, WATER, 90.0]);
        let heat = heat(&state);
        assert!((heat / 2265.65 - 4.0).abs() < 1e-3, "{heat}");
        assert!((heat - WATER * WATER_HEAT * 20.0).abs() < 1.0, "{heat}");
        assert_eq!(saturated(85.0)[0], 0.5 * (93.4854 + 96.6870));
    }
}
