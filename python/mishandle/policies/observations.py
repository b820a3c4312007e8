"""What a policy server gets in a request: observations, pictures, instructions, values of axes."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Union

import numpy as np
from numpy.typing import NDArray

from mishandle.base.packages import needed
from mishandle.errors import InvalidTypeError, InvalidValueError
from mishandle.scenarios.axes import Axis, Value, follower, parse_path

Source = Union[str, Callable[[Any], Any]]
"""Where a part of a request comes from: ``"obs"``, a path such as ``"obs.agent_pos"`` or
``"obs[3]"``, ``"render"`` (a picture of the environment), or a function of the observation."""


@dataclass(frozen=True)
class Resized:
    """A picture in another size, without distortion: scaled to fit, in the middle of black.

    It has the pixels of ``resize_with_pad`` of openpi. It needs Pillow.

    Parameters
    ----------
    source : str or callable
        ``"render"``, a path such as ``"obs.wrist"``, or a function of the observation: an array
        (height, width, 3) of bytes.
    height, width : int
        Size in pixels.
    """

    source: Source
    height: int
    width: int

    def __post_init__(self) -> None:
        if min(self.height, self.width) < 1:
            raise InvalidValueError(
                f"a picture of {self.height} x {self.width} pixels is not possible"
            )


Part = Union[Source, Resized, Axis, Mapping[str, Any]]
"""A part of a request: a source, a resized picture, an axis (its value in the scenario), or a
dictionary of parts."""


@dataclass(frozen=True)
class View:
    """What is known in one control step of one simulation."""

    observation: Any
    scenario: Mapping[str, Value]
    picture: Any


class Request:
    """Makes the requests of a policy server."""

    def __init__(self, parts: Mapping[str, Part]) -> None:
        self._parts = parts
        self._read = {key: _reader(part, key) for key, part in parts.items()}
        self.axes = [part for part in _leaves(parts) if isinstance(part, Axis)]
        self.has_pictures = any(_draws(part) for part in _leaves(parts))

    def of(self, view: View) -> dict[str, Any]:
        """Returns the request in a control step.

        >>> view = View(np.array([0.5, 2.0]), {"task": "lift"}, None)
        >>> Request({"speed": "obs[1]", "prompt": Axis("task", values=["lift", "push"])}).of(view)
        {'speed': np.float64(2.0), 'prompt': 'lift'}
        """
        return {key: read(view) for key, read in self._read.items()}


def _leaves(parts: Mapping[str, Any]) -> Iterator[Any]:
    for part in parts.values():
        if isinstance(part, Mapping):
            yield from _leaves(part)
        else:
            yield part


def _draws(part: Any) -> bool:
    return (part.source if isinstance(part, Resized) else part) == "render"


def _reader(part: Any, key: str) -> Callable[[View], Any]:
    if isinstance(part, Mapping):
        inner = {name: _reader(each, f"{key}.{name}") for name, each in part.items()}
        return lambda view: {name: read(view) for name, read in inner.items()}
    if isinstance(part, Axis):
        name = part.name
        return lambda view: view.scenario[name]
    if isinstance(part, Resized):
        read, height, width = _reader(part.source, key), part.height, part.width
        return lambda view: resize_with_pad(_picture(read(view), key), height, width)
    if part == "render":
        return lambda view: _picture(view.picture, key)
    if isinstance(part, str):
        segments = parse_path(part)
        if segments[0][0] != "obs":
            raise InvalidValueError(
                f"the part `{key}` of the request is {part!r}; expected 'obs', a path such as "
                "'obs.state' or 'obs[3]', 'render', a function of the observation or an axis; a "
                "text that is always the same is the `instruction`"
            )
        follow = follower((("observation", segments[0][1]), *segments[1:]))
        return lambda view: _found(follow, view, part, key)
    if callable(part):
        function: Callable[[Any], Any] = part
        return lambda view: function(view.observation)
    raise InvalidTypeError(
        f"the part `{key}` of the request is a {type(part).__name__}; expected a path, a function "
        "or an axis"
    )


def _found(follow: Callable[[Any], Any], view: View, path: str, key: str) -> Any:
    try:
        return follow(view)
    except (LookupError, AttributeError, TypeError) as error:
        raise InvalidValueError(
            f"the part `{key}` of the request is {path!r}, which the observation lacks: {error}"
        ) from error


def _picture(value: Any, key: str) -> NDArray[np.uint8]:
    array: NDArray[Any] = np.asarray(value)
    if array.dtype != np.uint8 or array.ndim != 3 or array.shape[2] != 3 or array.size == 0:
        raise InvalidValueError(
            f"the part `{key}` of the request has the shape {array.shape} and the type "
            f"{array.dtype}; expected a picture (height, width, 3) of uint8"
        )
    return array


def resize_with_pad(picture: NDArray[np.uint8], height: int, width: int) -> NDArray[np.uint8]:
    """Returns a picture in another size, without distortion, in the middle of black.

    >>> resize_with_pad(np.full((4, 8, 3), 9, np.uint8), 4, 4)[:, 0, 0].tolist()
    [0, 9, 9, 0]
    """
    if picture.shape[:2] == (height, width):
        return picture
    with needed("Resized pictures need Pillow: pip install pillow"):
        from PIL import Image
    ratio = max(picture.shape[0] / height, picture.shape[1] / width)
    # A picture of extreme proportions keeps a row of pixels.
    rows, columns = (max(int(size / ratio), 1) for size in picture.shape[:2])
    small = Image.fromarray(picture).resize((columns, rows), resample=Image.Resampling.BILINEAR)
    canvas = np.zeros((height, width, 3), np.uint8)
    top, left = (height - rows) // 2, (width - columns) // 2
    canvas[top : top + rows, left : left + columns] = np.asarray(small)
    return canvas
