"""The packages of the extra ``gpu``."""

import importlib
from typing import Any

from mishandle.errors import MissingPackageError


def load(*names: str) -> list[Any]:
    """Returns Warp and modules that need the extra. They have no types."""
    try:
        warp: Any = importlib.import_module("warp")
        # It writes to stdout, also while others import it.
        warp.config.log_level = warp.LOG_ERROR
        return [warp, *map(importlib.import_module, names)]
    except ImportError as error:
        raise MissingPackageError(f"the device gpu needs an extra ({error})", "gpu") from error
