"""What decides how a system in Python behaves: its code, and the values that the code reaches.

A walk starts at a function or an object and lists its leaves: bytecode, numbers, texts, arrays,
weights, files. It follows closures, defaults, global variables, helper functions, attributes and
classes. Code of libraries is named by the version of its package. The leaves of two processes are
the same: they contain no addresses, no order of sets, and no paths of modules.
"""

import datetime
import decimal
import enum
import fractions
import functools
import hashlib
import os
import pathlib
import re
import sys
import types
import weakref
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mishandle.base import bytecode
from mishandle.base.packages import UNKNOWN, is_library, package_of

MAX_OBJECTS = 100_000
"""Largest number of objects of a walk."""

MAX_DEPTH = 100
"""Largest number of objects that a walk nests."""

MAX_BYTES = 2**30
"""Largest size of all arrays, texts and files of a walk, in bytes."""

MAX_GAPS = 20
"""Largest number of parts that are listed as not covered."""

_PLAIN: tuple[type, ...] = (
    *(
        bool, int, float, complex, str, bytes, bytearray, type(None), type(...),
        type(NotImplemented), range, slice
    ),
    *(
        datetime.date, datetime.datetime, datetime.time, datetime.timedelta, datetime.timezone,
        decimal.Decimal, fractions.Fraction
    ),
)

_NAMED: tuple[type, ...] = (
    *(
        types.BuiltinFunctionType, types.WrapperDescriptorType, types.MethodDescriptorType,
        types.ClassMethodDescriptorType
    ),
    *(types.MethodWrapperType, types.GetSetDescriptorType, types.MemberDescriptorType, np.ufunc),
)

_CLOSED = set(
    "subprocess socket _socket threading _thread io _io multiprocessing queue _queue asyncio "
    "_asyncio concurrent ctypes _ctypes select ssl _ssl selectors weakref _weakref sqlite3 mmap "
    "unittest contextvars _contextvars".split()
)
"""Modules whose objects are resources of the process or of the machine."""

_RANDOM = {
    ("random", "Random"), ("_random", "Random"), ("numpy.random._generator", "Generator"),
    ("numpy.random.mtrand", "RandomState")
}

_SKIPPED = set(
    "__dict__ __weakref__ __doc__ __module__ __qualname__ __abstractmethods__ _abc_impl "
    "__annotations__ __annotate__ __annotate_func__ __annotations_cache__ __firstlineno__ "
    "__static_attributes__ __orig_bases__ __parameters__ __type_params__ __classcell__".split()
)
"""Attributes of a class that do not change what it does."""


@dataclass(frozen=True)
class Leaf:
    """A part of a walk: its hash, the reference in code through which it was reached, and for a
    file the time of its last change."""

    digest: str
    scope: str
    changed: int | None = None
    is_code: bool = False


@dataclass
class Walk:
    """The leaves of a function or object by path, and the parts that it cannot see."""

    leaves: dict[str, Leaf] = field(default_factory=dict)
    gaps: dict[str, str] = field(default_factory=dict)
    packages: dict[str, str] = field(default_factory=dict)
    resettable: set[str] = field(default_factory=set)
    """Objects with a method ``reset``."""
    state: set[str] = field(default_factory=set)
    """Attributes of these objects that the methods of an episode set."""
    processes: list[Any] = field(default_factory=list)
    """Processes that it reaches."""


def walk(root: Any, *, values: bool = True) -> Walk:
    """Lists what decides how a function or an object behaves. Without ``values``, lists functions
    and classes only.

    >>> walk({"gain": [2.0]}).leaves == walk({"gain": [3.0]}).leaves
    False
    """
    walker = _Walker(values)
    walker.run(root)
    return walker.found


