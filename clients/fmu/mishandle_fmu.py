"""Serves a co-simulation FMU (FMI 2 or 3) to Mishandle by fmpy: docs/guide/simulator_clients.md.

python mishandle_fmu.py tank.fmu --stop 30 --step 0.1 --axis start_level=0.1:0.9 --signal level \
    --formula 'no_overflow=always(level <= 1)'

Without --signal, it lists the variables of the FMU. Needs `pip install fmpy`, and mishandle_simulator.py beside this
file or in ../python.
"""

import argparse
import contextlib
import pathlib
import re
import subprocess
import sys
import tempfile

import fmpy
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import fmi2Terminated
from fmpy.simulation import (
    apply_start_values,
    instantiate_fmu,
    settable_in_initialization_mode,
    settable_in_instantiated,
)

sys.path.append(str(pathlib.Path(__file__).resolve().parent.parent / "python"))
from mishandle_simulator import serve  # noqa: E402

DISCARD, FATAL = 2, 4
REALS = {"Real", "Float64"}
COUNTS = {"Integer", "Enumeration", *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64))}


class Model:
    """An FMU with one instance at a time."""

    def __init__(self, path, folder):
        self.description = fmpy.read_model_description(str(path), validate=False)
        if self.description.coSimulation is None or self.description.fmiVersion == "1.0":
            what = "co-simulation" if self.description.coSimulation else "model exchange alone"
            sys.exit(f"{path}: FMI {self.description.fmiVersion}, {what}; expected co-simulation of FMI 2 or 3")
        self.folder = fmpy.extract(str(path), folder)
        self.variables = {variable.name: variable for variable in self.description.modelVariables}
        experiment = self.description.defaultExperiment
        self.start_time = float(experiment.startTime or 0) if experiment else 0.0
        self.fmu = None

    def variable(self, name):
        if name not in self.variables:
            sys.exit(f"the FMU has no variable `{name}`; without --signal, this program lists all of them")
        variable = self.variables[name]
        if variable.type not in REALS | COUNTS | {"Boolean", "Float32"} or variable.dimensions:
            sys.exit(f"the variable `{name}` is of the type {variable.type}; expected a number")
        return variable

    def start(self, values):
        """Starts a simulation, with no memory of the one before."""
        self.end()
        if self.fmu is None:
            self.fmu = instantiate_fmu(self.folder, self.description, "CoSimulation")
        if self.description.fmiVersion == "2.0":
            self.fmu.setupExperiment(startTime=self.start_time)
        left = apply_start_values(self.fmu, self.description, values, settable_in_instantiated)
        if self.description.fmiVersion == "2.0":
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=self.start_time)
        left = apply_start_values(self.fmu, self.description, left, settable_in_initialization_mode)
        if left:
            raise ValueError(f"the FMU lets nobody set {', '.join(left)}")
        self.fmu.exitInitializationMode()
        self.steps = 0

    def end(self, has_failed=False):
        """Frees the instance. An FMU that allows only one per process is reset instead."""
        fmu, self.fmu = self.fmu, None
        if fmu is None:
            return
        if not has_failed:
            with contextlib.suppress(FMICallException):
                fmu.terminate()
        if self.description.coSimulation.canBeInstantiatedOnlyOncePerProcess:
            fmu.reset()
            self.fmu = fmu
        else:
            fmu.freeInstance()

    def get(self, variable):
        kind = variable.type
        if kind == "Enumeration":
            kind = "Integer" if self.description.fmiVersion == "2.0" else "Int64"
        return float(getattr(self.fmu, f"get{kind}")([variable.valueReference])[0])

    def set(self, variable, value):
        getattr(self.fmu, f"set{variable.type}")([variable.valueReference], [value])

    def step(self, dt):
        """Takes a control step. Returns whether the FMU ends the simulation."""
        time = self.start_time + self.steps * dt
        self.steps += 1
        try:
            facts = self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=dt)
        except FMICallException as error:
            # FMI 2 discards the step in which the simulation ends.
            if error.status == DISCARD and self.fmu.getBooleanStatus(fmi2Terminated):
                return True
            raise
        return self.description.fmiVersion != "2.0" and bool(facts[1])


