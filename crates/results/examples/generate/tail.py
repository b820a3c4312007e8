def build(kind: type[_T], document: Mapping[str, Any]) -> _T:
    """Makes a result of a type from a parsed document.

    Seeds become integers, infinities numbers, arrays tuples. A scenario has the names of categories, and leaves out values that are
    drawn at random. Keys that the type does not have are ignored: a later version
    of the program may have added them.
    """
    return _build(kind, _named(document, {}))


def _build(kind: type[_T], document: Mapping[str, Any]) -> _T:
    fields, hints = dataclasses.fields(cast("Any", kind)), _hints(cast("Any", kind))
    known = [field.name for field in fields if field.name in document]
    return kind(**{name: _value(hints[name], document[name]) for name in known})


@functools.lru_cache(maxsize=None)
def _hints(kind: Any) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def _named(value: Any, axes: Mapping[str, Any]) -> Any:
    """Returns a part of a document with the values of axes as Python has them. ``axes`` are the facts of each axis."""
    if isinstance(value, list):
        return [_named(item, axes) for item in value]
    if not isinstance(value, Mapping):
        return value
    if "space_axes" in value:
        axes = {axis["name"]: axis for axis in value["space_axes"]}
    named = {key: _named(item, axes) for key, item in value.items()}
    if isinstance(named.get("scenario"), dict):
        drawn = named["scenario"].items()
        named["scenario"] = {axis: _axis_value(axes.get(axis), number) for axis, number in drawn if number is not None}
    if isinstance(named.get("region"), dict):
        regions = named["region"].items()
        named["region"] = {axis: ends and [_axis_value(axes.get(axis), end) for end in ends] for axis, ends in regions}
    return named


def _axis_value(axis: Mapping[str, Any] | None, number: float) -> Value:
    values = None if axis is None else axis["values"]
    if axis is not None and isinstance(values, list):
        # The first name is that of the lower bound.
        return cast("str", values[int(number - axis["low"])])
    return int(number) if values == "integer" else number


def _value(hint: Any, value: Any) -> Any:
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if value is None:
        return None
    if origin is typing.Union or origin is types.UnionType:
        return _alternative([kind for kind in arguments if kind is not type(None)], value)
    if origin is tuple:
        items = arguments[:1] * len(value) if Ellipsis in arguments else arguments
        return tuple(_value(kind, item) for kind, item in zip(items, value, strict=True))
    if origin is dict:
        return {name: _value(arguments[1], item) for name, item in value.items()}
    if dataclasses.is_dataclass(hint):
        return _build(cast("type[Any]", hint), value)
    # Seeds and infinities are strings.
    return hint(value) if hint in (int, float) else value


def _alternative(kinds: Sequence[Any], value: Any) -> Any:
    if len(kinds) == 1:
        return _value(kinds[0], value)
    if isinstance(value, Mapping):
        return _build(next(kind for kind in kinds if _has_keys(kind, cast("Mapping[str, Any]", value))), value)
    return _frozen(value)


def _has_keys(kind: Any, document: Mapping[str, Any]) -> bool:
    required = [field.name for field in dataclasses.fields(kind) if field.default is dataclasses.MISSING]
    return all(name in document for name in required)


def _frozen(value: Any) -> Any:
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value
