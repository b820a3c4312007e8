"""The water tank of ../../python/tank.py as an FMU: `pythonfmu build -f tank.py`."""

import math

from pythonfmu import Boolean, Fmi2Causality, Fmi2Initial, Fmi2Slave, Fmi2Variability, Integer, Real


class Tank(Fmi2Slave):
    def __init__(self, **arguments):
        super().__init__(**arguments)
        self.start_level, self.demand, self.lag, self.is_closed = 0.5, 0.06, 1.0, False
        self.fails_at = self.ends_at = 0
        self.level, self.valve, self.integral, self.extra = 0.5, 0.0, 0.0, 0.0
        parameter = dict(causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed)
        self.register_variable(Real("start_level", **parameter))
        self.register_variable(Real("demand", **parameter))
        self.register_variable(Real("lag", **parameter))
        self.register_variable(Boolean("is_closed", **parameter))
        self.register_variable(Integer("fails_at", **parameter))
        self.register_variable(Integer("ends_at", **parameter))
        self.register_variable(Real("extra", causality=Fmi2Causality.input))
        output = dict(causality=Fmi2Causality.output, initial=Fmi2Initial.calculated)
        self.register_variable(Real("level", **output))
        self.register_variable(Real("valve", **output))
        self.steps = 0

    def exit_initialization_mode(self):
        self.level = self.start_level

    def do_step(self, time, dt):
        print("a print of the FMU", flush=True)
        self.steps += 1
        if self.steps == self.ends_at:
            return False
        if self.steps == self.fails_at:
            raise ValueError("the solver does not converge")
        error = 0.7 - self.level
        self.integral += 0.4 * error * dt
        command = 0.0 if self.is_closed else min(1.0, max(0.0, error + self.integral))
        self.valve += dt / self.lag * (command - self.valve)
        inflow = 0.12 * self.valve + self.extra
        self.level = max(0.0, self.level + dt * (inflow - self.demand * math.sqrt(self.level)))
        return True