def identifier(name):
    """Returns a name for formulas: `tank[1].level` becomes `tank_1_level`."""
    return re.sub(r"\W+", "_", name).strip("_")


def unit(variable):
    return variable.unit or (variable.declaredType and variable.declaredType.unit) or ""


def bound(variable, which):
    """Returns the bound of a variable or of its type, as text, or None."""
    stated = getattr(variable, which)
    return getattr(variable.declaredType, which, None) if stated is None else stated


def axis(model, text):
    """Returns the variable and the axis of `name`, `name=low:high` or `name=low:high:nominal`."""
    name, _, numbers = text.partition("=")
    variable = model.variable(name)
    if not (settable_in_instantiated(variable) or settable_in_initialization_mode(variable)):
        sys.exit(f"the variable `{name}` cannot be set: causality {variable.causality}, initial {variable.initial}")
    kind = "model" if variable.causality in ("parameter", "input") else "start"
    entry = {"name": identifier(name), "unit": unit(variable), "kind": kind}
    if variable.type == "Boolean":
        nominal = str(numbers or variable.start).lower() in ("true", "1")
        return variable, {**entry, "values": ["false", "true"], "nominal": "true" if nominal else "false"}
    stated = numbers.split(":") if numbers else [bound(variable, "min"), bound(variable, "max")]
    if len(stated) == 2:
        stated.append(variable.start)
    if len(stated) != 3 or None in stated:
        facts = f"min {bound(variable, 'min')}, max {bound(variable, 'max')}, start {variable.start}"
        sys.exit(f"--axis {text}: expected {name}=low:high:nominal; the FMU states {facts}")
    try:
        low, high, nominal = map(float, stated)
    except ValueError:
        sys.exit(f"--axis {text}: expected numbers, found {':'.join(map(str, stated))}")
    if not low <= nominal <= high or low == high:
        sys.exit(f"--axis {text}: {low}, {nominal} and {high} are not in order; expected {name}=low:high:nominal")
    if variable.type in COUNTS:
        entry["values"] = "integer"
    return variable, {**entry, "low": low, "high": high, "nominal": nominal}


def start_value(variable, value):
    """Returns the value of an axis as fmpy sets it."""
    if variable.type == "Boolean":
        return value == "true"
    return int(value) if variable.type in COUNTS else float(value)


def pairs(texts, option):
    for text in texts:
        name, sign, value = text.partition("=")
        if not sign:
            sys.exit(f"{option} {text}: expected name=value")
        yield name, value


def parse():
    parser = argparse.ArgumentParser(description="Serves a co-simulation FMU to Mishandle.")
    parser.add_argument("fmu", type=pathlib.Path)
    parser.add_argument("--step", type=float, help="control step, s (default: that of the FMU's default experiment)")
    parser.add_argument("--stop", type=float, help="duration of an episode, s (default: as --step)")
    repeated = {
        "--axis": ("NAME[=LOW:HIGH[:NOMINAL]]", "a variable that scenarios set (default: min, max and start of the FMU)"),
        "--set": ("NAME=VALUE", "a start value in every scenario"),
        "--signal": ("NAME", "a variable that formulas may read"),
        "--formula": ("NAME=TEXT", "a requirement; the first is the default"),
        "--action": ("NAME", "an input that a policy sets in each control step"),
        "--observation": ("NAME", "a variable that the policy sees"),
    }
    for option, (shape, text) in repeated.items():
        parser.add_argument(option, action="append", default=[], metavar=shape, help=text)
    parser.add_argument("--action-limit", type=float, default=1.0, help="largest absolute value of an action (default: 1)")
    return parser.parse_args()


def list_variables(model):
    for variable in model.variables.values():
        stated = {"start": variable.start, "min": bound(variable, "min"), "max": bound(variable, "max")}
        facts = [unit(variable), *(f"{key} {value}" for key, value in stated.items() if value is not None)]
        print(f"{variable.causality:<20} {variable.type:<11} {variable.name:<30} {' '.join(facts)}", file=sys.stderr)
    sys.exit("state at least one --signal")


