"""Messages with NumPy arrays in msgpack, as policy servers send and read them."""

import math
from dataclasses import dataclass
from typing import Any, Union

import numpy as np
from numpy.typing import NDArray

from mishandle.base.packages import needed

MAX_MESSAGE = 2**26
"""Largest message from a server, in bytes."""

_KINDS = "biuf"
"""Kinds of numbers that an array may have: Booleans, integers and floats."""

_Key = Union[str, bytes]


@dataclass(frozen=True)
class Encoding:
    """How a message contains an array: as a dictionary with its bytes, type and shape.

    Arrays are copied byte for byte. No other Python object can be in a message, so that reading one
    runs no code.
    """

    has_binary_keys: bool
    """Whether the keys of this dictionary are bytes, as in msgpack-numpy. NumPy scalars have a
    dictionary, too, then; otherwise they are plain numbers."""

    def pack(self, message: Any) -> bytes:
        """Returns the bytes of a message: dictionaries, lists, texts, numbers and arrays of
        numbers.

        >>> MSGPACK_NUMPY.unpack(MSGPACK_NUMPY.pack({"state": np.array([0.5, 1.5])}))
        {'state': array([0.5, 1.5])}
        """
        packed: bytes = _msgpack().packb(message, default=self._encoded)
        return packed

    def unpack(self, data: bytes) -> Any:
        """Returns the message of these bytes. Raises an exception if they are none, or if an array
        does not fit its shape."""
        return _msgpack().unpackb(data, object_hook=self._decoded, strict_map_key=False)

    def _key(self, name: str) -> _Key:
        return name.encode() if self.has_binary_keys else name

    def _encoded(self, value: Any) -> Any:
        if not isinstance(value, (np.ndarray, np.generic)):
            raise TypeError(
                f"a {type(value).__name__} cannot be sent to a policy server; expected numbers, "
                "texts, arrays or dictionaries"
            )
        if isinstance(value, np.ndarray):
            if value.dtype.kind not in _KINDS:
                raise TypeError(
                    f"an array of the type {value.dtype} cannot be sent to a policy server; "
                    "expected numbers"
                )
            return self._of_array(value)
        return self._of_scalar(value) if self.has_binary_keys else value.item()

    def _of_array(self, value: NDArray[Any]) -> dict[_Key, Any]:
        return {
            self._key("__ndarray__"): True,
            self._key("data"): value.tobytes(),
            self._key("dtype"): value.dtype.str,
            self._key("shape"): value.shape,
        }

    def _of_scalar(self, value: np.generic) -> dict[_Key, Any]:
        return {
            self._key("__npgeneric__"): True, self._key("data"): value.item(),
            self._key("dtype"): value.dtype.str
        }

    def _decoded(self, value: dict[Any, Any]) -> Any:
        if self._key("__ndarray__") in value:
            data, shape = value[self._key("data")], value[self._key("shape")]
            dtype = _dtype(value[self._key("dtype")])
            if (
                not all(isinstance(size, int) and size >= 0 for size in shape)
                or len(data) != math.prod(shape) * dtype.itemsize
            ):
                raise ValueError(
                    f"an array of the shape {shape} and the type {dtype} has {len(data)} bytes"
                )
            return np.ndarray(shape, dtype, buffer=data)
        if self.has_binary_keys and b"__npgeneric__" in value:
            return _dtype(value[b"dtype"]).type(value[b"data"])
        return value


MSGPACK_NUMPY = Encoding(has_binary_keys=True)
"""The encoding of openpi."""

TEXT_KEYS = Encoding(has_binary_keys=False)
"""The encoding of vla-eval."""


def _dtype(name: Any) -> np.dtype[Any]:
    dtype = np.dtype(name) if isinstance(name, str) else None
    if dtype is None or dtype.kind not in _KINDS:
        raise ValueError(f"an array has the type {name!r}; expected numbers")
    return dtype


def _msgpack() -> Any:
    with needed("policy servers need msgpack and websockets: pip install msgpack websockets"):
        import msgpack
    return msgpack
