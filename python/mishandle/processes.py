"""Systems that are processes of their own."""

from __future__ import annotations

import inspect
import json
import subprocess
from collections.abc import Sequence
from typing import Any

from mishandle.errors import InvalidTypeError


class JsonProcess:
    """A function of a scenario that asks another process: one line of JSON out, one line of JSON back.

    The process gets the scenario as an object, such as ``{"speed": 30.0}``, and answers with the trace, such as ``{"gap": [10.0, 8.0]}``.
    It starts with the first simulation. A simulation that a time limit, Ctrl-C or an exception ends leaves an answer on its way, which
    would be taken for that of the next scenario: the process is killed then, and the next simulation starts a new one.

    Parameters
    ----------
    command : sequence of str
        Program and arguments. The contents of files that they name are a part of the hash of the system.
    seed : str, optional
        Key of the object with the random seed of the simulation; without it, the process gets no seed.
    **options
        Options of :class:`subprocess.Popen`, such as ``cwd`` and ``env``.

    Examples
    --------
    >>> import sys
    >>> from mishandle import Axis, simulate
    >>> program = "import json, sys\\nfor line in sys.stdin: print(json.dumps({'gap': [10, 10 - json.loads(line)['speed']]}), flush=True)"
    >>> with JsonProcess([sys.executable, "-c", program]) as car:
    ...     simulate(car, "always(gap >= 2)", [Axis("speed", 0, 10, "m/s")], at={"speed": 9})[0].robustness
    -1.0
    """

    def __init__(self, command: Sequence[str], *, seed: str | None = None, **options: Any) -> None:
        if isinstance(command, (str, bytes)):
            raise InvalidTypeError(f"the command is {command!r}; expected a list, such as ['python3', 'simulator.py']")
        self.command = [str(part) for part in command]
        self.__name__ = self.command[0].rpartition("/")[2] or "process"
        self.seed = seed
        self.options = options
        self.__signature__ = _signature(seed)
        self._child: subprocess.Popen[str] | None = None

    def __getstate__(self) -> dict[str, Any]:
        # A process cannot be copied; a copy starts its own.
        return {**self.__dict__, "_child": None, "__signature__": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.__signature__ = _signature(self.seed)

    def __call__(self, scenario: dict[str, Any], **seeds: int) -> Any:
        asked = scenario if self.seed is None else {**scenario, self.seed: seeds["seed"]}
        if self._child is None or self._child.poll() is not None:
            self._child = subprocess.Popen(
                self.command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8", **self.options
            )
        try:
            return self._answer(self._child, json.dumps(asked))
        except BaseException:
            self.close()
            raise

    def _answer(self, child: subprocess.Popen[str], line: str) -> Any:
        assert child.stdin is not None and child.stdout is not None
        child.stdin.write(line + "\n")
        child.stdin.flush()
        answer = child.stdout.readline()
        if not answer.endswith("\n"):
            raise RuntimeError(f"the process {self.command[0]} ended with exit code {child.wait()} instead of an answer")
        return json.loads(answer)

    def close(self) -> None:
        """Kills the process. A later simulation starts a new one."""
        child, self._child = self._child, None
        if child is not None:
            child.kill()
            # Closes the pipes, too.
            with child:
                pass

    def __enter__(self) -> JsonProcess:
        return self

    def __exit__(self, *exception: Any) -> None:
        self.close()

    def __del__(self) -> None:
        if self._child is not None:
            self._child.kill()


def _signature(seed: str | None) -> inspect.Signature:
    """Returns the parameters of a process as a function, with ``seed`` if it gets one."""
    kinds = inspect.Parameter
    parameters = [kinds("scenario", kinds.POSITIONAL_OR_KEYWORD), kinds("seed", kinds.KEYWORD_ONLY)]
    return inspect.Signature(parameters if seed is not None else parameters[:1])
