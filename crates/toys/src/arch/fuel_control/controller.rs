//! The controller: an estimate of the air that enters the cylinders, a feedforward of fuel for it,
//! and in normal mode a PI controller of the measured ratio.

/// Period, s.
pub(crate) const TICK: f64 = 0.01;

/// Time until the controller leaves the startup mode, s.
const STARTUP: f64 = 10.0;
/// Throttle angles above which power mode begins, and below which it ends, degrees.
const POWER_ON: f64 = 70.0;
const POWER_OFF: f64 = 50.0;
/// References of the ratio of air to fuel in normal mode and in power mode.
const NORMAL_RATIO: f64 = 14.7;
const POWER_RATIO: f64 = 12.5;
/// Gains of the PI controller, and bounds of the commanded fuel, g/s.
const PROPORTIONAL: f64 = 0.04;
const INTEGRAL: f64 = 0.14;
const FUEL: [f64; 2] = [0.13, 1.66];
/// Fuel before the first tick, g/s, and first estimate of the manifold pressure, bar.
const FIRST_FUEL: f64 = 0.1726;
const FIRST_PRESSURE: f64 = 0.982;

/// Measured values of the plant.
pub(crate) struct Measured {
    /// Angle of the throttle with its base opening, degrees.
    pub throttle: f64,
    /// Air through the throttle, g/s.
    pub throttle_flow: f64,
    /// Engine speed, rad/s.
    pub speed: f64,
}

pub(crate) struct Controller {
    fuel: f64,
    reference: f64,
    open_loop: bool,
    clock: f64,
    is_started: bool,
    is_power: bool,
    pressure: f64,
    integral: f64,
}

impl Controller {
    pub fn new() -> Controller {
        Controller {
            fuel: FIRST_FUEL,
            reference: NORMAL_RATIO,
            open_loop: true,
            clock: 0.0,
            is_started: false,
            is_power: false,
            pressure: FIRST_PRESSURE,
            integral: 0.0,
        }
    }

    /// Returns the commanded fuel, g/s.
    pub fn fuel(&self) -> f64 {
        self.fuel
    }

    /// Returns the reference of the ratio of air to fuel.
    pub fn reference(&self) -> f64 {
        self.reference
    }

    /// Returns whether the PI controller is off: in startup mode and in power mode.
    pub fn is_open_loop(&self) -> bool {
        self.open_loop
    }

    /// Runs once with the measured plant and the measured ratio of air to fuel. The model also has
    /// a mode for a failed sensor, which no problem of the competition enters.
    pub fn tick(&mut self, measured: &Measured, ratio: f64) {
        self.clock += TICK;
        self.is_started |= self.clock >= STARTUP;
        self.is_power = measured.throttle >= if self.is_power { POWER_OFF } else { POWER_ON };
        self.open_loop = !self.is_started || self.is_power;
        self.reference = if self.is_started && self.is_power { POWER_RATIO } else { NORMAL_RATIO };

        let air = air_estimate(self.pressure, measured.speed);
        self.pressure += TICK * super::plant::MANIFOLD * (measured.throttle_flow - air);
        let trim = if self.open_loop {
            1.0
        } else {
            let error = ratio - self.reference;
            self.integral += TICK * INTEGRAL * error;
            (1.0 + PROPORTIONAL * error + self.integral).max(0.0)
        };
        self.fuel = (trim * air / self.reference).clamp(FUEL[0], FUEL[1]);
    }
}

/// Returns the air that a manifold pressure (bar) and an engine speed (rad/s) pump, g/s.
pub(crate) fn air_estimate(pressure: f64, speed: f64) -> f64 {
    -0.366 + 0.08979 * speed * pressure - 0.0337 * speed * pressure * pressure
        + 0.0001 * speed * speed * pressure
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tick(controller: &mut Controller, throttle: f64, ratio: f64) {
        controller.tick(&Measured { throttle, throttle_flow: 5.0, speed: 100.0 }, ratio);
    }

    #[test]
    fn the_modes_follow_the_clock_and_the_throttle_with_hysteresis() {
        let mut controller = Controller::new();
        (0..990).for_each(|_| tick(&mut controller, 20.0, 14.7));
        assert!(controller.is_open_loop());
        (0..20).for_each(|_| tick(&mut controller, 20.0, 14.7));
        assert!(!controller.is_open_loop() && controller.reference() == 14.7);
        for (throttle, is_power) in [(69.9, false), (70.0, true), (50.0, true), (49.9, false), (69.9, false)]
        {
            tick(&mut controller, throttle, 14.7);
            assert_eq!(controller.is_open_loop(), is_power, "{throttle}");
            assert_eq!(controller.reference(), if is_power { 12.5 } else { 14.7 });
        }
    }

    #[test]
    fn too_much_air_is_answered_with_fuel_by_the_gains() {
        let mut controller = Controller::new();
        (0..1100).for_each(|_| tick(&mut controller, 20.0, 14.7));
        let before = controller.fuel();
        tick(&mut controller, 20.0, 15.7);
        // The estimate has settled, so that the fuel changes by the trim alone.
        assert!((controller.fuel() / before - (1.0 + 0.04 + 0.01 * 0.14)).abs() < 1e-6);
    }
}
