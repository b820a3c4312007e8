"""Systems that are functions from a scenario to a trace."""

import inspect
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from mishandle.base.fingerprints import walk
from mishandle.base.limits import check_interruptible, check_time_limit, limited
from mishandle.base.traces import columns_of
from mishandle.errors import InvalidScenario, InvalidTypeError, InvalidValueError, TimeLimitExceeded
from mishandle.scenarios.requests import Request, Scenario
from mishandle.systems.interface import Frames, Outcome, System


class FunctionSystem(System):
    """A function from a scenario to a trace."""

    def __init__(
        self, function: Callable[..., Any], *, nominal: Scenario, control_dt: float | None,
        steps: int | None, units: Mapping[str, str], time_limit: float | None,
        frame: Frames | None = None
    ) -> None:
        if frame is not None and not callable(frame):
            raise InvalidTypeError(
                f"frame is a {type(frame).__name__}; expected a function frame(scenario, trace, "
                "samples)"
            )
        self._frame = frame
        self.has_pictures = frame is not None
        self._function = function
        self._takes_seed = _takes_seed(function)
        self.depends_on_seed = self._takes_seed
        self._time_limit = time_limit
        name = getattr(function, "__name__", type(function).__name__)
        # A name without characters that shells interpret, because it becomes part of a file name.
        self.name = "lambda" if name == "<lambda>" else name
        self.control_dt = 1.0 if control_dt is None else control_dt
        self.knows_control_dt = control_dt is not None
        self.exceptions = []
        self.versions = [("numpy", np.__version__)]
        self._has_cut = self._has_process = False
        check_time_limit(time_limit)
        check_interruptible(time_limit)
        # An exception in the undisturbed scenario is the user's, so it is not caught.
        try:
            with limited(time_limit):
                trace = self._call(nominal, 0)
        except TimeLimitExceeded:
            raise InvalidValueError(
                f"the nominal scenario takes longer than the time limit of {time_limit} s"
            ) from None
        first = columns_of(trace)
        samples = len(next(iter(first.values()), []))
        if samples < 2:
            raise InvalidValueError(
                f"the trace of the nominal scenario has {samples} samples; expected at least 2"
            )
        self.steps = samples - 1 if steps is None else steps
        self.signals = [(name, units.get(name, "")) for name in first]

    def _call(self, scenario: Scenario, seed: int) -> Any:
        return self._function(scenario, seed=seed) if self._takes_seed else self._function(scenario)

    def simulate(self, batch: Sequence[Request]) -> list[Outcome]:
        check_interruptible(self._time_limit)
        return [self._one(request.scenario, request.seed) for request in batch]

    def _one(self, scenario: Scenario, seed: int) -> Outcome:
        nothing = np.zeros((0, len(self.signals)))
        try:
            with limited(self._time_limit):
                trace = self._call(scenario, seed)
        except InvalidScenario as error:
            return Outcome("invalid scenario", nothing, 0, reason=str(error))
        except TimeLimitExceeded:
            self._warn_of_processes()
            return Outcome("timed out", nothing, 0)
        except Exception:
            return Outcome("crashed", nothing, 0, reason=self.keep_exception())
        if self.recording is not None and self._frame is not None:
            frame = self._frame
            self.recording.add_all(lambda samples: frame(scenario, trace, samples))
        columns = columns_of(trace)
        missing = [name for name, _ in self.signals if name not in columns]
        if missing:
            raise InvalidValueError(f"the trace of scenario {scenario} lacks the signals {missing}")
        samples = np.column_stack([columns[name] for name, _ in self.signals])
        if len(samples) > self.steps + 1:
            self._warn_of_cut(scenario, len(samples))
            samples = samples[: self.steps + 1]
        if len(samples) == 0:
            self.exceptions += [f"the trace of scenario {scenario} has no samples"][
                : 10 - len(self.exceptions)
            ]
            return Outcome("crashed", nothing, 0, reason="the trace has no samples")
        steps = len(samples) - 1
        if steps < self.steps:
            return Outcome("terminated", samples, steps, step=steps)
        return Outcome("completed", samples, steps)

    def _warn_of_processes(self) -> None:
        """Warns of processes that live on after a time-out: the next scenario can get their late
        answers."""
        if self._has_process:
            return
        for process in walk(self._function).processes:
            if process.poll() is None:
                self._has_process = True
                warnings.warn(
                    f"a simulation timed out, and the process {process.pid} that the function "
                    "talks to still runs: unless its answers say to which scenario they belong, "
                    "the next scenario gets the late one. Kill and restart the process when a "
                    "mishandle.errors.TimeLimitExceeded passes the function, or use "
                    "mishandle.Process",
                    stacklevel=2,
                )

    def _warn_of_cut(self, scenario: Scenario, samples: int) -> None:
        if not self._has_cut:
            warnings.warn(
                f"the trace of scenario {scenario} has {samples} samples, but an episode has "
                f"{self.steps} control steps: later samples are left out, here and in other long "
                "traces; if they matter, pass the number of control steps of the longest trace "
                "as `steps`",
                stacklevel=2,
            )
        self._has_cut = True

    def code(self) -> list[Any]:
        return [self._function]


def _takes_seed(function: Callable[..., Any]) -> bool:
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return False
    return any(parameter.name == "seed" for parameter in parameters)
