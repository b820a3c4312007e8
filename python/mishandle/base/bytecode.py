"""Code objects: their content, and the names that they look up."""

import dis
import hashlib
import types
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any


@dataclass
class References:
    """Names that a function, with the functions inside of it, looks up."""

    names: set[str] = field(default_factory=set)
    """Global variables."""
    attributes: set[str] = field(default_factory=set)
    """Attributes of any object."""
    stored: set[str] = field(default_factory=set)
    """Attributes that it sets."""
    imports: set[tuple[str, int]] = field(default_factory=set)
    """Modules that it imports, with the level of a relative import."""
    texts: set[str] = field(default_factory=set)
    """Constants that are texts."""


@lru_cache(maxsize=4096)
def references(code: types.CodeType) -> References:
    """Returns the names that a code object looks up.

    >>> found = references((lambda s: math.sqrt(gain * s)).__code__)
    >>> sorted(found.names), sorted(found.attributes)
    (['gain', 'math'], ['sqrt'])
    """
    found = References()
    level: Any = 0
    constant: Any = None
    for instruction in dis.get_instructions(code):
        name, value = instruction.opname, instruction.argval
        if name in ("LOAD_GLOBAL", "LOAD_NAME"):
            found.names.add(value)
        elif name in ("LOAD_ATTR", "LOAD_METHOD", "IMPORT_FROM", "LOAD_SUPER_ATTR"):
            found.attributes.add(value)
        elif name == "STORE_ATTR":
            found.stored.add(value)
        elif name == "IMPORT_NAME":
            found.imports.add((value, level if isinstance(level, int) else 0))
        if name.startswith("LOAD_CONST") or name == "LOAD_SMALL_INT":
            # An import follows its level and its list of names.
            level, constant = constant, value
    for each in code.co_consts:
        if isinstance(each, types.CodeType):
            inner = references(each)
            for field_name in vars(found):
                getattr(found, field_name).update(getattr(inner, field_name))
        elif isinstance(each, str):
            found.texts.add(each)
    return found


def content(code: types.CodeType) -> bytes:
    """Returns what a code object does: without names of files, line numbers and the order of
    sets."""
    digest = hashlib.sha256(code.co_code)
    counts = (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags)
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    digest.update(repr((counts, names)).encode())
    digest.update(getattr(code, "co_exceptiontable", b""))
    for constant in code.co_consts:
        digest.update(_constant(constant))
    return digest.digest()


def _constant(value: Any) -> bytes:
    if isinstance(value, types.CodeType):
        return content(value)
    if isinstance(value, tuple):
        return b"(" + b",".join(map(_constant, value)) + b")"
    if isinstance(value, frozenset):
        return b"{" + b",".join(sorted(map(_constant, value))) + b"}"
    return f"{type(value).__name__} {value!r};".encode("utf-8", "surrogatepass")
