"""The process that tries models of others before this process compiles them: MuJoCo can end a
process."""

import os
import sys

import mishandle._native as _native

_CHILD = """
import sys
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_loader
loader = ExtensionFileLoader("mishandle._native", sys.argv[1])
module = module_from_spec(spec_from_loader("mishandle._native", loader))
loader.exec_module(module)
sys.exit(module.run_child())
"""
"""Loads the extension module alone: it starts in milliseconds, and no folder is searched for
modules."""


def register_child() -> None:
    """Registers this interpreter as the program that tries models.

    An interpreter inside another program has no executable. Models are compiled in its process
    only.
    """
    if sys.executable:
        # `-I` ignores the working directory and the environment, `-S` the installed packages.
        module = os.path.abspath(_native.__file__)
        _native.set_child_program([sys.executable, "-I", "-S", "-c", _CHILD, module])
