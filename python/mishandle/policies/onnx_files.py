"""What an ONNX file contains, read without the package ``onnx``."""

import pathlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Union

from mishandle.errors import InvalidValueError

_MESSAGES: dict[str, dict[int, str]] = {
    "model": {7: "graph", 25: "function"},
    "graph": {1: "node", 5: "tensor"},
    "function": {7: "node"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph"},
    "tensor": {13: "entry"},
}
"""Fields of each kind of message of ``onnx.proto`` that contain messages with operators or names of
files."""

RANDOM = (
    "RandomNormal", "RandomNormalLike", "RandomUniform", "RandomUniformLike", "Bernoulli",
    "Multinomial"
)
"""Operators that draw random numbers."""

_Field = Union[int, memoryview]


@dataclass
class Contents:
    """Contents of a model, its subgraphs and functions."""

    random: list[str] = field(default_factory=list)
    """Operators that draw random numbers."""
    training: list[str] = field(default_factory=list)
    """Operators in training mode."""
    files: set[str] = field(default_factory=set)
    """Names of other files that contain weights."""


def contents(data: bytes) -> Contents:
    """Reads a model. Messages may be nested to any depth."""
    found = Contents()
    waiting: list[tuple[str, memoryview]] = [("model", memoryview(data))]
    while waiting:
        kind, message = waiting.pop()
        inside = _MESSAGES.get(kind, {})
        fields = list(_fields(message))
        waiting += [
            (inside[number], value) for number, value in fields
            if number in inside and isinstance(value, memoryview)
        ]
        if kind == "node":
            _add_operator(found, fields)
        elif kind == "entry" and _text(fields, 1) == "location":
            found.files.add(_text(fields, 2))
    return found


def model_files(path: pathlib.Path) -> list[pathlib.Path]:
    """Returns the files that determine what a model computes: itself, its side file and its
    weights."""
    others = sorted(contents(path.read_bytes()).files) if path.suffix == ".onnx" else []
    files = [path, path.with_name(path.name + ".json"), *(path.parent / name for name in others)]
    return [file for file in files if file == path or file.is_file()]


def _add_operator(found: Contents, fields: list[tuple[int, _Field]]) -> None:
    operator = _text(fields, 4)
    if operator in RANDOM:
        found.random.append(operator)
    attributes = [
        list(_fields(value)) for number, value in fields
        if number == 5 and isinstance(value, memoryview)
    ]
    inputs = [
        bytes(value) for number, value in fields if number == 1 and isinstance(value, memoryview)
    ]
    is_trained = any(
        _text(each, 1) == "training_mode" and dict(each).get(3) == 1 for each in attributes
    )
    # The third input of Dropout, which an exporter writes in training mode only.
    if operator == "Dropout" and any(inputs[2:]) or operator == "BatchNormalization" and is_trained:
        found.training.append(operator)


def _text(fields: list[tuple[int, _Field]], number: int) -> str:
    values = [value for found, value in fields if found == number and isinstance(value, memoryview)]
    return bytes(values[-1]).decode(errors="replace") if values else ""


def _fields(message: memoryview) -> Iterator[tuple[int, _Field]]:
    """Yields the numbered fields of a message in the format of protocol buffers: numbers, and
    bytes."""
    place = 0
    while place < len(message):
        key, place = _number(message, place)
        kind = key & 7
        if kind == 0:
            value, place = _number(message, place)
            yield key >> 3, value
            continue
        length = {1: 8, 5: 4}.get(kind)
        if kind == 2:
            length, place = _number(message, place)
        if length is None or place + length > len(message):
            raise _damaged()
        if kind == 2:
            yield key >> 3, message[place : place + length]
        place += length


def _number(message: memoryview, place: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if place >= len(message):
            raise _damaged()
        byte = message[place]
        place += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, place
    raise _damaged()


def _damaged() -> InvalidValueError:
    return InvalidValueError("it is damaged or not in the format of protocol buffers")
