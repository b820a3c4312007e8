"""Which code is a library, the versions of libraries, and packages that may be missing."""

import contextlib
import functools
import importlib.metadata
import os
import platform
import sys
import sysconfig
from collections.abc import Iterator

from mishandle.errors import MissingPackageError

UNKNOWN = "unknown"
"""Version of a package that states none."""


@contextlib.contextmanager
def needed(text: str, extra: str | None = None) -> Iterator[None]:
    """Imports of optional packages: a missing one is an error with this text, which says how to
    install it, or with the command that installs an extra."""
    try:
        yield
    except ImportError as error:
        raise MissingPackageError(text, extra) from error


@functools.cache
def is_library(module: str) -> bool:
    """Returns whether a module is a library: Python's own, or installed in a folder of packages.

    >>> is_library("json"), is_library("numpy.linalg"), is_library("__main__")
    (True, True, False)
    """
    top = module.partition(".")[0]
    if module == "__main__":
        return False
    if top == "mishandle" or top in sys.builtin_module_names:
        return True
    found = sys.modules.get(module) or sys.modules.get(top)
    file = getattr(found, "__file__", None)
    if not isinstance(file, str):
        return top in sys.stdlib_module_names
    path = os.path.realpath(file)
    if {"site-packages", "dist-packages"} & set(path.split(os.sep)):
        return True
    return any(path.startswith(folder + os.sep) for folder in _folders())


@functools.cache
def _folders() -> list[str]:
    known = ("stdlib", "platstdlib", "purelib", "platlib")
    return sorted({os.path.realpath(sysconfig.get_path(name)) for name in known})


@functools.cache
def package_of(module: str) -> tuple[str, str] | None:
    """Returns name and version of the package of a library; ``None`` for Mishandle, whose build a
    run records.

    >>> package_of("math")[0], package_of("numpy.linalg")[0], package_of("mishandle.scenarios.axes")
    ('python', 'numpy', None)
    """
    top = module.partition(".")[0]
    if top == "mishandle":
        return None
    if top in sys.builtin_module_names or top in sys.stdlib_module_names:
        return "python", platform.python_version()
    try:
        return top, importlib.metadata.version(top)
    except importlib.metadata.PackageNotFoundError:
        pass
    stated = getattr(sys.modules.get(top), "__version__", None)
    if isinstance(stated, str):
        return top, stated
    names = _distributions().get(top, [])
    return top, importlib.metadata.version(names[0]) if names else UNKNOWN


@functools.cache
def _distributions() -> dict[str, list[str]]:
    return {
        name: sorted(found) for name, found in importlib.metadata.packages_distributions().items()
    }
