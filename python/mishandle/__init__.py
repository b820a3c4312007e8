"""Finds scenarios in which a robot controller fails."""

from mishandle import lerobot, plots, sb3
from mishandle._native import __version__
from mishandle.ask import (
    bisect, check, compare_versions, evaluate, falsify, harden, margin, metamorphic,
    record, regress, repeat, replay, requirement, risk, sample_size, simulate,
)
from mishandle.base.containment import register_child
from mishandle.cluster import RayExecutor
from mishandle.errors import InvalidScenario, MishandleError
from mishandle.logs import Formula, OnlineMonitor, formula, mine, monitor, read_log, robustness
from mishandle.policies import Controller, Guard, PolicyServer, load_controller
from mishandle.runs import compare, evidence, open_run
from mishandle.scenarios import Attribute, Axis, PolicyArgument, ResetOption
from mishandle.systems import Process, ScenarioEnv, TaskEnv, TaskVectorEnv
from mishandle.systems.fault_axes import faults
from mishandle.systems.image_axes import sight
from mishandle.systems.task_environments import register

__all__ = [
    "Attribute",
    "Axis",
    "Controller",
    "Formula",
    "Guard",
    "InvalidScenario",
    "MishandleError",
    "OnlineMonitor",
    "PolicyArgument",
    "PolicyServer",
    "Process",
    "RayExecutor",
    "ResetOption",
    "ScenarioEnv",
    "TaskEnv",
    "TaskVectorEnv",
    "__version__",
    "bisect",
    "check",
    "compare",
    "compare_versions",
    "evaluate",
    "evidence",
    "falsify",
    "faults",
    "formula",
    "harden",
    "lerobot",
    "load_controller",
    "margin",
    "metamorphic",
    "mine",
    "monitor",
    "open_run",
    "plots",
    "read_log",
    "record",
    "regress",
    "repeat",
    "replay",
    "requirement",
    "risk",
    "robustness",
    "sample_size",
    "sb3",
    "sight",
    "simulate",
]

register()
register_child()
