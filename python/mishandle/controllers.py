"""Shipped controllers, and controllers in files."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mishandle import _native
from mishandle.errors import InvalidValueError


class Controller:
    """A learned policy. Calling it returns its mean actions.

    A policy that remembers earlier observations (a recurrent ONNX model, a controller with a history) needs ``reset()`` at the start
    of each episode. Others do without.

    Parameters
    ----------
    name : str or path
        A shipped controller such as ``"ball-catching/ppo"``, or the path of a ``.safetensors`` or ``.onnx`` file with observations and
        actions of any size.
    task : str, optional
        The task that an ONNX model must fit.

    Examples
    --------
    >>> controller = Controller("point-reaching/ppo")
    >>> import numpy as np
    >>> controller(np.zeros(controller.observation_size)).shape
    (9,)
    >>> controller(np.zeros((4, controller.observation_size))).shape
    (4, 9)
    """

    def __init__(self, name: str | os.PathLike[str], task: str | None = None) -> None:
        name = os.fspath(name)
        self._native = _native.Controller(name, task)
        self.name = name
        self._arguments = (os.path.abspath(name) if os.path.exists(name) else name, task)

    def __reduce__(self) -> tuple[type[Controller], tuple[str, str | None]]:
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
        """Returns an ONNX model of the controller, with its normalizer and the clipping of observations and actions.

        The input ``observation`` has the shape ``[N, observation_size]``. The output ``action`` is clipped to [-1, 1];
        ``unclipped_action`` is what calling the controller returns. A controller with a history has one more input, ``history``,
        and one more output, ``next_history``: zeros at the start of an episode, then what the last control step returned.

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
    def is_recurrent(self) -> bool:
        """Whether its actions depend on the observations since ``reset``."""
        return self._native.is_recurrent

    def reset(self) -> None:
        """Starts an episode in each row: forgets earlier observations."""
        self._native.reset()

    def act(self, observations: Any) -> NDArray[np.float32]:
        """Returns the action of one observation, or one action per row of a batch. All calls of an episode have the same number of
        rows if the policy is recurrent."""
        array = np.asarray(observations, dtype=np.float32)
        if array.ndim not in (1, 2):
            raise InvalidValueError(
                f"the observations have the shape {array.shape}; expected one observation of {self.observation_size} numbers, or one per "
                "row"
            )
        actions = self._native.act(np.atleast_2d(array))
        return actions[0] if array.ndim == 1 else actions

    __call__ = act


def load_controller(name: str | os.PathLike[str], task: str | None = None) -> Controller:
    """Loads a shipped controller such as ``"ball-catching/ppo"``, or a ``.safetensors`` or ``.onnx`` file with observations and actions
    of any size."""
    return Controller(name, task)
