"""The cameras of a task on a GPU: images of thousands of states under random light, colors, cameras
and sensors, for policies that see.

    cameras = Cameras("cube-stacking", size=(64, 64))
    images = wp.to_torch(cameras.render(states, [{"lamp_x": 0.5}] * len(states)))

The images are those of ``mishandle record``. They stay on the device.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Union

import numpy as np

import mishandle._native as _native
from mishandle.errors import InvalidValueError
from mishandle.gpu.batches import CPU_LOCK, find_device
from mishandle.gpu.cameras.renderer import Poses, Renderer, Sights, wp

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from mishandle.scenarios.axes import Value

CAMERAS = ("over", "wrist")
"""The cameras of all tasks."""

SPACE = "camera-3+light-3+background-3+object-3+distractors-3+occlusion-3+image-3"
"""All factors of sight with a moderate severity. Faults of cameras move images in time and change
none."""

Scenarios = Union[Sequence[Mapping[str, "Value"]], "NDArray[np.float64]"]


class Cameras:
    """The cameras of a task.

    Arguments: the name of the task, the width and height of images in pixels, the names of the
    cameras, the spaces of the axes that scenarios may set, joined by ``+``, the device of Warp (by
    default the GPU), and the number of threads that read states on the CPU.
    """

    def __init__(
        self, task: str, size: tuple[int, int] = (64, 64), names: Sequence[str] = CAMERAS,
        space: str = SPACE, device: str | None = None, threads: int | None = None
    ) -> None:
        self._native = _native.Sights(
            task, cameras=list(names), size=list(size), space=space, threads=threads
        )
        self.size, self.names = size, tuple(names)
        numbers = [CAMERAS.index(name) for name in names]
        cloths, tables = self._native.cloths(), self._native.compression_tables()
        self.renderer = Renderer(find_device(device), size, numbers, cloths, tables)

    @property
    def document(self) -> str:
        """The MJCF document whose states are rendered."""
        return self._native.document

    @property
    def axes(self) -> list[str]:
        """The names of the axes of scenarios, in the order of the columns of :meth:`draw`."""
        return self._native.axes

    def draw(self, seed: int, count: int, first: int = 0) -> NDArray[np.float64]:
        """Returns random scenarios from number ``first`` on, a row each."""
        return self._native.draw(seed, first, count)

    def poses(self, states: ArrayLike | Poses) -> Poses:
        """Copies the poses of states to the device. States are rows of MuJoCo's state vectors
        (``mjSTATE_INTEGRATION``), as an environment of the task has them."""
        if isinstance(states, Poses):
            return states
        return self.renderer.poses(*self._native.poses(_rows(states)))

    def poses_of_worlds(self, data: Any) -> Poses:
        """Returns the poses of worlds of MuJoCo Warp, whose data has ``xpos`` and ``xquat``,
        without a copy to the host."""
        return self.renderer.poses_of_worlds(data.xpos, data.xquat)

    def sights(self, scenarios: Scenarios, starts: ArrayLike) -> Sights:
        """Copies what the cameras see in scenarios to the device. Scenarios are dictionaries of
        axes, which are nominal otherwise, or rows of :meth:`draw`. ``starts`` are the states in
        which their simulations start: distractors stand on what is there."""
        values, starts = self._values(scenarios), _rows(starts)
        if len(values) != len(starts):
            raise InvalidValueError(
                f"{len(values)} scenarios need as many starts, found {len(starts)}"
            )
        names = ("shapes", "lamps", "sky", "cameras")
        return self.renderer.sights(dict(zip(names, self._native.rows(values, starts))))

    def render(
        self, states: ArrayLike | Poses, scenarios: Scenarios | Sights, *,
        rows: ArrayLike | None = None, seeds: ArrayLike | None = None,
        steps: ArrayLike | None = None, before: ArrayLike | Poses | None = None
    ) -> Any:
        """Renders each camera of each state: a Warp array of bytes of the shape (states * cameras,
        height, width, 3) on the device, the cameras of a state one after the other.

        ``rows`` are the scenarios of the states, by default one each. Scenarios that are not
        :class:`Sights` start in the first of their states. ``seeds`` are those of the simulations,
        by default 0, and ``steps`` the control steps of the states, by default their numbers: both
        choose the noise. ``before`` are the states one control step before, which the
        corruption ``motion-blur`` needs.
        """
        poses, count = self.poses(states), len(scenarios)
        if len(poses) == 0 or count == 0:
            raise InvalidValueError("expected at least one state and one scenario")
        rows = np.arange(len(poses)) if rows is None else np.asarray(rows)
        if rows.shape != (len(poses),) or rows.min() < 0 or rows.max() >= count:
            raise InvalidValueError(
                f"rows must be one of {count} scenarios for each of {len(poses)} states"
            )
        if isinstance(scenarios, Sights):
            sights = scenarios
        elif isinstance(states, Poses):
            raise InvalidValueError(
                "scenarios of poses need the states in which they start: pass those of "
                "Cameras.sights"
            )
        else:
            first = [int(np.argmax(rows == row)) for row in range(count)]
            sights = self.sights(scenarios, _rows(states)[first])
        if sights.needs_before and before is None:
            raise InvalidValueError(
                "the corruption `motion-blur` needs the states before: pass before=..."
            )
        earlier = None if before is None else self.poses(before)
        if earlier is not None and len(earlier) != len(poses):
            raise InvalidValueError(
                f"{len(poses)} states need as many states before, found {len(earlier)}"
            )
        seeds = self._numbers("seeds", np.zeros(len(poses)) if seeds is None else seeds, len(poses))
        steps = self._numbers(
            "steps", np.arange(len(poses)) if steps is None else steps, len(poses)
        )
        of_state = wp.array(rows.astype(np.int32), dtype=int, device=self.renderer.device)
        with contextlib.nullcontext() if self.renderer.device.is_cuda else CPU_LOCK:
            return self.renderer.render(poses, sights, of_state, seeds, steps, earlier)

    def _numbers(self, name: str, given: ArrayLike, count: int) -> Any:
        numbers = np.asarray(given, np.uint64)
        if numbers.shape != (count,):
            raise InvalidValueError(f"{name} must be one number for each of {count} states")
        return wp.array(numbers, dtype=wp.uint64, device=self.renderer.device)

    def _values(self, scenarios: Scenarios) -> NDArray[np.float64]:
        if isinstance(scenarios, np.ndarray):
            return _rows(scenarios)
        return self._native.values([dict(scenario) for scenario in scenarios])


def _rows(array: ArrayLike) -> NDArray[np.float64]:
    return np.ascontiguousarray(np.atleast_2d(np.asarray(array, np.float64)))