class _Walker:
    def __init__(self, values: bool) -> None:
        self.found = Walk()
        self._values = values
        self._seen: dict[int, str] = {}
        # Objects that live only for the walk would give their addresses to others.
        self._alive: list[Any] = []
        self._pending: list[tuple[str, Any, int, str]] = []
        self._bytes = 0
        self._path = self._scope = ""
        self._depth = 0

    def run(self, root: Any) -> None:
        self._pending.append(("", root, 0, ""))
        while self._pending:
            if len(self._alive) >= MAX_OBJECTS:
                self.found.gaps[""] = f"what is beyond the first {MAX_OBJECTS:,} objects"
                return
            self._path, value, self._depth, self._scope = self._pending.pop()
            self._alive.append(value)
            if self._depth > MAX_DEPTH:
                self._gap(f"an object that is nested deeper than {MAX_DEPTH}")
            else:
                self._visit(value)

    def _later(self, step: str, value: Any) -> None:
        self._pending.append((self._path + step, value, self._depth + 1, self._scope))

    def _refer(self, name: str, value: Any) -> None:
        """Visits what code refers to by name."""
        path = f"{self._path}>{name}"
        self._pending.append((path, value, self._depth + 1, path))

    def _leaf(
        self, *parts: str | bytes, step: str = "", changed: int | None = None, is_code: bool = False
    ) -> None:
        if not (self._values or is_code):
            return
        digest = hashlib.sha256()
        for part in parts:
            data = part.encode("utf-8", "surrogatepass") if isinstance(part, str) else part
            digest.update(len(data).to_bytes(8, "little") + data)
        self.found.leaves[self._path + step] = Leaf(
            digest.hexdigest(), self._scope, changed, is_code
        )

    def _gap(self, what: str) -> None:
        self.found.gaps[self._path] = what

    def _has_room(self, size: int) -> bool:
        if self._bytes + size > MAX_BYTES:
            self._gap(f"{size:,} bytes beyond the first {MAX_BYTES:,}")
            return False
        self._bytes += size
        return True

    def _package(self, module: str) -> None:
        package = package_of(module)
        if package is not None:
            self.found.packages[package[0]] = package[1]
            if package[1] == UNKNOWN:
                self.found.gaps[
                    f"package {package[0]}"
                ] = f"the package {package[0]}, whose version is not known"

    def _visit(self, value: Any) -> None:
        kind = type(value)
        if isinstance(value, enum.Enum):
            self._leaf(
                "enum", value.name, repr(value.value) if isinstance(value.value, _PLAIN) else ""
            )
            self._later(":class", kind)
        elif isinstance(value, pathlib.PurePath):
            self._text(str(value))
        elif kind in _PLAIN or isinstance(value, re.Pattern):
            self._plain(value)
        elif isinstance(value, np.generic) or kind is np.dtype or isinstance(value, np.dtype):
            self._leaf(kind.__name__, repr(value))
        elif isinstance(value, tuple) and kind is tuple:
            self._sequence(value)
        elif id(value) in self._seen:
            self._leaf("same as", self._seen[id(value)])
        else:
            self._seen[id(value)] = self._path
            self._compound(value)

    def _plain(self, value: Any) -> None:
        if isinstance(value, str):
            self._text(value)
        elif not isinstance(value, (bytes, bytearray)):
            self._leaf(type(value).__name__, repr(value))
        elif self._has_room(len(value)):
            self._leaf("bytes", bytes(value))

    def _text(self, text: str) -> None:
        """A text that names a file stands for the content of the file."""
        if not self._file(text) and self._has_room(len(text)):
            self._leaf("text", text)

    def _file(self, text: str, step: str = "") -> bool:
        if (
            not self._values or not 1 < len(text) < 1024 or not ("." in text or "/" in text)
            or not text.isprintable()
        ):
            return False
        try:
            if not os.path.isfile(text):
                return False
            facts = os.stat(text)
            if self._has_room(facts.st_size):
                with open(text, "rb") as file:
                    found = (
                        hashlib.file_digest(file, "sha256") if sys.version_info >= (3, 11)
                        else hashlib.sha256(file.read())
                    )
                self._leaf("file", found.digest(), step=step, changed=facts.st_mtime_ns)
        except OSError as error:
            self._gap(f"the file {text}: {error.strerror}")
        return True

    def _sequence(self, values: Any) -> None:
        self._leaf(type(values).__name__, str(len(values)))
        for index in reversed(range(len(values))):
            self._later(f"[{index}]", values[index])

    def _compound(self, value: Any) -> None:
        kind = type(value)
        if isinstance(value, types.FunctionType):
            self._function(value)
        elif isinstance(value, types.MethodType):
            self._later(":self", value.__self__)
            self._later(":function", value.__func__)
        elif isinstance(value, functools.partial):
            self._leaf("partial", is_code=True)
            for name, part in (
                ("keywords", value.keywords), ("args", value.args), ("func", value.func)
            ):
                self._later(f":{name}", part)
            self._attributes(vars(value))
        elif isinstance(value, (staticmethod, classmethod)):
            self._later(":function", value.__func__)
        elif isinstance(value, property):
            for name in ("fdel", "fset", "fget"):
                self._later(f":{name}", getattr(value, name))
        elif isinstance(value, type):
            self._class(value)
        elif isinstance(value, _NAMED):
            self._named(value)
        elif isinstance(value, types.CodeType):
            self._leaf("code", bytecode.content(value), is_code=True)
        elif isinstance(value, types.ModuleType):
            self._module(value)
        elif isinstance(value, np.ndarray):
            self._array(value)
        elif (
            kind.__module__ == "builtins"
            and isinstance(value, (list, dict, set, frozenset, types.MappingProxyType))
        ):
            self._container(value)
        else:
            self._object(value)

    def _named(self, value: Any) -> None:
        owner = getattr(value, "__self__", None)
        module = (
            getattr(value, "__module__", None)
            or getattr(getattr(value, "__objclass__", None), "__module__", None) or ""
        )
        self._leaf(
            "builtin", module, getattr(value, "__qualname__", getattr(value, "__name__", "")),
            is_code=True
        )
        if owner is not None and not isinstance(owner, types.ModuleType):
            self._later(":self", owner)
        if module:
            self._package(module)

    def _function(self, value: types.FunctionType) -> None:
        if is_library(value.__module__ or ""):
            self._leaf("library", value.__module__, value.__qualname__, is_code=True)
            self._package(value.__module__)
        else:
            self._leaf("function", bytecode.content(value.__code__), is_code=True)
            self._references(value.__code__, value.__globals__)
            for index, default in enumerate(value.__defaults__ or ()):
                self._later(f"(default {index})", default)
            for name, default in sorted((value.__kwdefaults__ or {}).items()):
                self._later(f"({name})", default)
        # Also of a library, whose decorators keep functions of the user there.
        for name, cell in zip(value.__code__.co_freevars, value.__closure__ or ()):
            try:
                self._refer(name, cell.cell_contents)
            except ValueError:  # not assigned yet
                pass
        self._attributes(vars(value))

    def _references(self, code: types.CodeType, names: Mapping[str, Any]) -> None:
        found = bytecode.references(code)
        for name in sorted(found.names & names.keys()):
            self._reference(name, names[name], found.attributes)
        if not self._values:
            return
        for module, level in sorted(found.imports):
            package = names.get("__package__") or ""
            parts = package.split(".")[: len(package.split(".")) - level + 1] if level else []
            full = ".".join([*parts, *([module] if module else [])])
            if full in sys.modules:
                self._reference(full, sys.modules[full], found.attributes)
        for text in sorted(found.texts):
            self._file(text, step=f">'{text}'")

    def _reference(self, name: str, value: Any, attributes: set[str]) -> None:
        """A name that code looks up. Of a module of the user, only those names count that the code
        looks up in it."""
        if not isinstance(value, types.ModuleType):
            self._refer(name, value)
        elif is_library(value.__name__):
            self._package(value.__name__)
        else:
            for attribute in sorted(attributes & vars(value).keys()):
                inner = vars(value)[attribute]
                if inner is not value and f"{name}.{attribute}".count(".") < MAX_DEPTH:
                    self._reference(f"{name}.{attribute}", inner, attributes - {attribute})

    def _module(self, value: types.ModuleType) -> None:
        file = getattr(value, "__file__", None)
        if is_library(value.__name__):
            self._package(value.__name__)
        elif not (isinstance(file, str) and self._file(file)):
            self._gap(f"the module {value.__name__}")

    def _class(self, value: type) -> None:
        self._leaf(
            "class", value.__name__, value.__module__ if is_library(value.__module__) else "",
            is_code=True
        )
        if is_library(value.__module__):
            self._package(value.__module__)
            return
        for index, base in enumerate(value.__bases__):
            self._later(f":base {index}", base)
        if type(value) is not type:
            self._later(":metaclass", type(value))
        for name in sorted(vars(value).keys() - _SKIPPED):
            member = vars(value)[name]
            if isinstance(member, (types.GetSetDescriptorType, types.MemberDescriptorType)):
                continue
            if callable(member):
                self._refer(name, member)
            else:
                self._later(f".{name}", member)

    def _array(self, value: Any) -> None:
        if value.dtype.hasobject:
            self._leaf("array", value.dtype.str, repr(value.shape))
            for index, each in enumerate(value.flat):
                self._later(f"[{index}]", each)
        elif self._has_room(value.nbytes):
            self._leaf(
                "array", repr(value.dtype.descr), repr(value.shape),
                np.ascontiguousarray(value).tobytes()
            )

    def _container(self, value: Any) -> None:
        if isinstance(value, (set, frozenset)):
            self._leaf("set", *sorted(_digest(each) for each in value))
        elif isinstance(value, (dict, types.MappingProxyType)):
            self._mapping(value)
        else:
            self._sequence(value)

    def _mapping(self, value: Mapping[Any, Any]) -> None:
        keys = [
            repr(key) if isinstance(key, (str, int, float, bool, type(None))) else _digest(key)
            for key in value
        ]
        self._leaf("dict", *keys)
        for key, each in reversed(list(zip(keys, value.values()))):
            self._later(f"[{key}]", each)
        if getattr(value, "default_factory", None) is not None:
            self._later(":default", value.default_factory)  # type: ignore[attr-defined]

    def _attributes(self, attributes: Mapping[str, Any]) -> None:
        if self._values:
            for name in sorted(attributes, reverse=True):
                self._later(f".{name}", attributes[name])

    def _object(self, value: Any) -> None:
        kind = type(value)
        top = kind.__module__.partition(".")[0]
        self._later(":class", kind)
        if not self._values:
            return
        if top == "subprocess" and kind.__name__ == "Popen":
            self.found.processes.append(value)
        # The function of a compiled or cached one.
        attributes = getattr(value, "__dict__", {})
        inner = attributes.get("py_func") or attributes.get("__wrapped__")
        if (
            (kind.__module__, kind.__name__) in _RANDOM
            or kind.__module__.startswith("numpy.random")
        ):
            self._gap("the state of a random generator")
        elif top == "logging" or kind.__module__ == "typing":
            self._leaf("named", repr(kind))
        elif top == "mishandle":
            self._own(value)
        elif (
            top in _CLOSED
            or isinstance(
                value,
                (types.GeneratorType, types.CoroutineType, types.FrameType, types.TracebackType)
            )
        ):
            self._gap(f"an object of {top}.{kind.__name__}")
        elif is_kind(kind, "torch", "Tensor"):
            self._tensor(value)
        elif is_kind(kind, "torch", "Module"):
            self._network(value)
        elif (
            is_kind(kind, "stable_baselines3", "BaseAlgorithm")
            or is_kind(kind, "sb3_contrib", "BaseAlgorithm")
        ):
            self._later(".policy", value.policy)
            self._normalizer(value)
        elif is_kind(kind, "skrl", "Agent"):
            self._later(".policy", value.policy)
            self._later(
                "._observation_preprocessor", getattr(value, "_observation_preprocessor", None)
            )
        elif is_kind(kind, "gymnasium", "AsyncVectorEnv"):
            self._later(".env_fns", list(value.env_fns))
        elif inner is not None:
            self._later(":function", inner)
        elif is_kind(kind, "mujoco", "MjData"):
            pass  # It is the state of a simulation.
        elif hasattr(kind, "__array__") and hasattr(kind, "dtype") and hasattr(kind, "shape"):
            self._array(np.asarray(value))
        else:
            self._content(value)

    def _own(self, value: Any) -> None:
        if type(value).__name__ == "Controller":
            self._leaf("controller", value.hash)
        elif type(value).__name__ == "PolicyServer":
            self._later(":settings", value.settings)
            if value.gap is not None:
                self._gap(value.gap)
        elif type(value).__name__ == "LeRobotPolicy":
            self._later(":identity", value.identity)
        elif hasattr(value, "_simulations"):
            # One of our tasks as an environment.
            self._later(".settings", [*value._simulations.settings, getattr(value, "_limit", None)])
        else:
            self._attributes(getattr(value, "__dict__", {}))

    def _content(self, value: Any) -> None:
        """The elements of a container of a user or of a library, and the attributes of any
        object."""
        kind = type(value)
        if isinstance(value, dict):
            self._mapping(value)
        elif isinstance(value, (list, tuple)):
            self._sequence(value)
        if isinstance(value, (set, frozenset)):
            self._container(value)
        given = next((each for each in kind.__mro__ if "__getstate__" in vars(each)), object)
        if given is not object and given.__name__ != "EzPickle":
            try:
                state = value.__getstate__()
            except Exception:
                self._gap(f"an object of {kind.__module__}.{kind.__qualname__}")
                return
            self._later(":state", state)
            return
        attributes = dict(getattr(value, "__dict__", {}))
        for base in kind.__mro__:
            slots = vars(base).get("__slots__", ())
            for name in [slots] if isinstance(slots, str) else slots:
                if name not in _SKIPPED and hasattr(value, name):
                    attributes[name] = getattr(value, name)
        if (
            attributes or hasattr(value, "__dict__")
            or isinstance(value, (dict, list, tuple, set, frozenset))
        ):
            self._instance(value, attributes)
        else:
            self._reduced(value)

    def _instance(self, value: Any, attributes: dict[str, Any]) -> None:
        kind = type(value)
        if any(is_kind(kind, "gymnasium", name) for name in ("Env", "VectorEnv", "Space")):
            # A reset seeds the generators.
            for name in ("_np_random", "np_random", "_np_random_seed", "_cached_spec"):
                attributes.pop(name, None)
        if callable(getattr(kind, "reset", None)):
            self.found.resettable.add(self._path)
            stored = _stored_by_episodes(kind.__mro__)
            self.found.state.update(f"{self._path}.{name}" for name in stored & attributes.keys())
        self._leaf("object")
        self._attributes(attributes)

    def _reduced(self, value: Any) -> None:
        """An object in C: what pickle makes of it."""
        kind = type(value)
        try:
            reduced = value.__reduce_ex__(4)
        except Exception:
            self._gap(f"an object of {kind.__module__}.{kind.__qualname__}")
            return
        if isinstance(reduced, str):
            self._leaf("named", reduced)
            return
        self._leaf("object")
        for index, part in enumerate(reduced):
            self._later(f":{index}", list(part) if isinstance(part, Iterator) else part)

    def _tensor(self, value: Any) -> None:
        try:
            self._array(value.detach().cpu().numpy())
        except Exception:
            self._gap(f"a tensor of {getattr(value, 'dtype', 'an unknown type')}")

    def _network(self, value: Any) -> None:
        """A module of PyTorch: all its tensors by name, and the attributes of the modules inside of
        it."""
        for name, tensor in sorted(value.state_dict().items()):
            self._later(f".state_dict[{name}]", tensor)
        code = getattr(value, "code", None)
        if isinstance(code, str):  # TorchScript
            self._leaf("script", code, step=":code")
            return
        attributes = dict(vars(value))
        attributes = {
            name: each for name, each in attributes.items()
            if not type(each).__module__.startswith("torch.optim")
        }
        self._attributes(attributes)

    def _normalizer(self, value: Any) -> None:
        normalizer = vec_normalize(value)
        if normalizer is not None:
            for name in ("norm_obs", "obs_rms", "clip_obs", "epsilon"):
                self._later(f".normalizer.{name}", getattr(normalizer, name, None))


