"""Pictures of systems that draw themselves, for reports."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mishandle.errors import InvalidValueError

WIDTH, HEIGHT = 640, 480
"""Size of a picture on a page, in pixels."""


class Recording:
    """Pictures of some samples of one simulation, while it runs."""

    def __init__(self, samples: Sequence[int]) -> None:
        self.samples = list(samples)
        self._pictures: dict[int, bytes] = {}
        self._error: Exception | None = None

    def add(self, sample: int, draw: Callable[[], Any]) -> None:
        """Draws a sample if the recording has it."""
        if sample in self.samples and self._error is None:
            self._keep([sample], lambda: [draw()])

    def add_all(self, draw: Callable[[list[int]], Any]) -> None:
        """Draws all samples at once."""
        self._keep(self.samples, lambda: draw(list(self.samples)))

    def _keep(self, samples: Sequence[int], draw: Callable[[], Any]) -> None:
        # The simulation continues, so that an error of a picture is not one of the system.
        try:
            frames = list(draw())
            if len(frames) != len(samples):
                raise InvalidValueError(
                    f"there are {len(frames)} frames of {len(samples)} samples; expected one "
                    "frame for each"
                )
            self._pictures.update(zip(samples, map(picture, frames)))
        except Exception as error:
            self._error = error

    def pictures(self) -> list[bytes]:
        """Returns the pictures in the order of the samples. Raises the exception of a failed
        one."""
        if self._error is not None:
            raise self._error
        return [self._pictures[sample] for sample in self.samples if sample in self._pictures]


class Painter:
    """Draws the next simulation of a system with the attribute ``recording``, as the extension
    module asks for it."""

    def __init__(self, system: Any) -> None:
        self._system = system

    def begin(self, samples: Sequence[int]) -> None:
        """Asks for pictures of these samples of the next simulation."""
        self._system.recording = Recording(samples)

    def take(self) -> list[bytes]:
        """Returns the pictures."""
        recording, self._system.recording = self._system.recording, None
        found: list[bytes] = recording.pictures()
        return found


def picture(frame: Any) -> bytes:
    """Returns the pixels of a frame, made smaller if it is larger than a picture, in the middle of
    one.

    >>> pixels = np.frombuffer(picture(np.zeros((480, 480, 3), np.uint8)), np.uint8).reshape(
    ...     HEIGHT, WIDTH, 3
    ... )
    >>> pixels[240, 320].tolist(), pixels[240, 0].tolist()
    ([0, 0, 0], [255, 255, 255])
    """
    if frame is None:
        raise InvalidValueError('there is no frame: an environment needs render_mode="rgb_array"')
    array = np.asarray(frame)
    if array.dtype != np.uint8 or array.ndim != 3 or array.shape[2] != 3 or array.size == 0:
        raise InvalidValueError(
            f"a frame has the shape {array.shape} and the type {array.dtype}; expected (height, "
            "width, 3) and uint8"
        )
    height, width = array.shape[:2]
    scale = max(height / HEIGHT, width / WIDTH, 1.0)
    small = _means(_means(array, max(round(height / scale), 1), 0), max(round(width / scale), 1), 1)
    canvas = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    top, left = (HEIGHT - small.shape[0]) // 2, (WIDTH - small.shape[1]) // 2
    canvas[top : top + small.shape[0], left : left + small.shape[1]] = small
    return canvas.tobytes()


def _means(array: NDArray[np.uint8], count: int, axis: int) -> NDArray[np.uint8]:
    """Returns the means of ``count`` neighboring parts of an axis."""
    size = array.shape[axis]
    if count == size:
        return array
    edges = np.arange(count) * size // count
    lengths = np.diff(np.append(edges, size)).reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))
    sums = np.add.reduceat(array, edges, axis=axis, dtype=np.uint32)
    means: NDArray[np.uint8] = ((sums + lengths // 2) // lengths).astype(np.uint8)
    return means
