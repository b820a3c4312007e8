"""Policies of other libraries as functions of a batch of observations."""

from __future__ import annotations

import hashlib
import inspect
import pathlib
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from mishandle.controllers import Controller


class Policy(Protocol):
    """A policy for a batch of environments."""

    def reset(self, rows: int) -> None:
        """Starts episodes in all rows."""

    def act(self, observations: Any, rows: int) -> Any:
        """Returns one action per row."""


def as_policy(policy: Any, batched: bool = False) -> Policy:
    """Returns the adapter of a policy.

    Parameters
    ----------
    policy
        A function of one observation (of a batch, if ``batched``); a model with ``predict``, such as those of
        Stable-Baselines3; a PyTorch module; a path of an ONNX file; a :class:`~mishandle.Controller`. Its method or attribute ``reset``, if it is callable,
        is called at the start of an episode.
    batched : bool
        Whether a function takes a batch of observations, with one row per environment.
    """
    if isinstance(policy, Controller):
        return _Function(policy, batched=True)
    if isinstance(policy, (str, pathlib.Path)):
        return _Onnx(pathlib.Path(policy))
    if hasattr(policy, "predict"):
        return _Predicting(policy)
    if _is_torch(policy):
        return _Torch(policy)
    if callable(policy):
        return _Function(policy, batched)
    raise TypeError(
        f"a {type(policy).__name__} is not a policy: expected a function, a model with `predict`, a PyTorch module or the "
        "path of an .onnx file"
    )


def source_text(code: Any) -> str:
    """Returns the source of a function or of the class of an object; its qualified name if Python cannot find it."""
    for candidate in (code, type(code)):
        try:
            return inspect.getsource(candidate)
        except (OSError, TypeError):
            continue
    return f"{type(code).__module__}.{type(code).__qualname__}"


def policy_hash(policy: Any) -> str:
    """Returns a SHA-256 hash that changes with the weights of a policy, or with the source of a function."""
    if isinstance(policy, Controller):
        return policy.hash
    if isinstance(policy, (str, pathlib.Path)):
        return hashlib.sha256(pathlib.Path(policy).read_bytes()).hexdigest()
    digest = hashlib.sha256(source_text(policy).encode())
    # Stable-Baselines3 keeps the module in the attribute `policy`.
    modules: list[Any] = [policy, getattr(policy, "policy", None)]
    for module in modules:
        if _is_torch(module):
            for name, tensor in sorted(module.state_dict().items()):
                digest.update(name.encode())
                digest.update(tensor.detach().cpu().numpy().tobytes())
    return digest.hexdigest()


def _is_torch(policy: Any) -> bool:
    return any(base.__module__.startswith("torch.") and base.__name__ == "Module" for base in type(policy).__mro__)


def _reset(policy: Any) -> None:
    reset = getattr(policy, "reset", None)
    if callable(reset):
        reset()


class _Function:
    def __init__(self, function: Callable[[Any], Any], batched: bool) -> None:
        self._function = function
        self._batched = batched

    def reset(self, rows: int) -> None:
        _reset(self._function)

    def act(self, observations: Any, rows: int) -> Any:
        if self._batched:
            return self._function(np.stack(observations))
        return [self._function(observation) for observation in observations]


class _Predicting:
    """Stable-Baselines3 and its recurrent policies."""

    def __init__(self, model: Any) -> None:
        self._model = model
        self._states: Any = None
        self._starts = np.ones(1, dtype=bool)

    def reset(self, rows: int) -> None:
        self._states = None
        self._starts = np.ones(rows, dtype=bool)

    def act(self, observations: Any, rows: int) -> Any:
        batch: Any = (
            {key: np.stack([row[key] for row in observations]) for key in observations[0]}
            if isinstance(observations[0], dict)
            else np.stack(observations)
        )
        actions, self._states = self._model.predict(
            batch, state=self._states, episode_start=self._starts, deterministic=True
        )
        self._starts = np.zeros(rows, dtype=bool)
        return actions


class _Torch:
    """A PyTorch or TorchScript module from observations to actions."""

    def __init__(self, module: Any) -> None:
        self._module = module.eval()

    def reset(self, rows: int) -> None:
        _reset(self._module)

    def act(self, observations: Any, rows: int) -> Any:
        import torch  # type: ignore[import-not-found, import-untyped, unused-ignore]

        with torch.no_grad():
            batch = torch.as_tensor(np.stack(observations), dtype=torch.float32)
            return self._module(batch).numpy()


class _Onnx:
    """A model in an ONNX file, run by ONNX Runtime."""

    def __init__(self, path: pathlib.Path) -> None:
        if path.suffix != ".onnx":
            raise ValueError(f"{path} is not the path of an .onnx file; load the policy and pass it as an object")
        try:
            import onnxruntime  # type: ignore[import-not-found, import-untyped, unused-ignore]
        except ImportError as error:
            raise ImportError("ONNX policies need ONNX Runtime: pip install onnxruntime") from error
        options = onnxruntime.SessionOptions()
        # One thread gives the same sums on every machine.
        options.intra_op_num_threads = 1
        self._session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        self._input = self._session.get_inputs()[0].name

    def reset(self, rows: int) -> None:
        pass

    def act(self, observations: Any, rows: int) -> Any:
        batch = np.stack(observations).astype(np.float32)
        return self._session.run(None, {self._input: batch})[0]
