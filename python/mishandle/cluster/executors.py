"""The executor that simulates batches on a Ray cluster."""

import importlib
import math
import os
import socket
import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mishandle.base.fingerprints import code_hash
from mishandle.base.packages import needed
from mishandle.errors import InvalidStateError, InvalidTypeError, InvalidValueError
from mishandle.scenarios.requests import Request
from mishandle.systems.interface import Outcome, System

Simulate = Callable[[list[Any]], list[Any]]
"""Simulates a list of requests and returns one result for each, in the same order."""

TASKS_PER_CPU = 4
"""Tasks of a batch for each CPU. More balance the load better and cost more messages."""

RETRIES = 3
"""How often Ray repeats a task whose worker or node was lost, before its simulations are repeated
one by one."""

STOP_TIMEOUT = 10.0
"""Seconds to wait for tasks that were canceled."""

CONNECTION_TIMEOUT = 5.0
"""Seconds to wait for a cluster to answer. Ray itself tries for minutes."""


def check_address(address: str | None) -> None:
    """Checks that something answers at an address ``HOST:PORT``; by default that of
    ``RAY_ADDRESS``.

    >>> check_address("local")
    >>> check_address("127.0.0.1:9")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    mishandle.errors.InvalidValueError: no Ray cluster answers at 127.0.0.1:9: [Errno 111] ...
    """
    address = os.environ.get("RAY_ADDRESS") if address is None else address
    host, colon, port = (address or "").removeprefix("ray://").rpartition(":")
    if not colon or not port.isdecimal():
        return
    try:
        socket.create_connection((host.strip("[]"), int(port)), CONNECTION_TIMEOUT).close()
    except (OSError, OverflowError) as error:
        raise InvalidValueError(f"no Ray cluster answers at {address}: {error}") from error


class RayExecutor:
    """Simulates batches on a Ray cluster.

    A task simulates a part of a batch. Ray repeats it elsewhere if its worker or node is lost.
    Results are put in the order of the requests, and a simulation depends only on its scenario and
    seed, so the rows of a run are those of one machine.

    Parameters
    ----------
    address : str, optional
        Address of the cluster: ``"auto"`` for the one that runs on this machine, ``"local"`` to
        start one. By default, the address in the variable ``RAY_ADDRESS``, a running one, or else a
        new one.
    num_cpus : float
        CPUs that a task occupies.
    chunk : int, optional
        Simulations of a task; by default a batch is split into four tasks per CPU of the cluster.

    Notes
    -----
    Ray sends functions, policies and environments to the workers with cloudpickle. An environment
    that Gymnasium made is made again on the worker from its ``spec``. All nodes need the same
    versions of Mishandle and of the packages that the system imports.
    """

    def __init__(
        self, address: str | None = None, *, num_cpus: float = 1.0, chunk: int | None = None
    ) -> None:
        if chunk is not None and chunk < 1:
            raise InvalidValueError(f"chunk is {chunk}; it must be at least 1")
        with needed("the executor `ray` needs Ray: pip install ray"):
            ray: Any = importlib.import_module("ray")
        if not ray.is_initialized():
            check_address(address)
            ray.init(address=address, log_to_driver=False, logging_level="WARNING")
        self._ray = ray
        self._chunk = chunk
        self._cpus = num_cpus
        self._task = ray.remote(num_cpus=num_cpus, max_retries=RETRIES)(_simulate)
        self.stop = threading.Event()

    @property
    def version(self) -> str:
        """Version of Ray."""
        return str(self._ray.__version__)

    def system(self, system: System) -> System:
        """Returns a system with the same results, whose batches are simulated by the cluster."""
        return _RaySystem(self, system)

    def share(self, factory: Callable[[], Simulate]) -> Any:
        """Sends a factory to the cluster. Each worker calls it once."""
        try:
            return self._ray.put(factory)
        except Exception as error:
            name = getattr(factory, "name", type(factory).__name__)
            # Ray's message contains a report of several lines; its cause says what cannot be sent.
            reason = error.__cause__ or error.__context__ or error
            raise InvalidTypeError(
                f"`{name}` or what it refers to cannot be sent to the workers: {reason}; make "
                "files, locks and connections inside the function, or use executor=None"
            ) from error

    def run(
        self, shared: Any, requests: Sequence[Any], lost: Callable[[Any], Any] | None = None
    ) -> list[Any]:
        """Returns the results of requests, simulated by the cluster.

        ``lost`` returns the result of a request that ends its worker each time; without it, this is
        an error.
        """
        chunk = self._chunk
        if chunk is None:
            cpus = self._ray.cluster_resources().get("CPU", 1.0) / self._cpus
            chunk = max(1, math.ceil(len(requests) / (TASKS_PER_CPU * cpus)))
        parts = [list(requests[start : start + chunk]) for start in range(0, len(requests), chunk)]
        tasks = [self._task.remote([shared], part) for part in parts]
        self._wait(tasks)
        results = [self._results(shared, task, part, lost) for task, part in zip(tasks, parts)]
        return [result for part in results for result in part]

    def _wait(self, tasks: list[Any]) -> None:
        pending = tasks
        try:
            while pending:
                _, pending = self._ray.wait(pending, num_returns=len(pending), timeout=0.5)
                if self.stop.is_set():
                    raise KeyboardInterrupt
        except BaseException:
            for task in pending:
                self._ray.cancel(task)
            # A hardening stores its batch and closes its files, so that it can be resumed at once.
            self._ray.wait(pending, num_returns=len(pending), timeout=STOP_TIMEOUT)
            raise

    def _results(
        self, shared: Any, task: Any, part: list[Any], lost: Callable[[Any], Any] | None
    ) -> list[Any]:
        errors = self._ray.exceptions
        try:
            return list(self._ray.get(task))
        except (errors.WorkerCrashedError, errors.NodeDiedError, errors.OutOfMemoryError) as error:
            if len(part) == 1:
                if lost is None:
                    raise InvalidStateError(
                        f"a worker of the cluster was lost {RETRIES + 1} times during the same "
                        f"task: {error}"
                    ) from error
                return [lost(part[0])]
        singles = [self._task.remote([shared], [request]) for request in part]
        self._wait(singles)
        return [
            result for single, request in zip(singles, part)
            for result in self._results(shared, single, [request], lost)
        ]


