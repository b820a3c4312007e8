"""Finds scenarios in which a robot controller fails."""

from mishandle import lerobot, sb3
from mishandle._native import TrainingEpisodes, __version__
from mishandle.axes import Attribute, Axis, Except, PolicyArgument, ResetOption
from mishandle.bisections import Bisection, bisect
from mishandle.checks import Check, check
from mishandle.containment import register_child
from mishandle.controllers import Controller, load_controller
from mishandle.demonstrations import record
from mishandle.errors import (
    InvalidScenario,
    InvalidStateError,
    InvalidTypeError,
    InvalidValueError,
    MishandleError,
    MissingPackageError,
    PolicyServerError,
)
from mishandle.evidence_folders import evidence, verify_evidence
from mishandle.explanations import Comparison, Explanation, compare, diff
from mishandle.falsification import Evaluation, Exports, Falsification, evaluate, falsify
from mishandle.fault_axes import faults
from mishandle.formulas import Formula, robustness
from mishandle.log_verdicts import Monitoring, monitor
from mishandle.requirements import FormulaDescription, Mining, formula, mine, pattern
from mishandle.logs import Log, Topic, read_log, read_logs
from mishandle.margins import Margin, margin
from mishandle.guards import Guard, Guarded
from mishandle.hardening import Hardening, harden
from mishandle.image_axes import sight
from mishandle.limits import TimeLimitExceeded
from mishandle.objectives import Objective
from mishandle.online import OnlineMonitor
from mishandle.plots import plot_comparison, plot_robustness_map, plot_search_progress, plot_survival, plot_trace
from mishandle.policy_servers import PolicyServer
from mishandle.processes import Process
from mishandle.ray import RayExecutor
from mishandle.reductions import Reduced
from mishandle.relations import Metamorphic, Relation, metamorphic
from mishandle.requirement_tests import requirement
from mishandle.rerun_files import to_rerun
from mishandle.results import ComparedPair, Estimate, FailureMode, Regression, Repeats, Trial, Witness
from mishandle.risks import Risk, risk
from mishandle.runs import Run, open_run
from mishandle.scenario_environments import ScenarioEnv
from mishandle.searches import Minimum, Search, find_minimum, search_names
from mishandle.server_requests import Resized
from mishandle.simulations import Replay, regress, repeat, replay, simulate
from mishandle.targets import Simulation
from mishandle.task_environments import TaskEnv, TaskVectorEnv, register
from mishandle.versions import compare_versions, sample_size

__all__ = [
    "Attribute",
    "Axis",
    "Bisection",
    "Check",
    "ComparedPair",
    "Comparison",
    "Controller",
    "Estimate",
    "Evaluation",
    "Except",
    "Explanation",
    "Exports",
    "FailureMode",
    "Falsification",
    "Formula",
    "FormulaDescription",
    "Guard",
    "Guarded",
    "Hardening",
    "InvalidScenario",
    "InvalidStateError",
    "InvalidTypeError",
    "InvalidValueError",
    "Log",
    "Margin",
    "Metamorphic",
    "Minimum",
    "MishandleError",
    "Mining",
    "MissingPackageError",
    "Monitoring",
    "Objective",
    "OnlineMonitor",
    "PolicyArgument",
    "PolicyServer",
    "Process",
    "PolicyServerError",
    "RayExecutor",
    "Reduced",
    "Regression",
    "Relation",
    "Repeats",
    "Replay",
    "ResetOption",
    "Resized",
    "Risk",
    "Run",
    "ScenarioEnv",
    "Search",
    "Simulation",
    "TimeLimitExceeded",
    "TaskEnv",
    "TaskVectorEnv",
    "Topic",
    "TrainingEpisodes",
    "Trial",
    "Witness",
    "__version__",
    "bisect",
    "check",
    "compare",
    "compare_versions",
    "diff",
    "evaluate",
    "evidence",
    "falsify",
    "faults",
    "find_minimum",
    "formula",
    "harden",
    "lerobot",
    "load_controller",
    "margin",
    "metamorphic",
    "mine",
    "monitor",
    "open_run",
    "pattern",
    "plot_comparison",
    "plot_robustness_map",
    "plot_search_progress",
    "plot_survival",
    "plot_trace",
    "read_log",
    "read_logs",
    "record",
    "regress",
    "repeat",
    "replay",
    "requirement",
    "risk",
    "robustness",
    "sample_size",
    "sb3",
    "search_names",
    "sight",
    "simulate",
    "to_rerun",
    "verify_evidence",
]

register()
register_child()
