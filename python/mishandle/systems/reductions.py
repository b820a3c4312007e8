"""Signals that reduce several values of a control step to one number, such as contact forces
between two control steps."""

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Union

import numpy as np

from mishandle.errors import InvalidTypeError, InvalidValueError

_REDUCTIONS: Mapping[str, Callable[[Any], Any]] = {
    "max": np.max, "min": np.min, "mean": np.mean, "sum": np.sum
}

_STEPS = ("mj_step", "mj_step2")
"""Functions of MuJoCo that end a physics step."""


@dataclass(frozen=True)
class Reduced:
    """The largest, smallest or mean value, or the sum, of a source over a control step.

    A source from ``obs`` or ``info`` returns all values of the control step, as a list. Any other
    source is read after each physics step of MuJoCo (``mujoco.mj_step``) that the environment takes
    in the control step; after a reset it is read once.

    Parameters
    ----------
    over : str
        ``"max"``, ``"min"``, ``"mean"`` or ``"sum"``.
    source : str or callable
        Source of the values, as in ``signals``.

    Examples
    --------
    >>> Reduced("max", "info.forces").reduce([1.0, 3.0, 2.0])
    3.0
    """

    over: str
    source: Union[str, Callable[..., Any]]

    def __post_init__(self) -> None:
        if self.over not in _REDUCTIONS:
            raise InvalidValueError(
                f"over is {self.over!r}; it must be one of {', '.join(_REDUCTIONS)}"
            )
        if not (isinstance(self.source, str) or callable(self.source)) or self.source == "reward":
            raise InvalidTypeError(
                f"{self.source!r} does not have several values in a control step"
            )

    @property
    def reads_physics_steps(self) -> bool:
        """Whether the source is read after each physics step."""
        return not (
            isinstance(self.source, str)
            and self.source.partition(".")[0].partition("[")[0] in ("obs", "info")
        )

    def reduce(self, values: Any) -> float:
        """Returns the number for the values of a control step."""
        array = np.asarray(values, dtype=np.float64)
        if array.ndim == 0 or array.size == 0:
            raise ValueError(
                f"it returned {values!r}; expected a list of the values in the control step"
            )
        return float(_REDUCTIONS[self.over](array))


class PhysicsSteps:
    """Reads sources after each physics step that an environment takes in a control step."""

    def __init__(self) -> None:
        self._sources: list[Callable[[Any], Any]] = []
        # Of the running control step, for each source.
        self._values: list[list[Any]] | None = None

    def add(self, reduced: Reduced, read: Callable[[Any], Any]) -> Callable[[Any], float]:
        """Adds a source, and returns the function from the environment to its number."""
        place = len(self._sources)
        self._sources.append(read)

        def value(environment: Any) -> float:
            if self._values is None:
                return reduced.reduce([read(environment)])
            if not self._values[place]:
                raise ValueError(
                    "the environment called neither mujoco.mj_step nor mujoco.mj_step2 in the "
                    "control step; let it return the values of its "
                    'physics steps as a list in `info`, and reduce those: Reduced("max", '
                    '"info.forces")'
                )
            return reduced.reduce(self._values[place])

        return value

    @contextmanager
    def watched(self, environment: Any) -> Iterator[None]:
        """Reads the sources after each physics step of an environment while the block runs."""
        if not self._sources:
            yield
            return
        values: list[list[Any]] = [[] for _ in self._sources]
        self._values = values
        mujoco = sys.modules.get("mujoco")
        # Other data are those of a planner, for instance.
        own = getattr(environment, "data", None)

        def watching(step: Callable[..., None]) -> Callable[..., None]:
            def watched(m: Any, d: Any, nstep: int = 1) -> None:
                for _ in range(nstep):
                    step(m, d)
                    if d is own or type(d) is not type(own):
                        for found, read in zip(values, self._sources):
                            found.append(read(environment))

            return watched

        before = {} if mujoco is None else {name: getattr(mujoco, name) for name in _STEPS}
        try:
            for name, step in before.items():
                setattr(mujoco, name, watching(step))
            yield
        finally:
            self._values = None
            for name, step in before.items():
                setattr(mujoco, name, step)
