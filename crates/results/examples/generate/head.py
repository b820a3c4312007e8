"""The results of all questions, as the command line prints them with ``--json``.

Written by ``cargo xtask results``; change the Rust types instead.
``build`` makes a result from a parsed document.
"""

from __future__ import annotations

import dataclasses
import functools
import types
import typing
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, cast

Value = float | int | str
"""Value of an axis: a number, a whole number of an integer axis, or the name of a category."""

_T = TypeVar("_T")
