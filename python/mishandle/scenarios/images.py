"""Effects and faults of the images in observations, while an environment and its policy act."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces as gymnasium_spaces

import mishandle._native as _native
from mishandle.errors import InvalidValueError

_LARGEST = 1024
"""The largest width and height of an image."""

_CHANNELS = 3
"""Red, green and blue."""


@dataclass(frozen=True)
class Image:
    """An image in an observation: its place, as names in dictionaries and places in tuples, and its
    size in pixels."""

    path: tuple[str | int, ...]
    width: int
    height: int

    @property
    def name(self) -> str:
        """Its name among the cameras."""
        return "_".join(str(each) for each in self.path) or "image"


def images_of(space: Any, path: tuple[str | int, ...] = ()) -> tuple[Image, ...]:
    """Returns the images in the observations of a space: arrays of bytes of the shape (height,
    width, 3).

    >>> camera = gymnasium_spaces.Box(0, 255, (48, 64, 3), np.uint8)
    >>> images_of(gymnasium_spaces.Dict({"speed": gymnasium_spaces.Box(0.0, 1.0), "front": camera}))
    (Image(path=('front',), width=64, height=48),)
    """
    if isinstance(space, gymnasium_spaces.Dict):
        return tuple(
            image for name, part in space.spaces.items() for image in images_of(part, (*path, name))
        )
    if isinstance(space, gymnasium_spaces.Tuple):
        return tuple(
            image for place, part in enumerate(space.spaces)
            for image in images_of(part, (*path, place))
        )
    if (
        not isinstance(space, gymnasium_spaces.Box) or space.dtype != np.uint8
        or len(space.shape) != _CHANNELS
    ):
        return ()
    height, width, channels = space.shape
    is_image = channels == _CHANNELS and 1 <= width <= _LARGEST and 1 <= height <= _LARGEST
    return (Image(path, width, height),) if is_image else ()


@dataclass(frozen=True)
class ImageSettings:
    """The images of an environment as cameras. It can be sent to other processes."""

    images: tuple[Image, ...]
    steps: int
    control_dt: float

    def native(self) -> _native.Images:
        """Makes the axes and effects of the extension module."""
        cameras = [(image.name, image.width, image.height) for image in self.images]
        return _native.Images(cameras, control_dt=self.control_dt, episode_steps=self.steps)


class SeenImages:
    """The images of one episode. Control steps count from 0."""

    def __init__(self, active: _native.ActiveImages, images: Sequence[Image]) -> None:
        self._active = active
        self._images = images

    def observe(self, step: int, observation: Any) -> Any:
        """Returns what the policy sees of an observation. Other parts than images are those of the
        observation."""
        taken = [
            np.array(_at(observation, image), dtype=np.uint8, order="C") for image in self._images
        ]
        self._active.observe(step, taken)
        for image, seen in zip(self._images, taken):
            observation = _replaced(image.path, observation, seen)
        return observation


def _at(observation: Any, image: Image) -> Any:
    """Returns an image of an observation."""
    value = observation
    for name in image.path:
        value = value[name]
    expected = (image.height, image.width, _CHANNELS)
    if np.shape(value) != expected:
        raise InvalidValueError(
            f"the image `{image.name}` has the shape {np.shape(value)}; its space has {expected}"
        )
    return value


def _replaced(path: Sequence[str | int], value: Any, image: Any) -> Any:
    if not path:
        return image
    made = _replaced(path[1:], value[path[0]], image)
    if isinstance(value, Mapping):
        return {**value, path[0]: made}
    return tuple(made if place == path[0] else each for place, each in enumerate(value))
