"""Models in ONNX files as policies."""

import json
import math
import pathlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.spaces import Space
from numpy.typing import NDArray

from mishandle.base.packages import needed
from mishandle.errors import InvalidValueError
from mishandle.policies.onnx_files import contents

_GUIDE = "(docs/guide/onnx.md)"

_KEYS = ("task", "observation", "action", "state", "layout")

_NAMED_SPACE = (
    'name a task and one of its spaces, as in evaluate("cube-stacking", space="starts", '
    'policy="policy.onnx")'
)

_SEEING = ("images", "parts")
"""Keys of a policy that gets images of the cameras of a task, which the Rust core renders."""

_REMEMBERING = ("chunk", "history", "padding")
"""Keys of a policy whose memory the Rust core keeps."""

_UNREAD = ("algorithm", "controller_hash", "version")
"""Keys that describe where a model comes from."""

_TYPES: dict[str, Any] = {
    "tensor(float)": np.float32,
    "tensor(double)": np.float64,
    "tensor(float16)": np.float16,
    "tensor(bool)": np.bool_,
    **{
        f"tensor({name})": np.dtype(name).type
        for name in ("int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64")
    },
}

_LEAVES = (spaces.Box, spaces.Discrete, spaces.MultiBinary, spaces.MultiDiscrete)


@dataclass
class _Input:
    """An input of a model that is an observation or a part of it."""

    name: str
    key: str | None
    """The key of a dictionary of observations."""
    dtype: Any
    shape: tuple[int, ...]
    """The shape for one row, without the dimension of the batch."""
    batch: str
    """The dimension of the batch: ``rows``, ``one`` or ``none``."""
    example: NDArray[Any]

    def value(self, rows: Sequence[Any]) -> NDArray[Any]:
        """Returns the input for observations; for one of them, unless the model has batches."""
        parts = [
            np.asarray(row if self.key is None else row[self.key]).reshape(self.shape)
            for row in rows
        ]
        values = parts[0] if self.batch == "none" else np.stack(parts)
        return values.astype(self.dtype)


