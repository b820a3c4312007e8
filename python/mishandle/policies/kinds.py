"""Policies of other libraries as functions of a batch of observations."""

import hashlib
import pathlib
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from mishandle.base.fingerprints import fingerprint, is_kind, vec_normalize, walk
from mishandle.errors import InvalidTypeError, InvalidValueError
from mishandle.policies.controllers import Controller
from mishandle.policies.onnx_files import model_files
from mishandle.policies.onnx_policies import OnnxPolicy
from mishandle.policies.servers import PolicyServer, Rows, ServedPolicy
from mishandle.scenarios.applications import PolicyArguments
from mishandle.scenarios.axes import Value


class Policy(Protocol):
    """A policy for a batch of environments."""

    def reset(self, rows: int) -> None:
        """Starts episodes in all rows."""

    def act(self, observations: Any, rows: int) -> Any:
        """Returns one action per row."""


def as_policy(
    policy: Any, batched: bool = False, *, spaces: tuple[Any, Any] | None = None,
    task: str | None = None, arguments: PolicyArguments | None = None, can_draw: bool = False
) -> Policy:
    """Returns the adapter of a policy.

    Parameters
    ----------
    policy
        A function of one observation (of a batch, if ``batched``); a model with ``predict``, such
        as those of Stable-Baselines3, with its ``VecNormalize`` if it has one; an agent of skrl 2;
        a policy of :func:`mishandle.lerobot.policy`; a PyTorch module from observations to actions;
        a path of an ONNX file; a :class:`~mishandle.Controller`; a
        :class:`~mishandle.PolicyServer`. The method or attribute ``reset`` of a function or module,
        if it is callable, is called at the start of an episode.
    batched : bool
        Whether a function takes a batch of observations, with one row per environment.
    spaces : tuple, optional
        The spaces of observations and actions of one environment, which an ONNX file must fit.
    task : str, optional
        The name of the task, if the environment is one.
    arguments : PolicyArguments, optional
        What axes pass to the policy, which must be a function or a server then; see :func:`start`.
    can_draw : bool
        Whether the system draws pictures for the policy.
    """
    if isinstance(policy, PolicyServer):
        if spaces is None:
            raise InvalidValueError("a policy server needs the spaces of observations and actions")
        return ServedPolicy(policy, spaces, arguments, can_draw)
    if arguments:
        is_adapted = (
            isinstance(policy, (str, pathlib.Path, Controller)) or hasattr(policy, "predict")
            or _is_skrl(policy) or _is_lerobot(policy)
        )
        if is_adapted or is_kind(type(policy), "torch", "Module") or not callable(policy):
            raise InvalidTypeError(
                f"an axis passes an argument to the policy, but a {type(policy).__name__} takes "
                "observations only; wrap it in a function with this argument"
            )
        arguments.check(policy)
        return _Function(policy, batched)
    if isinstance(policy, Controller):
        return _Function(policy, batched=True)
    if isinstance(policy, (str, pathlib.Path)):
        if spaces is None:
            raise InvalidValueError("an ONNX file needs the spaces of observations and actions")
        return OnnxPolicy(pathlib.Path(policy), *spaces, task)
    if _is_lerobot(policy):
        adapted: Policy = policy
        return adapted
    if hasattr(policy, "predict"):
        return _Predicting(policy)
    if _is_skrl(policy):
        return _Skrl(policy)
    if is_kind(type(policy), "torch", "Module"):
        return _Torch(policy)
    if callable(policy):
        return _Function(policy, batched)
    raise InvalidTypeError(
        f"a {type(policy).__name__} is not a policy: expected a function, a model with `predict`, "
        "a PyTorch module, an agent of skrl, the path of an .onnx file or the address of a policy "
        "server"
    )


def start(policy: Policy, arguments: PolicyArguments, rows: Rows) -> None:
    """Starts an episode in each row, with the arguments that the policy has in its scenario."""
    policy.reset(len(rows.scenarios))
    if arguments and isinstance(policy, _Function):
        policy.arguments = [arguments.of(scenario) for scenario in rows.scenarios]
    elif isinstance(policy, ServedPolicy):
        policy.begin(rows)


def policy_hash(policy: Any) -> str:
    """Returns a SHA-256 hash of what a policy is: its weights, or its code with the values that it
    reaches."""
    if isinstance(policy, Controller):
        return policy.hash
    if isinstance(policy, (str, pathlib.Path)):
        digest = hashlib.sha256()
        for file in model_files(pathlib.Path(policy)):
            digest.update(file.read_bytes())
        return digest.hexdigest()
    found = walk(policy)
    return fingerprint(found, found, {}).digest


def _is_skrl(policy: Any) -> bool:
    return any(base.__module__.startswith("skrl.agents.") for base in type(policy).__mro__)


def _is_lerobot(policy: Any) -> bool:
    return type(policy).__module__ == "mishandle.lerobot"


def reset_policy(policy: Any) -> None:
    """Starts an episode of a policy that has the method ``reset``."""
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
        # Of each row; empty without axes that pass arguments.
        self.arguments: list[dict[str, Value]] = []

    def reset(self, rows: int) -> None:
        reset_policy(self._function)

    def act(self, observations: Any, rows: int) -> Any:
        given = self.arguments or [{}] * len(observations)
        if self._batched:
            columns = {name: np.array([row[name] for row in given]) for name in given[0]}
            return self._function(_stack(observations), **columns)
        return [self._function(observation, **row) for observation, row in zip(observations, given)]


class _Predicting:
    """Stable-Baselines3 and its recurrent policies."""

    def __init__(self, model: Any) -> None:
        self._model = model
        # A policy that was trained with `VecNormalize` expects normalized observations.
        self._normalizer = vec_normalize(model)
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
        reset_policy(self._module)

    def act(self, observations: Any, rows: int) -> Any:
        import torch

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
    """Returns a batch as tensors with the type and the device of the first parameter of a
    module."""
    import torch

    if isinstance(batch, dict):
        return {key: _tensors(value, module) for key, value in batch.items()}
    parameter = next(iter(module.parameters()), torch.zeros(1))
    return torch.as_tensor(batch, dtype=parameter.dtype, device=parameter.device)
