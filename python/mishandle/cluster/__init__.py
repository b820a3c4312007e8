"""Simulation on a Ray cluster. The command ``python3 -m mishandle.cluster`` completes the runs of a
campaign on one."""

from mishandle.cluster.executors import RayExecutor

__all__ = ["RayExecutor"]
