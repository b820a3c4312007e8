"""Targets, run files, and what is read from them."""

from mishandle.runs.documents import RunOptions
from mishandle.runs.evidence_folders import evidence, verify_evidence
from mishandle.runs.explanations import Comparison, Explanation, compare, diff
from mishandle.runs.rerun_files import to_rerun
from mishandle.runs.run_files import Run, open_run
from mishandle.runs.targets import ControllerOptions, Simulation, TargetOptions

__all__ = [
    "Comparison", "ControllerOptions", "Explanation", "Run", "RunOptions", "Simulation",
    "TargetOptions", "compare", "diff", "evidence", "open_run", "to_rerun", "verify_evidence",
]
