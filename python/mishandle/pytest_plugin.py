"""The plugin for pytest: tests with :func:`mishandle.requirement`. Only pytest imports this
module."""

import hashlib
import pathlib
import re
import shlex
import traceback
from typing import Any

import pytest

from mishandle.ask.requirement_tests import (
    ATTRIBUTE, Limits, Outcome, Requirement, Test, tested
)
from mishandle.errors import InvalidTypeError, MishandleError

FOLDER = ".mishandle"


def pytest_addoption(parser: Any) -> None:
    group = parser.getgroup("mishandle", "requirements of mishandle")
    group.addoption(
        "--mishandle-budget", type=_positive, metavar="N",
        help="largest number of simulations of each search"
    )
    group.addoption(
        "--mishandle-seed", type=_natural, metavar="N", help="random seed of all searches"
    )
    group.addoption(
        "--mishandle-no-cache", action="store_true", help="simulate also what did not change"
    )
    group.addoption(
        "--mishandle-replay", action="store_true", help="simulate only the known counterexamples"
    )
    parser.addini(
        "mishandle_budget", "largest number of simulations of a search without a budget of its own",
        default="300"
    )
    parser.addini(
        "mishandle_seed", "random seed of a search without a seed of its own", default="0"
    )
    parser.addini(
        "mishandle_folder", "folder of counterexamples and cached outcomes, from the root folder",
        default=FOLDER
    )


def pytest_configure(config: Any) -> None:
    # A wrong setting is an error before the first test.
    _limits(config)
    config.pluginmanager.register(Summary(), "mishandle-summary")


def _positive(text: str) -> int:
    return _integer(text, 1)


def _natural(text: str) -> int:
    return _integer(text, 0)


def _integer(text: str, least: int) -> int:
    number = int(text)
    if number < least:
        raise ValueError(f"{text} is less than {least}")
    return number


def _setting(config: Any, name: str, least: int) -> int:
    try:
        return _integer(config.getini(name), least)
    except ValueError as error:
        raise pytest.UsageError(
            f"{name} is {config.getini(name)!r}; it must be a whole number from {least} on"
        ) from error


def _limits(config: Any) -> Limits:
    return Limits(
        budget=config.getoption("--mishandle-budget"), seed=config.getoption("--mishandle-seed"),
        default_budget=_setting(config, "mishandle_budget", 1),
        default_seed=_setting(config, "mishandle_seed", 0),
        use_cache=not config.getoption("--mishandle-no-cache"),
        only_replay=config.getoption("--mishandle-replay")
    )


def _folder(config: Any, nodeid: str) -> pathlib.Path:
    """Returns the folder of a test."""
    root = pathlib.Path(config.rootpath) / str(config.getini("mishandle_folder"))
    root.mkdir(parents=True, exist_ok=True)
    ignore = root / ".gitignore"
    if not ignore.exists():
        ignore.write_text("*\n", encoding="utf-8")
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", nodeid.rsplit("::", 1)[-1])[:60]
    return pathlib.Path(root, f"{name}-{hashlib.sha256(nodeid.encode()).hexdigest()[:8]}")


@pytest.hookimpl(tryfirst=True)  # type: ignore[untyped-decorator, unused-ignore]
def pytest_pyfunc_call(pyfuncitem: Any) -> bool | None:
    required: Requirement | None = getattr(pyfuncitem.obj, ATTRIBUTE, None)
    if required is None:
        return None
    arguments = {name: pyfuncitem.funcargs[name] for name in pyfuncitem._fixtureinfo.argnames}
    with tested():
        given = pyfuncitem.obj(**arguments)
    mistake = ""
    try:
        outcome = _test(pyfuncitem, required, given).run()
    except MishandleError as error:
        # Mistakes and exceptions of the system, without the frames of this package.
        cause = (
            "".join(traceback.format_exception(error.__cause__)) if error.__cause__ is not None
            else ""
        )
        mistake = (
            f"{type(error).__name__}: {error}\nrequirement: {required.formula}\n{cause}".rstrip()
        )
    if mistake:
        pytest.fail(mistake, pytrace=False)
    text = outcome.text + (" (cached)" if outcome.passes and outcome.is_cached else "")
    pyfuncitem.user_properties.append(
        (
            "mishandle",
            [outcome.passes, outcome.is_cached, outcome.simulations, text.splitlines()[0]]
        )
    )
    if outcome.passes:
        pyfuncitem.add_report_section("call", "mishandle", text)
    else:
        tail = "\ncached: nothing that decides it changed" if outcome.is_cached else ""
        pytest.fail(outcome.text + tail, pytrace=False)
    return True


def _test(pyfuncitem: Any, required: Requirement, given: Any) -> Test:
    """Returns the test of a requirement whose function returned ``given``."""
    if given is not None and required.system is not None:
        raise InvalidTypeError(
            "the function returns a system, and @requirement has a target: give one of them"
        )
    system = required.system if given is None else given
    if system is None:
        raise InvalidTypeError(
            "the function returns no system, and @requirement has no target: return a function or "
            "an environment"
        )
    config, nodeid = pyfuncitem.config, pyfuncitem.nodeid
    again = f"pytest {shlex.quote(nodeid)}"
    return Test(
        required, system, _folder(config, nodeid), pathlib.Path(pyfuncitem.path), again,
        _limits(config)
    )


class Summary:
    """Counts the requirements of a test run, also those that workers of xdist tested."""

    def __init__(self) -> None:
        self.outcomes: list[tuple[str, Outcome]] = []

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.when == "call":
            for name, value in report.user_properties:
                if name == "mishandle":
                    passes, is_cached, simulations, text = value
                    self.outcomes.append(
                        (report.nodeid, Outcome(passes, text, simulations, is_cached))
                    )

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        if not self.outcomes:
            return
        cached = sum(outcome.is_cached for _, outcome in self.outcomes)
        simulations = sum(outcome.simulations for _, outcome in self.outcomes)
        count = len(self.outcomes)
        requirements = "1 requirement" if count == 1 else f"{count} requirements"
        terminalreporter.write_line(
            f"mishandle: {requirements}, {cached} cached, {simulations} simulations"
        )
        if terminalreporter.verbosity > 0:
            for nodeid, outcome in self.outcomes:
                terminalreporter.write_line(f"  {nodeid}: {outcome.text}")