def _digest(value: Any) -> str:
    """Returns a hash of a value without its place."""
    found = walk(value)
    digest = hashlib.sha256()
    for path, leaf in sorted(found.leaves.items()):
        digest.update(f"{path}\0{leaf.digest}\n".encode("utf-8", "surrogatepass"))
    return digest.hexdigest()


def vec_normalize(model: Any) -> Any:
    """Returns the normalizer (`VecNormalize`) of the environment of a Stable-Baselines3 model;
    `None` if it has none."""
    find = getattr(model, "get_vec_normalize_env", None)
    return find() if callable(find) else None


def is_kind(kind: type, top: str, name: str) -> bool:
    """Returns whether a class or one of its bases has this name and is of a package."""
    return any(
        base.__name__ == name and base.__module__.partition(".")[0] == top for base in kind.__mro__
    )


@functools.cache
def _stored_by_episodes(classes: tuple[type, ...]) -> frozenset[str]:
    """Returns the attributes that the methods of an episode set, and the methods that they call.
    ``classes`` are those of an object."""
    stored: set[str] = set()
    pending, seen = ["reset", "step", "act", "predict", "__call__"], set()
    while pending:
        name = pending.pop()
        if name in seen:
            continue
        seen.add(name)
        for base in classes:
            code = getattr(vars(base).get(name), "__code__", None)
            if code is not None:
                found = bytecode.references(code)
                stored |= found.stored
                pending += sorted(found.attributes)
    return frozenset(stored)


