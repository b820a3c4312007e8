"""Axes of scenario spaces."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Union

from mishandle.base.documents import document
from mishandle.errors import InvalidValueError

if TYPE_CHECKING:
    from mishandle.scenarios.layouts import FaultSettings
    from mishandle.scenarios.images import ImageSettings

Value = Union[float, int, str]
"""Value of an axis in a scenario: a float, an integer for integer axes, a name for categorical
axes."""

@dataclass(frozen=True)
class ResetOption:
    """Passes the value of an axis as an option of the environment's ``reset``.

    A dot separates the names of nested options: ``"scenario.target_x"`` is
    ``options["scenario"]["target_x"]``.
    """

    name: str


@dataclass(frozen=True)
class Attribute:
    """Sets an attribute of the unwrapped environment to the value of an axis before each reset.

    ``path`` is a path such as ``"model.opt.gravity[2]"``; the names after a dictionary are its
    keys, as in ``"config.vehicles_count"``.
    """

    path: str

    def __post_init__(self) -> None:
        parse_path(self.path)


@dataclass(frozen=True)
class FaultParameter:
    """Sets a parameter of what is between the environment and the policy: of a fault or delay
    (:func:`mishandle.faults`), or of the images of an observation (:func:`mishandle.sight`)."""

    settings: "FaultSettings | ImageSettings"


@dataclass(frozen=True)
class PolicyArgument:
    """Passes the value of an axis to the policy, as the keyword argument ``name`` of each call: a
    bias of its estimate, a delay of its own. The policy is a function or another callable. A policy
    of batches gets an array with one value per row."""

    name: str


@dataclass(frozen=True)
class Except:
    """Any other value than this one: see ``Axis.when``."""

    value: Value


Application = Union[
    ResetOption, Attribute, FaultParameter, PolicyArgument, Callable[[Any, Value], Any]
]
"""How an environment or its policy gets the value of an axis. A callable gets the environment and
the value after the reset; it returns the observation if it changes it, otherwise ``None``."""


@dataclass(frozen=True)
class Axis:
    """One quantity that a scenario sets.

    Parameters
    ----------
    name : str
        Name, unique in the space.
    low, high : float
        Bounds, both of which are values of the axis. For a bound that is none, state the next
        number, ``math.nextafter(high, low)``. Categorical axes have no bounds.
    unit : str
        Unit, for instance ``"m"``; empty for dimensionless numbers.
    values : str or sequence of str
        ``"continuous"``, ``"logarithmic"``, ``"integer"``, or the names of a categorical axis.
    nominal : float or str, optional
        Value in an undisturbed episode: by default the middle of the bounds, or the first name. A
        name can be given by its number, from 0, too.
    kind : str
        ``"start"`` (initial state), ``"model"`` (constant of the system), ``"event"``, ``"input"``
        or ``"noise"``. The axes of :func:`mishandle.faults` have the kind ``"fault"``.
    meaning : str
        Description.
    apply : ResetOption, Attribute, PolicyArgument or callable, optional
        How an environment or its policy gets the value; by default the reset option with the name
        of the axis. Functions get a dictionary instead and ignore it.
    drawn_from : float
        Fraction of the range, from 0 to less than 1, below which no random value is: an axis that
        is nominal at its lower bound then has strong values only. Searches use the whole range.
    when : mapping, optional
        Values of other axes, by name, without which this axis has no effect. It is then nominal, no
        search varies it, and no explanation names it.

    Examples
    --------
    >>> Axis("friction", 0.5, 1.5, nominal=1.0, kind="model").nominal_value
    1.0
    >>> Axis("mass", 0.1, 10.0, "kg", values="logarithmic").nominal_value
    1.0
    >>> Axis("surface", values=["dry", "wet"]).nominal_value
    'dry'
    >>> Axis("surface", values=["dry", "wet"], nominal="wet").nominal
    1.0
    >>> depth = Axis("depth", 0.0, 0.2, "m", nominal=0.0, when={"surface": ["wet"]})
    """

    name: str
    low: float = 0.0
    high: float = 0.0
    unit: str = ""
    values: str | Sequence[str] = "continuous"
    nominal: float | str | None = None
    kind: str = "start"
    meaning: str = ""
    apply: Application | None = None
    drawn_from: float = 0.0
    when: Mapping[str, Sequence[Value] | Except] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.name or not self.name.isprintable():
            raise InvalidValueError(
                f"the name of an axis must be printable and not empty, got {self.name!r}"
            )
        if isinstance(self.values, str):
            if self.values not in ("continuous", "logarithmic", "integer"):
                raise InvalidValueError(
                    f"axis `{self.name}` has the values {self.values!r}; expected 'continuous', "
                    "'logarithmic', 'integer' or a list of names"
                )
            self._check_nominal()
            return
        if len(self.values) < 2 or len(set(self.values)) != len(self.values):
            raise InvalidValueError(
                f"axis `{self.name}` needs at least two different names, got {list(self.values)!r}"
            )
        object.__setattr__(self, "low", 0.0)
        object.__setattr__(self, "high", float(len(self.values) - 1))
        if isinstance(self.nominal, str):
            object.__setattr__(self, "nominal", self.number(self.nominal))
        self._check_nominal()

    def _check_nominal(self) -> None:
        if self.nominal is None:
            return
        if isinstance(self.nominal, str):
            raise InvalidValueError(
                f"the nominal value of axis `{self.name}` is {self.nominal!r}; the axis has no "
                "names"
            )
        is_whole = self.values in ("continuous", "logarithmic") or float(self.nominal).is_integer()
        if not (self.low <= self.nominal <= self.high and is_whole):
            raise InvalidValueError(
                f"the nominal value of axis `{self.name}` is {self.nominal}; it must be "
                f"{'' if is_whole else 'a whole number '}from {self.low:g} to {self.high:g}"
            )

    @property
    def nominal_value(self) -> Value:
        """Value in an undisturbed episode, as the system receives it: a float, an integer or a
        name."""
        return self.value(self.nominal_number)

    @property
    def nominal_number(self) -> float:
        """Number of the value in an undisturbed episode. Names are numbered from 0."""
        if self.nominal is not None:
            return float(self.nominal)
        if not isinstance(self.values, str):
            return self.low
        if self.values == "logarithmic":
            return math.sqrt(self.low * self.high)
        middle = self.low * 0.5 + self.high * 0.5
        return float(math.floor(middle)) if self.values == "integer" else middle

    def number(self, value: Value) -> float:
        """Returns the number of a value: the index of a name.

        >>> Axis("surface", values=["dry", "wet"]).number("wet")
        1.0
        """
        if isinstance(value, str):
            if isinstance(self.values, str) or value not in self.values:
                names = (
                    "it has no names" if isinstance(self.values, str)
                    else f"expected one of {list(self.values)!r}"
                )
                raise InvalidValueError(f"axis `{self.name}` has no value {value!r}; {names}")
            return self.low + self.values.index(value)
        return float(value)

    def value(self, number: float) -> Value:
        """Returns the value of a number, as the system receives it.

        >>> Axis("surface", values=["dry", "wet"]).value(1.0), Axis(
        ...     "delay", 0, 3, values="integer"
        ... ).value(2.0)
        ('wet', 2)
        """
        if not isinstance(self.values, str):
            return self.values[int(number - self.low)]
        return int(number) if self.values == "integer" else number

    @classmethod
    def from_document(cls, given: Mapping[str, Any], apply: Application | None = None) -> "Axis":
        """Returns an axis of the extension module. A setting can have left it one value only."""
        when = {
            name: Except(levels["except"]) if isinstance(levels, Mapping) else levels
            for name, levels in given["when"]
        }
        axis = object.__new__(cls)
        for name, value in {**given, "apply": apply, "when": when}.items():
            object.__setattr__(axis, name, value)
        return axis

    def to_document(self) -> dict[str, Any]:
        """Returns the axis as the extension module takes it."""
        values = self.values if isinstance(self.values, str) else list(self.values)
        when = [
            (name, {"except": level.value} if isinstance(level, Except) else list(level))
            for name, level in self.when.items()
        ]
        return {
            "name": self.name, "low": float(self.low), "high": float(self.high), "unit": self.unit,
            "values": values, "nominal": self.nominal_number, "kind": self.kind,
            "meaning": self.meaning, "drawn_from": self.drawn_from, "when": when
        }


def axes_document(space: Sequence[Axis]) -> str:
    """Returns the axes of a space as the extension module takes them."""
    return document([axis.to_document() for axis in space])


_SEGMENT = re.compile(r"([A-Za-z_]\w*)((?:\[\s*-?\d+\s*(?:,\s*-?\d+\s*)*\])*)")


@lru_cache(maxsize=1024)
def parse_path(path: str) -> tuple[tuple[str, tuple[Any, ...]], ...]:
    """Splits a path of attributes and indexes.

    >>> parse_path("model.geom_friction[0, 1]")
    (('model', ()), ('geom_friction', ((0, 1),)))
    """
    segments = []
    for part in re.split(r"\.(?![^\[]*\])", path):
        match = _SEGMENT.fullmatch(part.strip())
        if match is None:
            raise InvalidValueError(
                f"{path!r} is not a path of attributes and indexes such as 'data.qpos[2]'"
            )
        groups = re.findall(r"\[([^\]]*)\]", match.group(2))
        indexes = [tuple(int(number) for number in group.split(",")) for group in groups]
        segments.append(
            (match.group(1), tuple(index[0] if len(index) == 1 else index for index in indexes))
        )
    return tuple(segments)


def follower(segments: Sequence[tuple[str, tuple[Any, ...]]]) -> Callable[[Any], Any]:
    """Returns the function from an object to the value at a path. A name after a dictionary is a
    key of it.

    >>> follower(parse_path("goal.position[1]"))({"goal": {"position": [0.5, 0.25]}})
    0.25
    """

    def follow(start: Any) -> Any:
        for name, indexes in segments:
            start = start[name] if isinstance(start, Mapping) else getattr(start, name)
            for index in indexes:
                start = start[index]
        return start

    return follow