_simulators: dict[str, Simulate] = {}
"""The simulators of a worker process, by the object from which they were made."""

MAX_SIMULATORS = 8
"""Simulators that a worker process keeps."""


def _simulate(shared: list[Any], requests: list[Any]) -> list[Any]:
    """Simulates requests in a worker process."""
    # In a list, a reference is not replaced by its object, which would be sent with each task.
    key = shared[0].hex()
    simulator = _simulators.get(key)
    if simulator is None:
        while len(_simulators) >= MAX_SIMULATORS:
            _simulators.pop(next(iter(_simulators)))
        simulator = _simulators[key] = importlib.import_module("ray").get(shared[0])()
    return simulator(requests)


class _RaySystem(System):
    """A system whose batches are simulated by a cluster."""

    def __init__(self, executor: RayExecutor, system: System) -> None:
        self._executor = executor
        self._system = system
        self.name = system.name
        self.signals = system.signals
        self.control_dt = system.control_dt
        self.steps = system.steps
        self.versions = system.versions
        self.depends_on_seed = system.depends_on_seed
        self.knows_control_dt = system.knows_control_dt
        self.exceptions = system.exceptions
        self._shared = executor.share(_SystemFactory(system))

    def code(self) -> list[Any]:
        return self._system.code()

    def simulate(self, batch: Sequence[Request]) -> list[Outcome]:
        found = self._executor.run(self._shared, batch, self._lost)
        outcomes = []
        for outcome, exceptions in found:
            self.exceptions += exceptions[: 10 - len(self.exceptions)]
            outcomes.append(outcome)
        return outcomes

    def _lost(self, request: Request) -> tuple[Outcome, list[str]]:
        message = f"the scenario {request.scenario} ended its worker process {RETRIES + 1} times"
        return Outcome("crashed", np.zeros((0, len(self.signals))), 0, reason=message), [message]


class _SystemFactory:
    """Makes the simulator of a system on a worker, which must have the same code as the sender."""

    def __init__(self, system: System) -> None:
        self._system = system
        # Without values: an environment is made again, and the state of this one has changed.
        self._hash = code_hash(system.code())
        self.name = system.name

    def __call__(self) -> Simulate:
        system = self._system
        if code_hash(system.code()) != self._hash:
            raise InvalidStateError(
                f"the code of the system `{system.name}` or of its policy on this worker differs "
                "from that of the sender: give all nodes the same versions"
            )

        def simulate(batch: list[Any]) -> list[Any]:
            results: list[tuple[Outcome, list[str]]] = []
            try:
                outcomes = system.simulate(batch)
            except (SystemExit, KeyboardInterrupt, GeneratorExit) as error:
                # SystemExit would end the worker, and Ray would repeat the task.
                raise InvalidStateError(
                    f"the system `{system.name}` raised {error!r}, which ends a run; raise an "
                    "Exception to end a simulation as crashed"
                ) from None
            for outcome in outcomes:
                outcome.samples = np.ascontiguousarray(outcome.samples)
                results.append((outcome, []))
            if system.exceptions:
                results[0] = results[0][0], list(system.exceptions)
                system.exceptions.clear()
            return results

        return simulate
