"""Policies of other libraries as functions of a batch of observations."""

from __future__ import annotations

import functools
import hashlib
import inspect
import pathlib
from collections.abc import Callable, Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mishandle.controllers import Controller
from mishandle.errors import InvalidTypeError, InvalidValueError
from mishandle.onnx_files import model_files
from mishandle.onnx_policies import OnnxPolicy


class Policy(Protocol):
    """A policy for a batch of environments."""

    def reset(self, rows: int) -> None:
        """Starts episodes in all rows."""

    def act(self, observations: Any, rows: int) -> Any:
        """Returns one action per row."""


def as_policy(policy: Any, batched: bool = False, *, spaces: tuple[Any, Any] | None = None, task: str | None = None) -> Policy:
    """Returns the adapter of a policy.

    Parameters
    ----------
    policy
        A function of one observation (of a batch, if ``batched``); a model with ``predict``, such as those of
        Stable-Baselines3, with its ``VecNormalize`` if it has one; an agent of skrl 2; a PyTorch module from observations to
        actions; a path of an ONNX file; a :class:`~mishandle.Controller`. The method or attribute ``reset`` of a function or
        module, if it is callable, is called at the start of an episode.
    batched : bool
        Whether a function takes a batch of observations, with one row per environment.
    spaces : tuple, optional
        The spaces of observations and actions of one environment, which an ONNX file must fit.
    task : str, optional
        The name of the task, if the environment is one.
    """
    if isinstance(policy, Controller):
        return _Function(policy, batched=True)
    if isinstance(policy, (str, pathlib.Path)):
        if spaces is None:
            raise InvalidValueError("an ONNX file needs the spaces of observations and actions")
        return OnnxPolicy(pathlib.Path(policy), *spaces, task)
    if hasattr(policy, "predict"):
        return _Predicting(policy)
    if _is_skrl(policy):
        return _Skrl(policy)
    if _is_torch(policy):
        return _Torch(policy)
    if callable(policy):
        return _Function(policy, batched)
    raise InvalidTypeError(
        f"a {type(policy).__name__} is not a policy: expected a function, a model with `predict`, a PyTorch module, an "
        "agent of skrl or the path of an .onnx file"
    )


def source_text(code: Any) -> str:
    """Returns the source of a function or of the class of an object, or the bytecode if Python cannot find the source.

    The arguments of a ``functools.partial`` and the numbers, texts and functions in the closure of a function are part of it.
    Attributes of an object are not, because they can be its state.
    """
    if isinstance(code, functools.partial):
        keywords = sorted(code.keywords.items())
        values = [*code.args, *(value for _, value in keywords)]
        names = [name for name, _ in keywords]
        return "\n".join([source_text(code.func), repr(names), *(_value_text(value) for value in values)])
    cells = getattr(code, "__closure__", None) or ()
    return "\n".join([_own_source(code), *(_value_text(_contents(cell)) for cell in cells)])


class BytecodeOnly:
    """While it is entered, :func:`source_text` returns bytecode, which is the same where the source is not at hand."""

    depth = 0

    def __enter__(self) -> None:
        BytecodeOnly.depth += 1

    def __exit__(self, *exception: Any) -> None:
        BytecodeOnly.depth -= 1


def _own_source(code: Any) -> str:
    kind = code if isinstance(code, type) or hasattr(code, "__code__") else type(code)
    if BytecodeOnly.depth == 0:
        try:
            # Of the code, because `inspect` would return the source of the function that a
            # decorator wraps.
            return inspect.getsource(getattr(kind, "__code__", kind))
        except (OSError, TypeError):
            pass
    name = f"{kind.__module__}.{kind.__qualname__}"
    members = [value for _, value in sorted(vars(kind).items())] if isinstance(kind, type) else [kind]
    return "\n".join([name, *(_bytecode(each.__code__) for each in members if hasattr(each, "__code__"))])


def _bytecode(code: Any) -> str:
    constants = [_bytecode(each) if hasattr(each, "co_code") else _value_text(each) for each in code.co_consts]
    return "\n".join([code.co_code.hex(), repr(code.co_names), *constants])


def _contents(cell: Any) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # not assigned yet
        return None


def _value_text(value: Any) -> str:
    """Returns a text of a plain value or a function; empty for other objects, whose texts can contain addresses."""
    if isinstance(value, (tuple, list)):
        return repr([_value_text(each) for each in value])
    if isinstance(value, (set, frozenset)):
        return repr(sorted(_value_text(each) for each in value))
    if isinstance(value, (int, float, complex, str, bytes, type(None), type(...))):
        return repr(value)
    return _own_source(value) if hasattr(value, "__code__") else ""


