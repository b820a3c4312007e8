"""Scenarios: axes, and how their values reach an environment and its policy."""

from mishandle.scenarios.axes import Attribute, Axis, Except, PolicyArgument, ResetOption

__all__ = ["Attribute", "Axis", "Except", "PolicyArgument", "ResetOption"]
