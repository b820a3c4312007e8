"""Attributes of an environment that a scenario sets, and their return to what they were."""

import copy
import importlib
import warnings
from collections.abc import Callable, Iterable, Mapping, MutableMapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mishandle.scenarios.axes import follower, parse_path

_CONSTANTS = ("body_", "jnt_", "dof_", "qpos", "site_", "tendon_", "wrap_", "actuator_", "eq_")
"""First letters of the fields of a MuJoCo model of which other fields are computed."""

_DERIVED = (*_CONSTANTS, "cam_", "light_")
"""First letters of the computed fields."""


class Attributes:
    """Sets attributes of one environment, and restores them.

    Fields of a MuJoCo model change together with what MuJoCo's compiler derives of them: the
    inertia of a body is scaled with its mass, and ``mj_setConst`` computes the constants again.

    >>> car = {"speeds": [20.0, 30.0]}
    >>> attributes = Attributes()
    >>> attributes.set(car, [("speeds[0]", 25.0)])
    >>> car
    {'speeds': [25.0, 30.0]}
    >>> attributes.restore()
    >>> car
    {'speeds': [20.0, 30.0]}
    """

    def __init__(self) -> None:
        self._undo: list[Callable[[], None]] = []
        self._set: list[tuple[Any, str]] = []

    def set(self, start: Any, values: Iterable[tuple[str, Any]]) -> None:
        """Sets the values at paths. They stay until :meth:`restore`."""
        models: dict[int, _Model] = {}
        for path, value in values:
            found = _model_of(start, path)
            if found is not None:
                _check_field(found[1])
            if found is not None and found[1].startswith(_CONSTANTS) and id(found[0]) not in models:
                model = models[id(found[0])] = _Model(found[0])
                self._undo.append(model.restore)
            holder, key, is_item = _place(start, path)
            self._undo.append(_setter(holder, key, is_item))
            self._set.append((start, path))
            _put(holder, key, is_item, value)
        for model in models.values():
            model.derive()

    def values(self) -> list[Any]:
        """Returns the present values of what was set."""
        return [_get(*_place(start, path)) for start, path in self._set]

    @property
    def are_set(self) -> bool:
        """Whether there is something to restore."""
        return bool(self._undo)

    def restore(self) -> None:
        """Restores all values, the last one first."""
        while self._undo:
            self._undo.pop()()
        self._set.clear()


def _place(start: Any, path: str) -> tuple[Any, Any, bool]:
    """Returns the object that has the value of a path, its attribute or key, and whether it is a
    key.

    Raises if there is no such value: setting a new attribute would have no effect on the
    environment.
    """
    *parents, (name, indexes) = parse_path(path)
    start = follower(parents)(start)
    is_item = isinstance(start, MutableMapping)
    found = start[name] if isinstance(start, Mapping) else getattr(start, name)
    if not indexes:
        return start, name, is_item
    for index in indexes[:-1]:
        found = found[index]
    found[indexes[-1]]
    return found, indexes[-1], True


def _get(holder: Any, key: Any, is_item: bool) -> Any:
    return holder[key] if is_item else getattr(holder, key)


def _put(holder: Any, key: Any, is_item: bool, value: Any) -> None:
    if is_item:
        holder[key] = value
    else:
        setattr(holder, key, value)


def _setter(holder: Any, key: Any, is_item: bool) -> Callable[[], None]:
    """Returns a function that restores the present value."""
    if not is_item and hasattr(holder, "__dict__") and key not in vars(holder):
        stated = getattr(type(holder), key, None)
        if not hasattr(type(stated), "__set__"):
            # A class states it, and other objects share it.
            return lambda: vars(holder).pop(key, None)
    found = _get(holder, key, is_item)
    # A part of an array is a view, which would change with it.
    before = copy.copy(found) if is_item else found
    return lambda: _put(holder, key, is_item, before)


def _model_of(start: Any, path: str) -> tuple[Any, str] | None:
    """Returns the MuJoCo model on a path, and the name of its field that follows."""
    segments = parse_path(path)
    for segment, (field, _) in zip(segments, segments[1:]):
        start = follower([segment])(start)
        # robosuite wraps the model.
        for model in (start, getattr(start, "_model", None)):
            if (
                type(model).__name__ == "MjModel"
                and type(model).__module__.partition(".")[0] == "mujoco"
            ):
                return model, field
    return None


class _Model:
    """A MuJoCo model whose fields change."""

    def __init__(self, model: Any) -> None:
        self._model = model
        self._before = {name: value.copy() for name, value in _arrays(model).items()}

    def derive(self) -> None:
        """Computes what depends on the changed fields, as MuJoCo's compiler does."""
        model, before = self._model, self._before
        has_own = (model.body_inertia != before["body_inertia"]).any(axis=1)
        bodies = (model.body_mass != before["body_mass"]) & (before["body_mass"] > 0) & ~has_own
        factors = model.body_mass[bodies] / before["body_mass"][bodies]
        model.body_inertia[bodies] = before["body_inertia"][bodies] * factors[:, None]
        mujoco = importlib.import_module("mujoco")
        # In data of its own, because it moves the model to its reference position.
        mujoco.mj_setConst(model, mujoco.MjData(model))

    def restore(self) -> None:
        for name, value in _arrays(self._model).items():
            if not np.array_equal(value, self._before[name], equal_nan=value.dtype.kind == "f"):
                value[...] = self._before[name]


def _check_field(field: str) -> None:
    """Warns of a field whose consequences only MuJoCo's compiler computes."""
    if field in ("geom_size", "geom_type", "mesh_vert"):
        warnings.warn(
            f"an axis sets {field} of a MuJoCo model, which leaves the masses and the bounding "
            "spheres of its geometries behind; make a new model for each scenario instead, in a "
            "function of the axis or in the reset",
            stacklevel=2,
        )


def _arrays(model: Any) -> dict[str, NDArray[Any]]:
    """Returns the arrays of a MuJoCo model that can change, as views."""
    names = _names.get(type(model))
    if names is None:
        found = [name for name in dir(model) if name.startswith(_DERIVED)]
        names = _names[type(model)] = [
            name for name in found if isinstance(getattr(model, name), np.ndarray)
        ]
    return {name: getattr(model, name) for name in names}


_names: dict[type, list[str]] = {}
