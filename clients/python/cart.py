"""A cart on a rail whose controller is outside: Mishandle runs the policy, with faults and delays, and stops early."""

from mishandle_simulator import serve

DT = 0.05
HELLO = {
    "name": "cart",
    "version": "1.0",
    "control_dt": DT,
    "steps": 200,
    "axes": [
        {"name": "position", "unit": "m", "low": -0.5, "high": 0.5, "nominal": 0.0, "kind": "start"},
        {"name": "velocity", "unit": "m/s", "low": -1.0, "high": 1.0, "nominal": 0.0, "kind": "start"},
        {"name": "mass", "unit": "kg", "low": 0.5, "high": 2.0, "nominal": 1.0, "kind": "model"},
    ],
    "signals": [{"name": "position", "unit": "m"}, {"name": "velocity", "unit": "m/s"}],
    "formulas": [{"name": "on_rail", "text": "always(position <= 1 and position >= -1)"}],
    "policy": {
        "observation": [{"name": "position", "unit": "m", "size": 1}, {"name": "velocity", "unit": "m/s", "size": 1}],
        "action": [{"name": "force", "unit": "N", "size": 1}],
        "action_limit": 1.0,
    },
}
cart = {}


def answer():
    state = [cart["position"], cart["velocity"]]
    return {"signals": state, "observation": state}


def reset(scenario, seed):
    cart.update({name: scenario[name] for name in ("position", "velocity", "mass")})
    return answer()


def step(action):
    cart["velocity"] += DT * action[0] / cart["mass"]
    cart["position"] += DT * cart["velocity"]
    return answer()


serve(HELLO, reset=reset, step=step)
