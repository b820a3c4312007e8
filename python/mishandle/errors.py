"""Exceptions of the package. All have the base :class:`MishandleError`."""


class MishandleError(Exception):
    """Base class of the package's exceptions. It is raised itself where no subclass fits, for
    instance for a run file of another system."""


class InvalidValueError(MishandleError, ValueError):
    """A name, number, formula or path is invalid."""


class InvalidTypeError(MishandleError, TypeError):
    """An argument has the wrong type."""


class InvalidStateError(MishandleError, RuntimeError):
    """The call is not possible in this process or thread, or not yet."""


class MissingPackageError(MishandleError, ImportError):
    """An optional package is not installed. The message contains the command that installs it."""

    def __init__(self, text: str, extra: str | None = None) -> None:
        advice = "" if extra is None else f": pip install '.[{extra}]' in a clone of Mishandle"
        super().__init__(text + advice)


class PolicyServerError(MishandleError, RuntimeError):
    """A policy server cannot be reached, reports an error, or sends something else than actions."""


class InvalidScenario(MishandleError):
    """Raise it in a system or its reset if it cannot start from the scenario."""


class TimeLimitExceeded(BaseException):
    """The simulation took longer than its time limit. It is no ``Exception``, so that ``except
    Exception`` in a system does not swallow it."""
