"""Effects and faults of the images in observations, while an environment and its policy act."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces as gymnasium_spaces

import mishandle._native as _native
from mishandle.errors import InvalidValueError
from mishandle.scenarios.values import replaced, spaces_in

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


def images_of(space: Any) -> tuple[Image, ...]:
    """Returns the images in the observations of a space: arrays of bytes of the shape (height,
    width, 3).

    >>> camera = gymnasium_spaces.Box(0, 255, (48, 64, 3), np.uint8)
    >>> images_of(gymnasium_spaces.Dict({"speed": gymnasium_spaces.Box(0.0, 1.0), "front": camera}))
    (Image(path=('front',), width=64, height=48),)
    """
    return tuple(
        Image(path, width=part.shape[1], height=part.shape[0]) for path, part in spaces_in(space)
        if isinstance(part, gymnasium_spaces.Box) and part.dtype == np.uint8
        and part.shape[2:] == (_CHANNELS,) and 1 <= min(part.shape) and max(part.shape) <= _LARGEST
    )


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

    def __init__(self, active: "_native.ActiveImages", images: Sequence[Image]) -> None:
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
            observation = replaced(observation, image.path, lambda _: seen)
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
