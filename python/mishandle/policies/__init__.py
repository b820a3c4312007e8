"""Policies: controllers, networks of other libraries, functions, servers; and their guards."""

from mishandle.policies.controllers import Controller, load_controller
from mishandle.policies.guards import Guard, Guarded
from mishandle.policies.observations import Resized
from mishandle.policies.servers import PolicyServer

__all__ = ["Controller", "Guard", "Guarded", "PolicyServer", "Resized", "load_controller"]