def scratch_folder():
    """Makes a folder that is removed when this process ends, also if it is killed, as at a time limit."""
    folder = tempfile.mkdtemp(prefix="mishandle-fmu-")
    # The shell waits for the end of its input, outside the process group that Mishandle kills.
    remove = ["sh", "-c", 'cat; rm -rf -- "$1"', "sh", folder]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scratch_folder.owner = subprocess.Popen(remove, stdin=subprocess.PIPE, start_new_session=True, **quiet)
    return folder


def main():
    options = parse()
    if not options.fmu.is_file():
        sys.exit(f"{options.fmu} is no file")
    run(options, Model(options.fmu, scratch_folder()))


def run(options, model):
    if not options.signal:
        list_variables(model)
    experiment = model.description.defaultExperiment
    dt = options.step or float((experiment and experiment.stepSize) or 0)
    stop = options.stop or float((experiment and experiment.stopTime) or 0) - model.start_time
    if dt <= 0 or stop < dt or abs(stop / dt - round(stop / dt)) > 1e-6:
        sys.exit(f"the duration {stop} s is not a multiple of the control step {dt} s; state --step and --stop")
    steps = round(stop / dt)
    axes = [axis(model, text) for text in options.axis]
    try:
        fixed = {name: start_value(model.variable(name), value) for name, value in pairs(options.set, "--set")}
    except ValueError as error:
        sys.exit(f"--set: {error}")
    variables = lambda names: [model.variable(name) for name in names]
    signals, actions, seen = variables(options.signal), variables(options.action), variables(options.observation)
    for variable in actions:
        if variable.causality != "input" or variable.type not in REALS:
            facts = f"causality {variable.causality}, type {variable.type}"
            sys.exit(f"the action `{variable.name}`: {facts}; expected a real input")
    if bool(actions) != bool(seen):
        sys.exit("--action and --observation need each other")
    quantities = lambda listed: [{"name": identifier(each.name), "unit": unit(each)} for each in listed]
    hello = {
        "name": identifier(model.description.modelName),
        "version": model.description.version or "",
        "control_dt": dt,
        "steps": steps,
        "axes": [entry for _, entry in axes],
        "signals": quantities(signals),
        "formulas": [{"name": name, "text": text} for name, text in pairs(options.formula, "--formula")],
        "versions": {
            "fmpy": fmpy.__version__,
            "fmi": model.description.fmiVersion,
            "tool": model.description.generationTool or "",
        },
    }

    def guarded(function):
        """After an error, the instance may only be freed; after a fatal one, nothing of the FMU may be called."""

        def call(*arguments):
            try:
                return function(*arguments)
            except FMICallException as error:
                if error.status == FATAL:
                    sys.exit(str(error))
                model.end(has_failed=True)
                raise

        return call

    def state():
        answer = {"signals": [model.get(variable) for variable in signals]}
        return {**answer, "observation": [model.get(variable) for variable in seen]} if actions else answer

    def reset(scenario, seed):
        values = {variable.name: start_value(variable, scenario[entry["name"]]) for variable, entry in axes}
        model.start({**fixed, **values})
        return state()

    def step(action):
        for variable, value in zip(actions, action or []):
            model.set(variable, value)
        has_ended = model.step(dt)
        return {**state(), "end": "terminated"} if has_ended else state()

    def simulate(scenario, seed):
        answer = reset(scenario, seed)
        rows = [answer["signals"]]
        while "end" not in answer and len(rows) <= steps:
            answer = step(None)
            rows.append(answer["signals"])
        columns = dict(zip((entry["name"] for entry in hello["signals"]), map(list, zip(*rows))))
        return {"trace": columns, **({"end": answer["end"]} if "end" in answer else {})}

    if actions:
        limit = options.action_limit
        hello["policy"] = {"observation": quantities(seen), "action": quantities(actions), "action_limit": limit}
        serve(hello, reset=guarded(reset), step=guarded(step))
    else:
        serve(hello, guarded(simulate))
    model.end()


if __name__ == "__main__":
    main()
