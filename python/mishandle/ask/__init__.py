"""The questions: each simulates a system and returns a result."""

from mishandle.ask.bisections import Bisection, bisect
from mishandle.ask.checks import Check, check
from mishandle.ask.demonstrations import record
from mishandle.ask.falsification import Evaluation, Exports, Falsification, evaluate, falsify
from mishandle.ask.hardening import Hardening, harden
from mishandle.ask.margins import Margin, margin
from mishandle.ask.relations import Metamorphic, metamorphic
from mishandle.ask.requirement_tests import requirement
from mishandle.ask.risks import Risk, risk
from mishandle.ask.searches import Minimum, Objective, Search, find_minimum, search_names
from mishandle.ask.simulations import Replay, regress, repeat, replay, simulate
from mishandle.ask.versions import compare_versions, sample_size

__all__ = [
    "Bisection", "Check", "Evaluation", "Exports", "Falsification", "Hardening", "Margin",
    "Metamorphic", "Minimum", "Objective", "Replay", "Risk", "Search", "bisect",
    "check", "compare_versions", "evaluate", "falsify", "find_minimum", "harden", "margin",
    "metamorphic", "record", "regress", "repeat", "replay", "requirement", "risk",
    "sample_size", "search_names", "simulate",
]
