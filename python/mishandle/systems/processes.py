"""Systems that are programs of their own."""

import os
import pathlib
import shlex
from collections.abc import Sequence

from mishandle.errors import InvalidTypeError, InvalidValueError


class Process:
    """A simulator that is another program, in any language, and speaks the protocol of simulators.

    The program states its axes, spaces, signals and formulas itself, so a question about it needs
    no formula and names a space instead of listing axes. It starts before the first simulation,
    once per thread, and again after a crash or a time-out, so that a late answer is never read.
    Both end a simulation without a verdict, and the run keeps the reason.

    Parameters
    ----------
    command : str or sequence of str
        Program and arguments; a text is split as a shell splits it. The contents of files that they
        name are a part of the hash of the system.
    folder : path, optional
        Working folder of the program; by default the present one.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from mishandle import Process, simulate
    >>> program = '''
    ... import json, sys
    ... for line in sys.stdin:
    ...     question = json.loads(line)
    ...     answer = {"id": question["id"]}
    ...     if question["type"] == "hello":
    ...         answer |= {"protocol": 1, "name": "car", "control_dt": 1, "steps": 1}
    ...         answer["signals"] = [{"name": "gap", "unit": "m"}]
    ...         speed = {"name": "speed", "unit": "m/s", "low": 0, "high": 10, "nominal": 5}
    ...         answer["axes"] = [speed]
    ...         answer["formulas"] = [{"name": "distance", "text": "always(gap >= 2)"}]
    ...     else:
    ...         answer["trace"] = {"gap": [10, 10 - question["scenario"]["speed"]]}
    ...     print(json.dumps(answer), flush=True)
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = (pathlib.Path(folder) / "car.py").write_text(program)
    ...     simulate(Process("python3 car.py", folder=folder), at={"speed": 9})[0].robustness
    -1.0
    """

    def __init__(
        self, command: str | Sequence[str], *, folder: str | os.PathLike[str] = "."
    ) -> None:
        if (
            isinstance(command, bytes) or not isinstance(command, Sequence)
            or not all(isinstance(word, str) for word in command)
        ):
            raise InvalidTypeError(
                f"the command is {command!r}; expected a text or a list of texts, such as "
                "['python3', 'simulator.py']"
            )
        self.command = command if isinstance(command, str) else shlex.join(command)
        if not self.command.strip():
            raise InvalidValueError("the command is empty; expected a program and its arguments")
        # Absolute, because a run outlives the present folder.
        self.folder = pathlib.Path(folder).absolute()

    @property
    def target(self) -> str:
        """Name of the target in plans and run files."""
        return f"process:{self.command}"

    def __repr__(self) -> str:
        return f"Process({self.command!r}, folder={str(self.folder)!r})"