class OnnxPolicy:
    """A model in an ONNX file, run by ONNX Runtime.

    Its inputs are the observation, or one input for each key of a dictionary of observations, and
    the state of a recurrent policy. What does not fit the spaces of the environment is an error of
    the constructor.
    """

    def __init__(
        self, path: pathlib.Path, observation_space: Space[Any], action_space: Space[Any],
        task: str | None = None
    ) -> None:
        self._arguments = (path, observation_space, action_space, task)
        self._path = path
        self._action_space = action_space
        self._session = self._load()
        interface = self._interface()
        if task is not None and interface.get("task", task) != task:
            raise self._problem(f"is for the task {interface['task']}, not for {task}")
        self._states = self._find_states(interface.get("state", []))
        self._inputs = self._find_inputs(interface.get("observation"), observation_space)
        self._memory: list[dict[str, NDArray[Any]]] = []
        self._output = self._find_action(interface.get("action"))
        self._is_batched = not self._states and self._computes_rows(self._examples())

    def __reduce__(self) -> "tuple[type[OnnxPolicy], tuple[Any, ...]]":
        return OnnxPolicy, self._arguments

    def reset(self, rows: int) -> None:
        self._memory = [self._first_state() for _ in range(rows)]

    def act(self, observations: Any, rows: int) -> Any:
        if self._is_batched:
            feeds = {each.name: each.value(observations) for each in self._inputs}
            [actions] = self._session.run([self._output], feeds)
            return self._actions(actions, rows)
        if len(self._memory) != rows:
            self.reset(rows)
        actions = [self._step(row, observation) for row, observation in enumerate(observations)]
        return self._actions(np.stack([np.ravel(action) for action in actions]), rows)

    def _step(self, row: int, observation: Any) -> NDArray[Any]:
        """Computes one row, with a batch of one row."""
        feeds = {each.name: each.value([observation]) for each in self._inputs} | self._memory[row]
        action, *states = self._session.run([self._output, *self._states.values()], feeds)
        self._memory[row] = dict(zip(self._states, states))
        return np.asarray(action)

    def _actions(self, values: NDArray[Any], rows: int) -> NDArray[Any]:
        space = self._action_space
        values = np.asarray(values).reshape(rows, *(space.shape or ()))
        return (
            values.astype(space.dtype) if isinstance(space, spaces.Box) else values.astype(np.int64)
        )

    def _problem(self, text: str, error: Exception | None = None) -> InvalidValueError:
        cause = "" if error is None else ": " + " ".join(str(error).split())[:300]
        return InvalidValueError(f"the ONNX model {self._path} {text}{cause}")

    def _load(self) -> Any:
        path = self._path
        if path.suffix != ".onnx":
            raise InvalidValueError(
                f"{path} is not the path of an .onnx file; load the policy and pass it as an object"
            )
        if not path.is_file():
            raise InvalidValueError(f"there is no file {path}")
        with needed("ONNX policies need ONNX Runtime: pip install onnxruntime"):
            import onnxruntime
        try:
            found = contents(path.read_bytes())
        except InvalidValueError as error:
            raise self._problem("cannot be read", error) from error
        if found.random:
            raise self._problem(
                f"has the operator `{found.random[0]}`, which draws random numbers, so that no "
                "simulation could be repeated; export the policy's mean action "
                "(deterministic=True)"
            )
        if found.training:
            raise self._problem(
                f"has the operator `{found.training[0]}` in training mode; export it after "
                "`model.eval()`"
            )
        for name in sorted(found.files):
            if not (path.parent / name).is_file():
                raise self._problem(
                    f"has weights in the file {name}, which is not beside it; put it there, or "
                    "export with `torch.onnx.export(..., external_data=False)`"
                )
        options = onnxruntime.SessionOptions()
        # One thread gives the same sums on every machine.
        options.intra_op_num_threads = 1
        # The exceptions say the same.
        options.log_severity_level = 4
        try:
            return onnxruntime.InferenceSession(
                str(path), options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:
            raise self._problem(
                f"cannot be loaded by ONNX Runtime {onnxruntime.__version__}; a newer one may "
                "have its operators, or export it with `torch.onnx.export(..., opset_version=20)`",
                error,
            ) from error

    def _interface(self) -> dict[str, Any]:
        """Returns the description of inputs and outputs: of the side file, or of the metadata."""
        side = self._path.with_name(self._path.name + ".json")
        try:
            if side.is_file():
                found = json.loads(side.read_text())
            else:
                metadata = self._session.get_modelmeta().custom_metadata_map
                own = {
                    key.removeprefix("mishandle."): text for key, text in metadata.items()
                    if key.startswith("mishandle.")
                }
                found = {
                    key: json.loads(text) if key in ("state", "layout") else text
                    for key, text in own.items()
                }
                found = {key: value for key, value in found.items() if key not in _UNREAD}
            unknown = sorted(set(found) - set(_KEYS))
        except (ValueError, TypeError) as error:
            raise self._problem(
                f"has an invalid description of its inputs and outputs {_GUIDE}", error
            ) from error
        if seeing := sorted(set(found) & set(_SEEING)):
            raise self._problem(
                f"has the key `{seeing[0]}`: it sees through cameras of a task; {_NAMED_SPACE} "
                f"{_GUIDE}"
            )
        if remembering := sorted(set(found) & set(_REMEMBERING)):
            how = f"keep what it remembers in its own `state`; with a task, {_NAMED_SPACE}"
            raise self._problem(
                f"has the key `{remembering[0]}`, which needs a task or a target file; {how} "
                f"{_GUIDE}"
            )
        if unknown:
            raise self._problem(
                f"has the key `{unknown[0]}` in its description; known keys: {', '.join(_KEYS)} "
                f"{_GUIDE}"
            )
        return {key: value for key, value in found.items() if value is not None}

    def _find_states(self, pairs: Any) -> dict[str, str]:
        """Returns the outputs with the next state by the inputs with the state."""
        states = {str(source): str(target) for source, target in pairs}
        for names, known, kind in (
            (states.keys(), self._session.get_inputs(), "input"),
            (states.values(), self._session.get_outputs(), "output"),
        ):
            missing = set(names) - {each.name for each in known}
            if missing:
                raise self._problem(
                    f"has no {kind} `{min(missing)}`; its {kind}s: "
                    f"{', '.join(each.name for each in known)}"
                )
        return states

    def _first_state(self) -> dict[str, NDArray[Any]]:
        inputs = {each.name: each for each in self._session.get_inputs()}
        shapes = {
            name: [size if isinstance(size, int) else 1 for size in inputs[name].shape]
            for name in self._states
        }
        return {name: np.zeros(shape, self._dtype(inputs[name])) for name, shape in shapes.items()}

    def _dtype(self, value: Any) -> Any:
        if value.type not in _TYPES:
            raise self._problem(
                f"has the input `{value.name}` of the type {value.type}; expected a tensor of "
                "numbers"
            )
        return _TYPES[value.type]

    def _find_inputs(self, named: str | None, space: Space[Any]) -> list[_Input]:
        """Returns the inputs for the observation. Those for a dictionary have the names of its
        keys."""
        known = {each.name: each for each in self._session.get_inputs()}
        free = [name for name in known if name not in self._states]
        if named is not None:
            if named not in known:
                raise self._problem(f"has no input `{named}`; its inputs: {', '.join(known)}")
            free = [named, *(name for name in free if name != named)]
        if isinstance(space, spaces.Dict):
            other = [name for name in free if name not in space.spaces]
            if other or not free:
                raise self._problem(
                    f"has the input{'s' if len(free) > 1 else ''} {', '.join(free)}, but "
                    f"observations are a dictionary with the keys {', '.join(space.spaces)}; "
                    "export it with one input for each key, with the same names, or flatten the "
                    "observations of the environment by gymnasium.wrappers.FlattenObservation"
                )
            return [self._input(known[name], name, space.spaces[name]) for name in free]
        if len(free) != 1:
            text = (
                f"nothing says what the input `{free[1]}` is" if free
                else "it has no input for the observation"
            )
            raise self._problem(
                f"does not fit: {text}; observations are a {type(space).__name__}, not a "
                "dictionary; the metadata or a side file names the observation and the state "
                f"{_GUIDE}"
            )
        return [self._input(known[free[0]], None, space)]

    def _input(self, value: Any, key: str | None, space: Space[Any]) -> _Input:
        what = "observations" if key is None else f"observations `{key}`"
        if not isinstance(space, _LEAVES):
            raise self._problem(
                f"cannot read {what} of the space {type(space).__name__}; flatten them by "
                "gymnasium.wrappers.FlattenObservation"
            )
        dtype = self._dtype(value)
        if not np.issubdtype(dtype, np.floating) and np.issubdtype(space.dtype, np.floating):
            raise self._problem(
                f"has the input `{value.name}` of the type {value.type}, but {what} are real "
                "numbers"
            )
        sizes = tuple(space.shape or ())
        dims = list(value.shape or [])
        # A model without shapes is one of batches.
        dims = dims if dims or not sizes else ["N", *sizes]
        for shape in (sizes, (1,)) if sizes == () else (sizes,):
            batch = _batch(dims, shape)
            if batch is not None:
                break
        text = "[" + ", ".join(str(size) if isinstance(size, int) else "N" for size in dims) + "]"
        if batch is None:
            raise self._problem(
                f"has the input `{value.name}` of the shape {text}, but {what} have the shape "
                f"{list(sizes)}"
            )
        if batch == "many":
            raise self._problem(
                f"has the input `{value.name}` of the shape {text}, a fixed batch of {dims[0]} "
                "observations; export it with a batch of one, or of any size (dynamic_axes, "
                "dynamic_shapes)"
            )
        return _Input(value.name, key, dtype, shape, batch, _example(space))

    def _examples(self) -> list[Any]:
        """Returns two observations: of zeros or what is nearest, and of ones."""
        def observation(add: int) -> Any:
            parts = {each.key: each.example + add for each in self._inputs}
            return parts[None] if None in parts else parts

        return [observation(0), observation(1)]

    def _computes_rows(self, examples: list[Any]) -> bool:
        """Returns whether a batch has the actions of its rows. Some models have batches in their
        inputs only."""
        if any(each.batch != "rows" for each in self._inputs):
            return False
        self.reset(1)
        try:
            single = [np.ravel(self._step(0, example)) for example in examples]
            [batch] = self._session.run(
                [self._output], {each.name: each.value(examples) for each in self._inputs}
            )
            return np.allclose(
                np.reshape(batch, (2, -1)), single, rtol=1e-4, atol=1e-5, equal_nan=True
            )
        except Exception:
            return False

    def _find_action(self, named: str | None) -> str:
        """Returns the output with the action: the one that the description names, the only one, the
        one with such a name, or the only one that fits the space."""
        space = self._action_space
        if not isinstance(space, _LEAVES):
            raise self._problem(
                f"cannot return actions of the space {type(space).__name__}; expected a box or a "
                "discrete space"
            )
        names = [each.name for each in self._session.get_outputs()]
        if named is not None and named not in names:
            raise self._problem(f"has no output `{named}`; its outputs: {', '.join(names)}")
        free = (
            [named] if named is not None
            else [name for name in names if name not in self._states.values()]
        )
        feeds = {
            each.name: each.value([self._examples()[0]]) for each in self._inputs
        } | self._first_state()
        try:
            values = dict(zip(free, self._session.run(free, feeds)))
        except Exception as error:
            raise self._problem("cannot be computed for an observation of zeros", error) from error
        fitting = [name for name in free if _mismatch(values[name], space) is None]
        called = [name for name in free if name.lower() in ("action", "actions")]
        choices = [free, called, fitting]
        for choice in choices:
            if len(choice) == 1:
                problem = _mismatch(values[choice[0]], space)
                if problem is not None:
                    raise self._problem(f"has the output `{choice[0]}` {problem}")
                return choice[0]
        raise self._problem(
            f"has the outputs {', '.join(free)}, and nothing says which one is the action: "
            f"{'several' if fitting else 'none'} of them fit the space {space}; name it by "
            f"`action` in the metadata or in a side file {_GUIDE}"
        )


def _batch(dims: list[Any], shape: tuple[int, ...]) -> str | None:
    """Returns what the first dimension of an input is for observations of this shape; None if they
    do not fit.

    >>> _batch(["N", 3], (3,)), _batch([1, 3], (3,)), _batch([3], (3,)), _batch(
    ...     [4, 3], (3,)
    ... ), _batch(["N", 2], (3,))
    ('rows', 'one', 'none', 'many', None)
    """
    def fits(sizes: list[Any]) -> bool:
        return (
            len(sizes) == len(shape)
            and all(not isinstance(a, int) or a == b for a, b in zip(sizes, shape))
        )

    if dims and fits(dims[1:]):
        return "rows" if not isinstance(dims[0], int) else "one" if dims[0] == 1 else "many"
    return "none" if fits(dims) else None


def _example(space: Space[Any]) -> NDArray[Any]:
    """Returns the element of a space that is nearest to zero."""
    if isinstance(space, spaces.Box):
        return np.clip(np.zeros(space.shape, space.dtype), space.low, space.high)
    return np.zeros(space.shape or (), space.dtype) + getattr(space, "start", 0)


def _mismatch(value: Any, space: Space[Any]) -> str | None:
    """Returns what is wrong with an output as the action of one row; None if it fits."""
    if not isinstance(value, np.ndarray):
        return f"of the type {type(value).__name__}; expected a tensor"
    count = math.prod(space.shape or ())
    is_integer = value.dtype.kind in "iub"
    kind = "integers" if is_integer else "real numbers"
    if isinstance(space, spaces.Box):
        if value.size == count and value.dtype.kind == "f":
            return None
        return (
            f"of the shape {list(value.shape)} in {kind}, but an action is {count} real numbers "
            f"{_GUIDE}"
        )
    if value.size == count and is_integer:
        return None
    return (
        f"of the shape {list(value.shape)} in {kind}, but an action of the space {space} is "
        f"{count} integer{'s' if count > 1 else ''}; export the choice (`argmax`) instead of its "
        "scores"
    )