@dataclass
class Fingerprint:
    """Hash of a system's code and of the values that it reaches, and what the hash does not
    cover."""

    digest: str
    gaps: tuple[str, ...]
    packages: dict[str, str]


def fingerprint(before: Walk, after: Walk, first: dict[str, str]) -> Fingerprint:
    """Returns the fingerprint of two walks of the same object, before and after simulations.

    Values that the simulations changed are a state. That of objects with a reset is left out,
    because each episode begins with a reset. Other states count with the value before the first
    simulation of this process, which ``first`` remembers for later calls.
    """
    resettable, state = before.resettable | after.resettable, before.state | after.state
    scopes = {leaf.scope for leaf in before.leaves.values()}
    changed = set()
    for path, now in after.leaves.items():
        then = before.leaves.get(path)
        # A module that a simulation imports was not there before.
        is_new_code = then is None and now.scope != "" and now.scope not in scopes
        if then != now and not now.is_code and not is_new_code:
            changed.add(path)
    changed |= {
        path for path, leaf in before.leaves.items()
        if path not in after.leaves and not leaf.is_code
    }
    # What is in a part that changed before is not from the start.
    known = set(first)
    for path in {*before.leaves, *changed}:
        parts = list(_prefixes(path))
        if any(part in changed for part in parts) and not any(part in known for part in parts):
            leaf = before.leaves.get(path)
            first[path] = "" if leaf is None or leaf.changed is not None else leaf.digest
    digest = hashlib.sha256()
    for path, leaf in sorted({**before.leaves, **after.leaves}.items()):
        parts = list(_prefixes(path))
        found = leaf.digest
        if any(part in first for part in parts) and not leaf.is_code:
            found = "" if any(part in resettable for part in parts) else first.get(path, "")
        if found and not any(part in state for part in parts):
            digest.update(f"{path}\0{found}\n".encode("utf-8", "surrogatepass"))
    gaps = {**before.gaps, **after.gaps}
    return Fingerprint(digest.hexdigest(), _texts(gaps), {**before.packages, **after.packages})


