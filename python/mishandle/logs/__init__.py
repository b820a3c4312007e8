"""Formulas of signal temporal logic, and recorded traces: logs, data sets, recordings of robots."""

from mishandle.logs.formulas import Formula, robustness
from mishandle.logs.online import OnlineMonitor
from mishandle.logs.recordings import Log, Topic, read_log, read_logs
from mishandle.logs.requirements import FormulaDescription, Mining, formula, mine, pattern
from mishandle.logs.verdicts import Monitoring, monitor

__all__ = [
    "Formula", "FormulaDescription", "Log", "Mining", "Monitoring", "OnlineMonitor", "Topic",
    "formula", "mine", "monitor", "pattern", "read_log", "read_logs", "robustness",
]
