"""The command ``mishandle``, which the package installs: the program of the same name, with
simulations on a GPU."""

import signal
import sys

from mishandle._native import run_command


def main() -> int:
    """Runs the command line and returns its exit code."""
    # The program handles Ctrl-C itself. Python's handler would only act after the end of the
    # program.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return run_command(["mishandle", *sys.argv[1:]])