def _texts(gaps: Mapping[str, str]) -> tuple[str, ...]:
    texts = sorted({
        f"{what} ({path.lstrip('>.')})" if path.lstrip(">.") else what
        for path, what in gaps.items()
    })
    more = len(texts) - MAX_GAPS
    return tuple(texts if more <= 0 else [*texts[:MAX_GAPS], f"{more} more"])


def _prefixes(path: str) -> Iterator[str]:
    """Yields a path and the paths of what contains it, without those of the code around it.

    >>> list(_prefixes(">car.wheels[0]"))
    ['>car.wheels[0]', '>car.wheels', '>car']
    >>> list(_prefixes(".gain"))
    ['.gain', '']
    """
    yield path
    for end in range(len(path) - 1, 0, -1):
        if path[end] == ">":
            return
        if path[end] in ".[:(":
            yield path[:end]
    if path[:1] != ">":
        yield ""


_first: weakref.WeakKeyDictionary[Any, dict[str, str]] = weakref.WeakKeyDictionary()
"""Values of states before the first simulation of this process, by the function or object."""


class Watch:
    """The functions and objects of a target, walked before its first simulation."""

    def __init__(self, roots: Mapping[str, Any]) -> None:
        self._roots = roots
        self._before = {name: walk(root) for name, root in roots.items()}

    def fingerprints(self) -> dict[str, Fingerprint]:
        """Walks them again after simulations, and returns their fingerprints."""
        return {
            name: fingerprint(walked, walk(self._roots[name]), self._known(name))
            for name, walked in self._before.items()
        }

    def _known(self, name: str) -> dict[str, str]:
        root = self._roots[name]
        try:
            # A bound method is a new object each time.
            return _first.setdefault(getattr(root, "__self__", root), {})
        except TypeError:
            return {}


def code_hash(roots: list[Any]) -> str:
    """Returns a hash of functions and classes, which is the same in a process that got them by
    cloudpickle."""
    digest = hashlib.sha256()
    for root in roots:
        for path, leaf in sorted(walk(root, values=False).leaves.items()):
            digest.update(f"{path}\0{leaf.digest}\n".encode("utf-8", "surrogatepass"))
    return digest.hexdigest()
