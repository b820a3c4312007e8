def build(kind: type[_T], document: Mapping[str, Any]) -> _T:
    """Makes a result of a type from a parsed document.

    Seeds become integers, infinities numbers, arrays tuples. Keys that the type does not have are ignored: a later version
    of the program may have added them.
    """
    hints = typing.get_type_hints(kind)
    fields = dataclasses.fields(cast("Any", kind))
    known = [field.name for field in fields if field.name in document]
    return kind(**{name: _value(hints[name], document[name]) for name in known})


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
        return build(cast("type[Any]", hint), value)
    # Seeds and infinities are strings.
    return hint(value) if hint in (int, float) else value


def _alternative(kinds: Sequence[Any], value: Any) -> Any:
    if len(kinds) == 1:
        return _value(kinds[0], value)
    if isinstance(value, Mapping):
        return build(next(kind for kind in kinds if _has_keys(kind, cast("Mapping[str, Any]", value))), value)
    return _frozen(value)


def _has_keys(kind: Any, document: Mapping[str, Any]) -> bool:
    required = [field.name for field in dataclasses.fields(kind) if field.default is dataclasses.MISSING]
    return all(name in document for name in required)


def _frozen(value: Any) -> Any:
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value
