"""What every system under test has in common."""

import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Union

import numpy as np
from numpy.typing import NDArray

import mishandle._native as _native
from mishandle.base.pictures import Recording
from mishandle.errors import TimeLimitExceeded
from mishandle.scenarios.lines import FaultLine
from mishandle.scenarios.requests import Request, Scenario
from mishandle.scenarios.scenes import Motion
from mishandle.systems.reductions import Reduced

Source = Union[str, Callable[..., float], Reduced]
"""Source of a signal: a path such as ``"obs[3]"``, ``"obs.achieved_goal[0]"``, ``"info.speed"``,
``"data.qpos[2]"`` or ``"reward"``, or a function of the unwrapped environment, or of it and the
observation. ``data`` and other names are attributes of the unwrapped environment; names after a
dictionary are its keys. :class:`mishandle.systems.Reduced` reduces several values of a control
step."""


Frames = Callable[[Scenario, Any, list[int]], Sequence[Any]]
"""Draws samples of a simulation: a function of the scenario, the trace and the samples that returns
one array (height, width, 3) of bytes for each sample."""


@dataclass
class Outcome:
    """One simulation.

    ``samples`` has one row per sample, beginning with the reset, and one column per signal.
    """

    end: str
    samples: NDArray[np.float64]
    steps: int
    step: int = 0
    index: int = 0
    total_reward: float = 0.0
    reason: str = ""
    """Why it ended so, if an exception says it."""

    def to_native(self) -> "_native.Outcome":
        """Returns the outcome as the extension module takes it."""
        return (
            self.end, self.step, self.index, self.samples, self.steps, self.total_reward,
            self.reason
        )


class System:
    """Base of all systems. It keeps the first exceptions, so that a run can report them."""

    name: str
    signals: list[tuple[str, str]]
    control_dt: float
    steps: int
    versions: list[tuple[str, str]]
    exceptions: list[str]
    depends_on_seed: bool = True
    knows_control_dt: bool = True
    """Whether ``control_dt`` was given or stated by the system."""
    has_pictures: bool = False
    """Whether it can draw its simulations."""
    recording: Recording | None = None
    """Pictures that the next simulation draws."""
    has_scene: bool = False
    """Whether it has bodies whose poses a 3-D replay shows."""
    motion: Motion | None = None
    """Poses that the next simulation notes."""

    @property
    def random_axes(self) -> list[str]:
        """Names of the axes that make an episode depend on its seed."""
        faults: FaultLine | None = getattr(self, "faults", None)
        return [] if faults is None else faults.random_axes

    def simulate(self, batch: Sequence[Request]) -> list[Outcome]:
        """Simulates requests."""
        raise NotImplementedError

    def code(self) -> list[Any]:
        """Returns the functions and objects whose code the workers of a cluster need."""
        raise NotImplementedError

    def keep_exception(self) -> str:
        """Keeps the exception that is handled now. Returns it without its traceback, which differs
        between machines."""
        if len(self.exceptions) < 10:
            self.exceptions.append(traceback.format_exc())
        return "".join(traceback.format_exception_only(*sys.exc_info()[:2])).strip()

    def keep_reason(self, error: TimeLimitExceeded) -> str:
        """Keeps and returns the exception of a time limit that is handled now, if it says more than
        that the time is over."""
        return self.keep_exception() if error.args else ""


class NativeSystem(System):
    """A task that the Rust core simulates together with its controller."""

    def __init__(self, signals: list[tuple[str, str]]) -> None:
        self.signals = signals
        self.exceptions = []
