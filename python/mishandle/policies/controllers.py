"""Shipped controllers, and controllers in files."""

import os
from collections.abc import Mapping, Sequence
from typing import Any, Union

import numpy as np
from numpy.typing import NDArray

import mishandle._native as _native
from mishandle.errors import InvalidTypeError, InvalidValueError

Images = Union[Mapping[str, Any], Sequence[Any]]
"""Images by the name of their camera, or in the order of :attr:`Controller.images`."""


class Controller:
    """A learned policy. Calling it returns its mean actions.

    A policy that remembers earlier observations (a recurrent ONNX model, a controller with a
    history, a chunk of actions) needs ``reset()`` at the start of each episode. Others do without.

    Parameters
    ----------
    name : str or path
        A shipped controller such as ``"ball-catching/ppo"``, or the path of a ``.safetensors`` or
        ``.onnx`` file with observations and actions of any size.
    task : str or path, optional
        The task that an ONNX model must fit, or the path of a target file.

    Examples
    --------
    >>> controller = Controller("point-reaching/ppo")
    >>> import numpy as np
    >>> controller(np.zeros(controller.observation_size)).shape
    (9,)
    >>> controller(np.zeros((4, controller.observation_size))).shape
    (4, 9)
    """

    def __init__(
        self, name: str | os.PathLike[str], task: str | os.PathLike[str] | None = None
    ) -> None:
        name, task = os.fspath(name), None if task is None else os.fspath(task)
        self._native = _native.Controller(name, task)
        self.name = name
        self._arguments = (_absolute(name), None if task is None else _absolute(task))

    def __reduce__(self) -> "tuple[type[Controller], tuple[str, str | None]]":
        return Controller, self._arguments

    @property
    def task(self) -> str:
        """Name of its task; empty for an ONNX model without one."""
        return self._native.task

    @property
    def hash(self) -> str:
        """SHA-256 hash of its weights, in hexadecimal."""
        return self._native.hash

    @property
    def observation_size(self) -> int:
        """Length of an observation."""
        return self._native.observation_size

    @property
    def action_size(self) -> int:
        """Number of actions."""
        return self._native.action_size

    def to_onnx(self) -> bytes:
        """Returns an ONNX model of the controller, with its normalizer and the clipping of
        observations and actions.

        The input ``observation`` has the shape ``[N, observation_size]``. The output ``action`` is
        clipped to [-1, 1]; ``unclipped_action`` is what calling the controller returns. A
        controller with a history has one more input, ``history``, and one more output,
        ``next_history``: zeros at the start of an episode, then what the last control step
        returned.

        Returns
        -------
        bytes
            The content of an ``.onnx`` file.

        Examples
        --------
        >>> model = Controller("point-reaching/ppo").to_onnx()
        >>> b"unclipped_action" in model
        True
        """
        return self._native.onnx_bytes()

    @property
    def images(self) -> list[tuple[str, tuple[int, int, int]]]:
        """The images that a policy that sees gets: names of the cameras and shapes (height, width,
        3). Empty for others."""
        return [(camera, (height, width, 3)) for camera, width, height in self._native.images]

    @property
    def is_recurrent(self) -> bool:
        """Whether its actions depend on what it got since ``reset``."""
        return self._native.is_recurrent

    def reset(self) -> None:
        """Starts an episode in each row: forgets earlier observations."""
        self._native.reset()

    def act(self, observations: Any, images: Images | None = None) -> NDArray[np.float32]:
        """Returns the action of one observation, or one action per row of a batch. All calls of an
        episode have the same number of rows if the policy is recurrent.

        Parameters
        ----------
        observations
            One observation of ``observation_size`` numbers, or one per row: the whole observation
            of a task, also if the policy uses some parts of it. Or a dictionary with the
            observation, ``"state"``, and images by the name of their camera, as ``TaskEnv(task,
            cameras=[...])`` returns it.
        images
            What a policy that sees gets in this control step: bytes (``uint8``) of the shapes in
            :attr:`images`, rows from the top, with one more dimension in front for a batch. By the
            name of the camera, or in the order of :attr:`images`. A policy that plays a chunk of
            actions uses those of the calls in which its model runs. It gets them in every call, as
            the last ones may be a history.
        """
        if isinstance(observations, Mapping):
            if "state" not in observations:
                raise InvalidValueError(
                    f"the observation has the keys {', '.join(map(str, observations))}; expected "
                    "`state` and cameras"
                )
            images = observations if images is None else images
            observations = observations["state"]
        array = np.asarray(observations, dtype=np.float32)
        if array.ndim not in (1, 2):
            raise InvalidValueError(
                f"the observations have the shape {array.shape}; expected one observation of "
                f"{self.observation_size} numbers, or one per row"
            )
        rows = np.atleast_2d(array)
        actions = self._native.act(
            rows,
            [
                each.reshape(len(rows), *each.shape[-3:])
                for each in self._seen(images, array.shape[:-1])
            ]
        )
        return actions[0] if array.ndim == 1 else actions

    __call__ = act

    def _seen(self, images: Images | None, batch: tuple[int, ...]) -> list[NDArray[np.uint8]]:
        """Returns the images in the order of the policy. ``batch`` is the shape of the batch: a
        number of rows, or nothing."""
        expected = self.images
        images = {} if images is None else images
        if isinstance(images, Mapping):
            for camera, _ in expected:
                if camera not in images:
                    given = ", ".join(str(name) for name in images if name != "state") or "none"
                    raise InvalidValueError(
                        f"the controller needs an image of the camera `{camera}`; given: {given}"
                    )
            images = [images[camera] for camera, _ in expected]
        if len(images) != len(expected):
            cameras = ", ".join(camera for camera, _ in expected) or "no camera"
            raise InvalidValueError(
                f"the number of images is {len(images)}; the controller sees through {cameras}"
            )
        found = [np.asarray(image) for image in images]
        for (camera, shape), image in zip(expected, found):
            if image.dtype != np.uint8 or image.shape != (*batch, *shape):
                raise InvalidTypeError(
                    f"the image of the camera `{camera}` has the shape {image.shape} and the type "
                    f"{image.dtype}; expected {(*batch, *shape)} and uint8"
                )
        return found


def _absolute(name: str) -> str:
    """Returns the name of a file that another working folder has, too; other names as they are."""
    return os.path.abspath(name) if os.path.exists(name) else name


def load_controller(
    name: str | os.PathLike[str], task: str | os.PathLike[str] | None = None
) -> Controller:
    """Loads a shipped controller such as ``"ball-catching/ppo"``, or a ``.safetensors`` or
    ``.onnx`` file with observations and actions of any size. An ONNX model must fit ``task``, a
    task or a target file, if it is given."""
    return Controller(name, task)
