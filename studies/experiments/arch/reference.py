"""Writes traces of the problems of the ARCH competition that SciPy's integrators make, to compare crates/toys with.

    python -m venv target/arch-venv && target/arch-venv/bin/pip install --requirement studies/experiments/arch/requirements.txt
    target/arch-venv/bin/python studies/experiments/arch/reference.py chasing_cars
    target/arch-venv/bin/python studies/experiments/arch/reference.py fuel_control
    target/arch-venv/bin/python studies/experiments/arch/reference.py steam_condenser

The equations are written again here, from the sources that docs/reference/arch.md names, with other methods: variable steps with a
relative tolerance of 1e-10 or less, events of SciPy for changes of mode, Radau for the stiff manifold. The files are
crates/toys/tests/data/MODEL.csv: lines `input,CASE,VALUES` in the order of the axes of the space `instance-1`, and
`sample,CASE,TIME,SIGNALS`.
"""

import json
import pathlib
import sys

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

DATA = pathlib.Path(__file__).parents[3] / "crates/toys/tests/data"
WEIGHTS = pathlib.Path(__file__).parent / "condenser_weights.json"
TOLERANCES = {"rtol": 1e-11, "atol": 1e-11}


def value(knots, duration, ramp, time, piece):
    """Returns a piecewise input at a time that belongs to a piece."""
    length = duration / len(knots)
    before = knots[max(piece - 1, 0)]
    since = time - piece * length
    share = min(since / (ramp * length), 1.0) if ramp > 0 else 1.0
    return before + share * (knots[piece] - before)


def breaks(pieces, duration, ramp):
    """Returns the times at which an input may bend or jump, with the piece that follows each."""
    length = duration / pieces
    times = {(piece * length, piece) for piece in range(pieces)}
    times |= {((piece + ramp) * length, piece) for piece in range(pieces) if 0 < ramp < 1}
    return sorted(times)


CHASING, KEEPING, BRAKING = range(3)


