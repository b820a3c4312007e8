"""The other side of the protocol, for tests: asks a simulator questions and checks each answer against the contract."""

import itertools
import json
import math
import os
import select
import subprocess
import tempfile
import time

# Keys of hello: those that every simulator states, and all.
REQUIRED = {"id", "protocol", "name", "control_dt", "steps", "signals"}
KNOWN = REQUIRED | {"version", "axes", "spaces", "formulas", "deterministic", "seeded", "files", "versions", "time_limit"}
KNOWN |= {"policy", "mode"}
AXIS = {"name", "unit", "low", "high", "nominal", "kind", "values", "meaning"}
KINDS = {"start", "model", "event", "fault", "input"}


class Violation(AssertionError):
    """The simulator does not keep to the contract."""


def require(holds, problem):
    if not holds:
        raise Violation(problem)


class Peer:
    """One running simulator."""

    def __init__(self, words, folder, limit=20.0):
        self.limit, self.number = limit, 0
        self.stderr = tempfile.TemporaryFile()
        self.process = subprocess.Popen(
            words, cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.stderr, bufsize=0
        )
        self.pending = b""
        try:
            self.hello = self.ask("hello", protocol=1)
            require("error" not in self.hello, f"hello is {self.hello}")
        except BaseException:
            self.__exit__()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        self.process.stdin.close()
        self.process.stdout.close()
        self.stderr.close()

    def send(self, line):
        self.process.stdin.write(line + b"\n")

    def read(self):
        """Returns the next line, which must be the only one."""
        until = time.monotonic() + self.limit
        while b"\n" not in self.pending:
            ready, _, _ = select.select([self.process.stdout], [], [], max(0.0, until - time.monotonic()))
            require(ready, f"no answer within {self.limit} s; standard error: {self.printed()}")
            part = os.read(self.process.stdout.fileno(), 1 << 16)
            require(part, f"the simulator ended instead of an answer; standard error: {self.printed()}")
            self.pending += part
        line, self.pending = self.pending.split(b"\n", 1)
        require(not self.pending, f"more than one line: {self.pending[:200]}")
        return line.decode("utf-8")

    def ask(self, kind, **fields):
        """Asks a question, and returns the answer with its id checked and removed."""
        self.number += 1
        question = {"id": self.number, "type": kind, **fields}
        self.send(json.dumps(question, ensure_ascii=False).encode())
        answer = json.loads(self.read(), parse_constant=lambda name: require(False, f"{name} is no JSON"))
        require(answer.pop("id", None) == self.number, f"the id differs from {self.number}: {answer}")
        if "error" in answer:
            require(set(answer) == {"error"}, f"keys beside error: {answer}")
            require(isinstance(answer["error"], str), f"the error is no text: {answer}")
        return answer

    def printed(self):
        """Returns the standard error so far."""
        self.stderr.seek(0)
        return self.stderr.read().decode("utf-8", "replace")

    def close(self):
        """Closes standard input. Returns the exit code and what still came on standard output."""
        self.process.stdin.close()
        code = self.process.wait(self.limit)
        return code, self.process.stdout.read()

    # Episodes

    def nominal(self):
        return {axis["name"]: axis["nominal"] for axis in self.hello["axes"]}

    def corners(self):
        names = [axis["name"] for axis in self.hello["axes"]]
        ends = lambda axis: axis["values"] if isinstance(axis.get("values"), list) else (axis["low"], axis["high"])
        return [dict(zip(names, corner)) for corner in itertools.product(*map(ends, self.hello["axes"]))]

    def episode(self, scenario, seed="0", policy=None):
        """Simulates a scenario. Returns the trace and the end, or raises its error."""
        if self.hello.get("mode", "trace") == "trace":
            answer = self.ask("simulate", seed=seed, scenario=scenario)
            self.check_keys(answer, {"trace", "end", "reason"})
            trace = answer.get("trace", {})
            self.check_trace(trace, answer.get("end"))
            return trace, answer.get("end")
        answer = self.ask("reset", seed=seed, scenario=scenario)
        rows, end = [self.state(answer)], answer.get("end")
        while end is None and len(rows) <= self.hello["steps"]:
            action = {"action": policy(answer["observation"])} if "policy" in self.hello else {}
            answer = self.ask("step", **action)
            rows.append(self.state(answer))
            end = answer.get("end")
        names = [signal["name"] for signal in self.hello["signals"]]
        trace = {name: list(column) for name, column in zip(names, zip(*rows))}
        self.check_trace(trace, end)
        return trace, end

    def state(self, answer):
        self.check_keys(answer, {"signals", "observation", "end", "reason"})
        require(len(answer["signals"]) == len(self.hello["signals"]), f"wrong number of signals: {answer}")
        require(("observation" in answer) == ("policy" in self.hello), f"observation and policy differ: {answer}")
        if "policy" in self.hello:
            size = sum(part.get("size", 1) for part in self.hello["policy"]["observation"])
            require(len(answer["observation"]) == size, f"the observation has not {size} numbers: {answer}")
        return answer["signals"]

    def check_keys(self, answer, known):
        if "error" in answer:
            raise RuntimeError(answer["error"])
        require(set(answer) <= known, f"unknown keys {set(answer) - known}")
        require(answer.get("end") in (None, "terminated", "diverged", "invalid"), f"unknown end {answer.get('end')}")

    def check_trace(self, trace, end):
        if end == "invalid":
            return
        require(list(trace) == [signal["name"] for signal in self.hello["signals"]], f"other signals: {list(trace)}")
        lengths = {len(column) for column in trace.values()}
        require(len(lengths) == 1, f"columns of different lengths: {lengths}")
        length, expected = lengths.pop(), self.hello["steps"] + 1
        require(length == expected or (end and length <= expected), f"{length} samples instead of {expected}")


def check_hello(hello):
    """Checks that hello has the keys, types and ranges of the contract."""
    require(REQUIRED - {"id"} <= set(hello) <= KNOWN, f"keys of hello: {sorted(hello)}")
    require(hello["protocol"] == 1 and hello["steps"] >= 1 and hello["control_dt"] > 0, "protocol, steps or control_dt")
    for axis in hello["axes"]:
        require({"name", "nominal"} <= set(axis) <= AXIS, f"keys of the axis: {sorted(axis)}")
        require(axis.get("kind", "model") in KINDS, f"kind {axis.get('kind')}")
        if isinstance(axis.get("values"), list):
            require(axis["nominal"] in axis["values"] and "low" not in axis, f"categories: {axis}")
        else:
            require(axis["low"] <= axis["nominal"] <= axis["high"] and axis["low"] < axis["high"], f"range: {axis}")
            require(all(math.isfinite(axis[key]) for key in ("low", "nominal", "high")), f"range: {axis}")
    names = [entry["name"] for entry in hello["axes"] + hello["signals"]]
    require(all(name.isidentifier() for name in names), f"names: {names}")
    require(all(set(formula) == {"name", "text"} for formula in hello["formulas"]), f"formulas: {hello['formulas']}")
    if "policy" in hello:
        require({"observation", "action", "action_limit"} == set(hello["policy"]), f"policy: {hello['policy']}")
        require(hello["mode"] == "step", "a policy needs the mode step")
