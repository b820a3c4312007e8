"""A water tank whose controller fills it to 0.7 m: which start, demand and slow valve let it overflow at 1 m?"""

import math

from mishandle_simulator import serve

DT, STEPS = 0.1, 300
HELLO = {
    "name": "tank",
    "version": "1.0",
    "control_dt": DT,
    "steps": STEPS,
    "axes": [
        {"name": "level", "unit": "m", "low": 0.1, "high": 0.9, "nominal": 0.5, "kind": "start"},
        {"name": "demand", "unit": "m²/s", "low": 0.02, "high": 0.1, "nominal": 0.06, "kind": "model"},
        {"name": "lag", "unit": "s", "low": 0.5, "high": 2.0, "nominal": 1.0, "kind": "model"},
    ],
    "signals": [{"name": "level", "unit": "m"}, {"name": "valve", "unit": ""}],
    "formulas": [
        {"name": "no_overflow", "text": "always(level <= 1)"},
        {"name": "success", "text": "always[20s:30s](level >= 0.5 and level <= 0.9)"},
    ],
}


def simulate(scenario, seed):
    level, valve, integral = scenario["level"], 0.0, 0.0
    trace = {"level": [level], "valve": [valve]}
    for _ in range(STEPS):
        error = 0.7 - level
        integral += 0.4 * error * DT  # without anti-windup: the mistake
        command = min(1.0, max(0.0, error + integral))
        valve += DT / scenario["lag"] * (command - valve)
        level = max(0.0, level + DT * (0.12 * valve - scenario["demand"] * math.sqrt(level)))
        trace["level"].append(level)
        trace["valve"].append(valve)
    return {"trace": trace}


serve(HELLO, simulate)