def chasing_cars(throttle, brake, ramp, times):
    """Returns positions of the five cars at the times."""
    duration = 100.0
    modes = [KEEPING] * 4
    state = np.array([0.0, 10.0, 20.0, 30.0, 40.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    found = np.full((len(times), 5), np.nan)
    edges = breaks(20, duration, ramp)
    switches = 0
    for (begin, piece), (end, _) in zip(edges, [*edges[1:], (duration, 20)]):

        def slope(time, state):
            y, v = state[:5], state[5:]
            u, b = (value(knots, duration, ramp, time, piece) for knots in (throttle, brake))
            rates = {CHASING: lambda v: (-v, 1.0), KEEPING: lambda v: (v, 0.0), BRAKING: lambda v: (-v, -v)}
            dy, dv = [v[0]], [-u - b * v[0]]
            for mode, speed in zip(modes, v[1:]):
                rate = rates[mode](speed)
                dy.append(rate[0])
                dv.append(rate[1])
            return [*dy, *dv]

        time = begin
        while time < end:
            events, targets = [], []
            for car, mode in enumerate(modes):
                for limit, rises, new in {
                    CHASING: [(10.0, False, KEEPING)],
                    KEEPING: [(15.0, True, CHASING), (5.0, False, BRAKING)],
                    BRAKING: [(20.0, True, CHASING)],
                }[mode]:
                    event = lambda t, s, car=car, limit=limit: s[car + 1] - s[car] - limit
                    event.terminal, event.direction = True, 1 if rises else -1
                    events.append(event)
                    targets.append((car, new))
            run = solve_ivp(slope, (time, end), state, "DOP853", events=events, dense_output=True, max_step=0.25, **TOLERANCES)
            inside = (times >= time) & (times <= run.t[-1] + 1e-12)
            if inside.any():
                found[inside] = run.sol(np.minimum(times[inside], run.t[-1]))[:5].T
            time, state = run.t[-1], run.y[:, -1]
            for (car, new), hits in zip(targets, run.t_events):
                if len(hits):
                    modes[car] = new
                    switches += 1
    print(f"  {switches} changes of mode", file=sys.stderr)
    return found


def grid(first, second, rows):
    """A table whose rows belong to values of the second argument, linear inside and outside."""
    return RegularGridInterpolator((second, first), np.array(rows), bounds_error=False, fill_value=None)


SPEEDS, CHARGES = [1000, 1500, 2000, 2500, 3000], [0.1, 0.2, 0.3, 0.4]
VAPOR = grid(SPEEDS, CHARGES, [[0.8, 0.7, 0.7, 0.8, 0.9], [0.7, 0.66, 0.65, 0.73, 0.85], [0.66, 0.66, 0.63, 0.66, 0.8], [0.6, 0.6, 0.6, 0.6, 0.7]])
WALL = grid(SPEEDS, CHARGES, [[0.4, 0.3, 0.35, 0.3, 0.2], [0.22, 0.22, 0.4, 0.35, 0.5], [0.2, 0.22, 0.5, 0.4, 0.35], [0.35, 0.3, 0.45, 0.5, 0.4]])
DELAY = grid([800, 1000, 1500, 2000, 3000], [0.05, 0.15, 0.2, 0.25], [[0.8, 0.6, 0.4, 0.3, 0.2], [0.4, 0.3, 0.2, 0.2, 0.2], [0.3, 0.25, 0.2, 0.2, 0.2], [0.25, 0.2, 0.2, 0.2, 0.2]])


def fuel_control(pedal, rpm, ramp, times):
    """Returns mu, ratio, manifold pressure and fuel at times that are multiples of 10 ms."""
    duration, tick = 50.0, 0.01
    omega = rpm * np.pi / 30
    # At one engine speed a table is a function of the charge alone.
    vapor, wall, delay = (
        (lambda charge, xs=table.grid[0], ys=table([(x, rpm) for x in table.grid[0]]): linear(charge, xs, ys)) for table in (VAPOR, WALL, DELAY)
    )

    def pumped(p):
        return -0.366 + 0.08979 * omega * p - 0.0337 * omega * p**2 + 0.0001 * omega**2 * p

    def inflow(angle, p):
        area = 2.821 - 0.05231 * angle + 0.10299 * angle**2 - 0.00063 * angle**3
        ratio = min(p, 1 / p)
        return area * (2 * np.sqrt(max(ratio - ratio**2, 0.0)) if ratio >= 0.5 else 1.0) * np.sign(1 - p)

    def opening(theta):
        return min(max(theta + 8.8, 0.0), 90.0)

    theta, p, puddle, phase = 0.0, 0.982, 0.0112, 0.0
    exhaust, sensor = 14.7, 14.7
    command, reference, clock, started, power = 0.1726, 14.7, 0.0, False, False
    estimate, integral = 0.982, 0.0
    past = []  # (phase at the begin, at the end, begin, end, solution, fuel)
    rows = {round(time / tick): row for row, time in enumerate(times)}
    found = np.full((len(times), 4), np.nan)
    for step in range(round(duration / tick) + 1):
        now = step * tick
        if step:
            clock += tick
            started = started or clock >= 10
            power = opening(theta) >= (50 if power else 70)
            reference = 12.5 if started and power else 14.7
            air = pumped(estimate)
            estimate += tick * 0.41328 * (inflow(opening(theta), p) - air)
            trim = 1.0
            if started and not power:
                error = sensor - reference
                integral += tick * 0.14 * error
                trim = max(1 + 0.04 * error + integral, 0.0)
            command = min(max(air / reference * trim, 0.13), 1.66)
        if step in rows:
            found[rows[step]] = [sensor / reference - 1 if step >= 100 else 0.0, sensor, p, command]
        if step == round(duration / tick):
            return found
        piece = min(int(step * tick / 5 + 1e-9), len(pedal) - 1)

        def slope(time, state):
            theta, p, puddle, phase = state
            air = 0.9 * pumped(p)
            charge = air / omega * np.pi
            x, tau, lag = vapor(charge), wall(charge), delay(charge)
            return [
                10 * (value(pedal, duration, ramp, time, piece) - theta),
                0.41328 * (inflow(opening(theta), p) - air),
                (1 - x) * command - puddle / tau,
                1 / lag,
            ]

        run = solve_ivp(slope, (now, now + tick), [theta, p, puddle, phase], "Radau", dense_output=True, rtol=1e-9, atol=1e-11)
        begin = phase
        theta, p, puddle, phase = run.y[:, -1]
        past.append((begin, phase, now, now + tick, run.sol, command))

        def ratio(source, time):
            """The ratio of air to fuel that arrives at a time, made during a tick of the past."""
            first, last, begin, end, solution, fuel = source
            goal = run.sol(time)[3] - 1
            made = begin if goal <= first else end if goal >= last else brentq(lambda t: solution(t)[3] - goal, begin, end, xtol=1e-13)
            _, p, puddle, _ = solution(made)
            air = 0.9 * pumped(p)
            charge = air / omega * np.pi
            return air / (vapor(charge) * fuel + puddle / wall(charge))

        # The tick is divided where the begin of an earlier tick arrives.
        arrivals = [now]
        for source in past:
            if begin < source[0] + 1 < phase:
                arrivals.append(brentq(lambda t: run.sol(t)[3] - 1 - source[0], now, now + tick, xtol=1e-13))
        arrivals.append(now + tick)
        for start, end in zip(arrivals, arrivals[1:]):
            goal = run.sol(0.5 * (start + end))[3] - 1
            while past and past[0][1] <= goal:
                past.pop(0)
            source = past[0]
            arrives = (lambda time: ratio(source, time)) if goal >= 0 else (lambda time: 14.7)
            filters = lambda time, state: [10 * (arrives(time) - state[0]), 50 * (state[0] - state[1])]
            sub = solve_ivp(filters, (start, end), [exhaust, sensor], "RK45", rtol=1e-9, atol=1e-10)
            exhaust, sensor = sub.y[:, -1]
    return found


def steam_condenser(steam, ramp, times):
    """Returns measured pressure, temperature, water and heat at the times."""
    weights = {name: np.array(value) for name, value in json.loads(WEIGHTS.read_text(encoding="utf-8")).items()}
    table = np.array([50, 60, 70, 80, 90, 100, 110]), np.array([81.3167, 85.9258, 89.9315, 93.4854, 96.6870, 99.6059, 102.2923])
    latent = np.array([2305.42, 2293.64, 2283.30, 2274.05, 2265.65, 2257.92, 2250.76])
    edges = sorted({*breaks(20, 35.0, ramp), (2.0, 1)})

    def exchanged(p, temperature, water):
        boiling = np.interp(p, *table)
        mean = (temperature - 60) / np.log((boiling - 60) / (boiling - temperature))
        return mean / (0.0872924756541668 * water**-0.8 + 0.00073786772008033)

    state = np.array([90.0, 80.0, 107.8880952381, 90.0, *np.zeros(6)])
    found = np.full((len(times), 4), np.nan)
    for (begin, piece), (end, _) in zip(edges, [*edges[1:], (35.0, 20)]):

        def slope(time, state):
            p, temperature, water, measured = state[:4]
            scaled = (measured - (90 if begin < 2 else 87) + 4) / 5 - 1
            hidden = np.tanh(weights["inward"] * scaled + weights["recurrent"] @ state[4:] + weights["biases"])
            demand = 127.8880952381 + 50 * (weights["outward"] @ hidden + weights["output_bias"])
            heat = exchanged(p, temperature, water)
            return [
                0.461526 / 3 * np.interp(p, *table) * (value(steam, 35.0, ramp, time, piece) - heat / np.interp(p, table[0], latent)),
                (water * (60 - temperature) + heat / 4.2) / 500,
                min(max(demand, 0.0), 200.0) - water,
                2 * (p - measured),
                *(hidden - 10 * state[4:7]),
                *(state[4:7] - 10 * state[7:]),
            ]

        run = solve_ivp(slope, (begin, end), state, "DOP853", dense_output=True, max_step=0.05, rtol=1e-10, atol=1e-10)
        inside = (times >= begin) & (times <= end)
        for row in np.flatnonzero(inside):
            p, temperature, water, measured = run.sol(times[row])[:4]
            found[row] = [measured, temperature, water, exchanged(p, temperature, water)]
        state = run.y[:, -1]
    return found


def linear(x, xs, ys):
    """Linear interpolation, continued beyond the points."""
    place = min(max(int(np.searchsorted(xs, x)) - 1, 0), len(xs) - 2)
    return ys[place] + (x - xs[place]) / (xs[place + 1] - xs[place]) * (ys[place + 1] - ys[place])


def lines(case, inputs, times, traces):
    yield ",".join(["input", str(case), *(repr(float(x)) for x in inputs)])
    for time, row in zip(times, traces):
        yield ",".join(["sample", str(case), repr(float(time)), *(f"{x:.10g}" for x in row)])


def cases(model):
    """Yields the inputs of each case, drawn with seed 46, and its trace: constrained inputs, then inputs with ramps."""
    random = np.random.default_rng(46)
    ramps = [0.0, 0.0, 0.0, 0.0, 0.5, 1.0]
    for case, ramp in enumerate(ramps):
        print(f"{model} {case}", file=sys.stderr)
        if model == "chasing_cars":
            times = np.arange(0, 101.0, 1.0)
            # Corners are what searches try most.
            throttle, brake = random.integers(0, 2, (2, 20)).astype(float) if case == 1 else random.uniform(0, 1, (2, 20))
            yield case, [*throttle, *brake, ramp], times, chasing_cars(throttle, brake, ramp, times)
        elif model == "steam_condenser":
            times = np.arange(0, 35.5, 0.5)
            steam, ramp = random.uniform(3.99, 4.01, 20), 0.8 * ramp  # ramps of whole steps
            yield case, [*steam, ramp], times, steam_condenser(steam, ramp, times)
        else:
            times = np.arange(0, 50.25, 0.25)
            # Cases 2 and 3 are in power mode.
            low, high = (61.2, 81.2) if case in (2, 3) else (0.0, 61.2)
            pedal, rpm = random.uniform(low, high, 10), random.uniform(900, 1100)
            yield case, [*pedal, rpm, ramp], times, fuel_control(pedal, rpm, ramp, times)


def main():
    for model in sys.argv[1:]:
        text = "".join(line + "\n" for case in cases(model) for line in lines(*case))
        DATA.mkdir(exist_ok=True)
        (DATA / f"{model}.csv").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
