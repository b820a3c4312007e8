"""Finds scenarios in which a robot controller fails."""

from mishandle._native import VectorEnv, __version__
from mishandle.axes import Attribute, Axis, ResetOption
from mishandle.campaign import (
    Corner,
    Evaluation,
    Falsification,
    Replay,
    Trial,
    evaluate,
    falsify,
    replay,
    simulate,
)
from mishandle.controllers import Controller, load_controller
from mishandle.envs import TaskEnv, TaskVectorEnv, register
from mishandle.errors import (
    InvalidScenario,
    InvalidStateError,
    InvalidTypeError,
    InvalidValueError,
    MishandleError,
    MissingPackageError,
)
from mishandle.explanations import ComparedPair, Comparison, Estimate, Explanation, FailureMode, compare
from mishandle.formulas import Formula, robustness
from mishandle.plots import plot_robustness_map, plot_search_progress, plot_trace
from mishandle.ray import RayExecutor
from mishandle.runs import Run, open_run
from mishandle.searches import Minimum, Search, minimize, search_names
from mishandle.targets import Simulation

__all__ = [
    "Attribute",
    "Axis",
    "ComparedPair",
    "Comparison",
    "Controller",
    "Corner",
    "Estimate",
    "Evaluation",
    "Explanation",
    "FailureMode",
    "Falsification",
    "Formula",
    "InvalidScenario",
    "InvalidStateError",
    "InvalidTypeError",
    "InvalidValueError",
    "Minimum",
    "MishandleError",
    "MissingPackageError",
    "RayExecutor",
    "Replay",
    "ResetOption",
    "Run",
    "Search",
    "Simulation",
    "TaskEnv",
    "TaskVectorEnv",
    "Trial",
    "VectorEnv",
    "__version__",
    "compare",
    "evaluate",
    "falsify",
    "load_controller",
    "minimize",
    "open_run",
    "plot_robustness_map",
    "plot_search_progress",
    "plot_trace",
    "replay",
    "robustness",
    "search_names",
    "simulate",
]

register()