def policy_hash(policy: Any) -> str:
    """Returns a SHA-256 hash that changes with the weights of a policy, or with the source of a function.

    The hash of a function or an object covers the weights of the models that it refers to: as attributes, closure variables or
    global variables. It does not cover numbers and arrays, because they can be the state of a controller.
    """
    if isinstance(policy, Controller):
        return policy.hash
    if isinstance(policy, (str, pathlib.Path)):
        digest = hashlib.sha256()
        for file in model_files(pathlib.Path(policy)):
            digest.update(file.read_bytes())
        return digest.hexdigest()
    digest = hashlib.sha256(source_text(policy).encode())
    for value in [policy, *_referred(policy)]:
        for name, array in _weights(value):
            digest.update(name.encode())
            digest.update(array.tobytes())
    return digest.hexdigest()


def _referred(policy: Any) -> list[Any]:
    """Returns the values that a function or an object refers to directly, in a fixed order."""
    while isinstance(policy, functools.partial):
        policy = policy.func
    owner = getattr(policy, "__self__", None)
    found = [] if owner is None else [owner]
    for value in (policy, owner):
        attributes = getattr(value, "__dict__", {})
        found += [attributes[name] for name in sorted(attributes)]
    try:
        variables = inspect.getclosurevars(policy)
    except TypeError:
        return found
    for names in (variables.nonlocals, variables.globals):
        found += [names[name] for name in sorted(names)]
    return found


def _weights(value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yields the named weights of a PyTorch module, and of a model of Stable-Baselines3 or skrl."""
    if isinstance(value, type):
        return
    # Both libraries keep the module in the attribute `policy`; skrl keeps the normalizer of
    # observations beside it.
    modules: list[Any] = [value, getattr(value, "policy", None), getattr(value, "_observation_preprocessor", None)]
    for module in modules:
        if _is_torch(module):
            for name, tensor in sorted(module.state_dict().items()):
                yield name, tensor.detach().cpu().numpy()
    normalizer = _vec_normalize(value)
    if normalizer is not None and normalizer.norm_obs:
        moments = normalizer.obs_rms if isinstance(normalizer.obs_rms, dict) else {"": normalizer.obs_rms}
        for name in sorted(moments):
            yield f"{name}.mean", moments[name].mean
            yield f"{name}.var", moments[name].var


def _vec_normalize(model: Any) -> Any:
    """Returns the normalizer (`VecNormalize`) of the environment of a Stable-Baselines3 model; `None` if it has none."""
    find = getattr(model, "get_vec_normalize_env", None)
    return find() if callable(find) else None


def _is_torch(policy: Any) -> bool:
    return any(base.__module__.startswith("torch.") and base.__name__ == "Module" for base in type(policy).__mro__)


def _is_skrl(policy: Any) -> bool:
    return any(base.__module__.startswith("skrl.agents.") for base in type(policy).__mro__)


def _reset(policy: Any) -> None:
    reset = getattr(policy, "reset", None)
    if callable(reset):
        reset()


def _stack(observations: Any) -> Any:
    """Returns a batch of observations; of dictionaries, a dictionary of batches."""
    if isinstance(observations[0], dict):
        return {key: np.stack([row[key] for row in observations]) for key in observations[0]}
    return np.stack(observations)


class _Function:
    def __init__(self, function: Callable[[Any], Any], batched: bool) -> None:
        self._function = function
        self._batched = batched

    def reset(self, rows: int) -> None:
        _reset(self._function)

    def act(self, observations: Any, rows: int) -> Any:
        if self._batched:
            return self._function(_stack(observations))
        return [self._function(observation) for observation in observations]


class _Predicting:
    """Stable-Baselines3 and its recurrent policies."""

    def __init__(self, model: Any) -> None:
        self._model = model
        # A policy that was trained with `VecNormalize` expects normalized observations.
        self._normalizer = _vec_normalize(model)
        self._states: Any = None
        self._starts = np.ones(1, dtype=bool)

    def reset(self, rows: int) -> None:
        self._states = None
        self._starts = np.ones(rows, dtype=bool)

    def act(self, observations: Any, rows: int) -> Any:
        batch = _stack(observations)
        if self._normalizer is not None:
            batch = self._normalizer.normalize_obs(batch)
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
            return self._module(_tensors(_stack(observations), self._module)).cpu().numpy()


class _Skrl:
    """An agent of skrl 2: the mean action of its policy, without exploration noise."""

    def __init__(self, agent: Any) -> None:
        self._agent = agent

    def reset(self, rows: int) -> None:
        pass

    def act(self, observations: Any, rows: int) -> Any:
        import torch

        policy = self._agent.policy
        with torch.no_grad():
            batch = self._agent._observation_preprocessor(_tensors(_stack(observations), policy))
            actions, outputs = policy.act({"observations": batch, "states": None}, role="policy")
            if "net_output" in outputs:
                actions = outputs["net_output"].argmax(dim=1)
            return outputs.get("mean_actions", actions).cpu().numpy()


def _tensors(batch: Any, module: Any) -> Any:
    """Returns a batch as tensors with the type and the device of the first parameter of a module."""
    import torch

    if isinstance(batch, dict):
        return {key: _tensors(value, module) for key, value in batch.items()}
    parameter = next(iter(module.parameters()), torch.zeros(1))
    return torch.as_tensor(batch, dtype=parameter.dtype, device=parameter.device)
