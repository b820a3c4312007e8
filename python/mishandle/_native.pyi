# Types of the extension module, which the modules of the package use. It is not part of the public
# interface.

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__version__: str

Samples = tuple[
    NDArray[np.float32], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_],
    NDArray[np.bool_]
]
Request = tuple[dict[str, Any], int, tuple[str, float, bool] | None]
Outcome = tuple[str, int, int, NDArray[np.float64], int, float, str]
AxisTuple = tuple[
    str, str, str, float, float, float | None, list[str], str,
    list[tuple[str, bool, list[float | str]]]
]
Node = tuple[str | None, tuple[int, int | None] | None, list[int], list[str] | None]


def search_names() -> list[str]: ...

class Formula:
    def __new__(cls, text: str) -> Formula: ...
    @property
    def signals(self) -> list[str]: ...
    @property
    def subformulas(self) -> list[str]: ...
    @property
    def symbols(self) -> str: ...
    @property
    def chains_comparisons(self) -> bool: ...
    @property
    def unused_definitions(self) -> list[str]: ...
    @property
    def needs_period(self) -> bool: ...
    def hint(self, names: list[str]) -> str | None: ...
    def nodes(self, period: float | None) -> list[Node]: ...
    def robustness_signal(
        self, names: list[str], samples: NDArray[np.float64], period: float | None,
        decided_only: bool
    ) -> NDArray[np.float64]: ...
    def robustness_bounds(
        self, names: list[str], samples: NDArray[np.float64], period: float | None
    ) -> tuple[float, float]: ...

class OnlineMonitor:
    def __new__(
        cls, formulas: list[str], signals: list[str], period: float | None, samples: int | None
    ) -> OnlineMonitor: ...
    @property
    def signals(self) -> list[str]: ...
    def push(
        self, sample: float | Sequence[float] | NDArray[np.float64] | Mapping[str, float]
    ) -> None: ...
    def push_many(self, samples: NDArray[np.float64]) -> None: ...
    def bounds(self, formula: int = 0) -> tuple[float, float]: ...
    def verdict(self, formula: int = 0) -> bool | None: ...
    def decided(self, formula: int = 0) -> tuple[int, float] | None: ...
    def reset(self) -> None: ...
    def __len__(self) -> int: ...

class GuardMonitor:
    def __new__(
        cls, settings: str, quantities: list[str], period: float, steps: int
    ) -> GuardMonitor: ...
    def reset(self) -> None: ...
    def step(self, quantities: list[float], is_usable: bool) -> tuple[bool, bool, float]: ...
    @property
    def needs_action(self) -> bool: ...

class EarlyStop:
    def __new__(
        cls, formula: str, signals: list[str], control_dt: float, steps: int, threshold: float,
        needs_windows: bool
    ) -> EarlyStop: ...
    def push(self, sample: Sequence[float] | NDArray[np.float64]) -> bool: ...

def spelled(name: str) -> str: ...

LogTopic = tuple[
    str | None, tuple[str, str, NDArray[Any] | list[str]] | None,
    list[tuple[str, NDArray[np.float64]]]
]
Log = tuple[str, list[tuple[str | None, str]], list[LogTopic]]
Parameter = tuple[str, float, float, str | None, float | None]
TableColumns = tuple[str | None, NDArray[np.int64] | None, list[tuple[str, NDArray[np.float64]]]]

def monitor(
    formulas: list[tuple[str | None, str]],
    logs: list[tuple[Log, list[int]]],
    reading: Mapping[str, Any],
    unit: str | None,
    strict_horizon: bool,
    values: bool,
) -> tuple[str, str, list[str]]: ...
def log_robustness(
    formula: Formula, log: Log, reading: Mapping[str, Any], decided_only: bool
) -> float | None: ...
def describe_formula(
    text: str,
    logs: list[Log],
    reading: Mapping[str, Any],
    unit: str | None,
    units: Mapping[str, str],
    episode: float | None,
) -> tuple[str, str]: ...
def requirement_formulas(path: str) -> list[tuple[str, str]]: ...
def check(
    target: Target,
    *,
    requirements: str,
    out: str,
    episodes: int | None,
    trials: int | None,
    budget: int | None,
    search: str,
    batch: int,
    fail_on: str,
    allow_inapplicable: bool,
    seed: int,
    progress: Any,
) -> tuple[str, str, int]: ...
def pattern_formula(name: str, settings: list[tuple[str, str]]) -> tuple[str, str]: ...
def mined_signals(formula: str, parameters: list[Parameter]) -> list[str]: ...
def mine(
    formula: str,
    parameters: list[Parameter],
    logs: list[Log],
    reading: Mapping[str, Any],
    unit: str | None,
    share: float,
    points: int,
) -> tuple[str, str]: ...
def read_table(
    path: str, reading: Mapping[str, Any]
) -> tuple[list[TableColumns], list[tuple[str, str]]]: ...

class Search:
    def __new__(
        cls, name: str, levels: list[int | None], seed: int, options: list[tuple[str, Any]]
    ) -> Search: ...
    def ask(self, points: int) -> list[list[float]]: ...
    def tell(self, point: list[float], value: float) -> None: ...
    @property
    def finished(self) -> bool: ...
    @property
    def best(self) -> tuple[list[float], float] | None: ...

class Objective:
    def __new__(cls, target: Target, formula: str | None) -> Objective: ...
    def robustness(
        self, points: list[list[float]], seed: int, threshold: float
    ) -> list[float | None]: ...
    def scenario(self, point: list[float]) -> dict[str, Any]: ...

class Run:
    def __new__(cls, path: str) -> Run: ...
    def header(self) -> dict[str, Any]: ...
    def simulations(self) -> dict[str, list[Any]]: ...
    def trace(self, trial: int, number: int) -> NDArray[np.float64] | None: ...
    def explain(self, trial: int, number: int, axes: int) -> str: ...
    def report(self, probes: int | None, sensitivity: int) -> str: ...
    def failure_modes(self) -> str: ...

PairTuple = tuple[float | None, float | None, bool, bool]

def compare(first: str, second: str) -> tuple[str, list[PairTuple]]: ...
def report(target: Target, path: str, probes: int, sensitivity: int) -> str: ...
def survival(path: str) -> tuple[list[tuple[int, float]], list[int], int]: ...
def counterexample(path: str, trial: int, number: int) -> str: ...
def export(
    path: str, folder: str, *, target: Target | None, budget: int | None
) -> tuple[str, list[tuple[str, str]]]: ...
def regress(
    target: Target, folder: str, *, baseline: Target | None, repeats: int, max_failure_rate: float
) -> tuple[str, str]: ...
def evidence(
    runs: list[str], out: str, *, key: str | None, force: bool, controller: str | None,
    target: str | None
) -> str: ...
def recorded_states(
    path: str,
    *,
    trial: int | None,
    number: int | None,
    controller: str | None,
    target: str | None,
    nominal: bool,
) -> dict[str, Any]: ...
def verify_evidence(
    folder: str, *, allowed_signers: str | None, public_key: str | None, share: float,
    seed: int | None
) -> str: ...
def with_settings(axes: list[AxisTuple], settings: Mapping[str, Any]) -> list[AxisTuple]: ...
def diff(first: str, second: str) -> str: ...
def comparison_page(first: str, second: str) -> str: ...

Layout = tuple[list[tuple[str, list[int]]], list[tuple[float, float]], bool]

class Faults:
    def __new__(
        cls,
        *,
        observation: Layout | None,
        action: Layout | None,
        count: int,
        has_delays: bool,
        control_dt: float,
        episode_steps: int,
    ) -> Faults: ...
    @property
    def axes(self) -> list[AxisTuple]: ...
    @property
    def random_axes(self) -> list[str]: ...
    def start(self, values: dict[str, float], seed: int) -> ActiveFaults | None: ...

class Images:
    def __new__(
        cls, cameras: list[tuple[str, int, int]], *, control_dt: float, episode_steps: int
    ) -> Images: ...
    @property
    def axes(self) -> list[tuple[str, AxisTuple]]: ...
    @property
    def random_axes(self) -> list[str]: ...
    def start(self, values: dict[str, float], seed: int) -> ActiveImages | None: ...

class ActiveImages:
    def observe(self, step: int, images: list[NDArray[np.uint8]]) -> None: ...

class TaskCameras:
    def __new__(cls, task: str, names: list[str], width: int, height: int) -> TaskCameras: ...
    def start(self, state: NDArray[np.float64], values: dict[str, float], seed: int) -> None: ...
    def images(self, state: NDArray[np.float64]) -> list[NDArray[np.uint8]]: ...

def task_sight_axes(task: str) -> list[tuple[str, AxisTuple]]: ...

class ActiveFaults:
    def observe(self, step: int, observation: NDArray[np.float64]) -> None: ...
    def is_paused(self, step: int) -> bool: ...
    def has_pause(self) -> bool: ...
    def act(self, step: int, action: NDArray[np.float64]) -> bool: ...

class Controller:
    def __new__(cls, name: str, task: str | None = None) -> Controller: ...
    @property
    def task(self) -> str: ...
    @property
    def hash(self) -> str: ...
    @property
    def observation_size(self) -> int: ...
    @property
    def action_size(self) -> int: ...
    def onnx_bytes(self) -> bytes: ...
    @property
    def is_recurrent(self) -> bool: ...
    @property
    def images(self) -> list[tuple[str, int, int]]: ...
    def reset(self) -> None: ...
    def act(
        self, observations: NDArray[np.float32], images: list[NDArray[np.uint8]]
    ) -> NDArray[np.float32]: ...

class Sights:
    def __new__(
        cls, task: str, *, cameras: list[str], size: list[int], space: str, threads: int | None
    ) -> Sights: ...
    @property
    def document(self) -> str: ...
    @property
    def axes(self) -> list[str]: ...
    @property
    def state_size(self) -> int: ...
    def values(self, scenarios: list[dict[str, Any]]) -> NDArray[np.float64]: ...
    def draw(self, seed: int, first: int, count: int) -> NDArray[np.float64]: ...
    def poses(
        self, states: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...
    def rows(
        self, values: NDArray[np.float64], starts: NDArray[np.float64]
    ) -> list[NDArray[np.float32]]: ...
    def cloths(
        self,
    ) -> tuple[NDArray[np.uint32], NDArray[np.uint32], NDArray[np.uint32], NDArray[np.float32]]: ...
    @staticmethod
    def compression_tables() -> NDArray[np.float32]: ...
    def images(
        self,
        states: NDArray[np.float64],
        before: NDArray[np.float64] | None,
        values: NDArray[np.float64],
        starts: NDArray[np.float64],
        sights: NDArray[np.int32],
        seeds: NDArray[np.uint64],
        steps: NDArray[np.uint64],
    ) -> NDArray[np.uint8]: ...

class Simulator:
    def __new__(
        cls, task: str, rows: int, *, preset: str, reward: str, threads: int | None,
        manner: bool = False
    ) -> Simulator: ...
    @property
    def observation_size(self) -> int: ...
    @property
    def action_size(self) -> int: ...
    @property
    def episode_steps(self) -> int: ...
    @property
    def control_dt(self) -> float: ...
    @property
    def signals(self) -> list[tuple[str, str]]: ...
    @property
    def formulas(self) -> list[tuple[str, str]]: ...
    @property
    def reward_terms(self) -> list[str]: ...
    @property
    def axes(self) -> list[tuple[str, str, float, float, str]]: ...
    @property
    def observation_names(self) -> list[str]: ...
    @property
    def fault_layouts(self) -> list[Layout]: ...
    def arrays(self) -> Samples: ...
    def reset(
        self,
        mask: NDArray[np.bool_],
        seeds: NDArray[np.uint64],
        scenarios: NDArray[np.float64],
        out: Samples | None = None,
    ) -> Samples: ...
    def step(self, actions: NDArray[np.float32], out: Samples | None = None) -> Samples: ...
    def render(self, rows: list[int], width: int, height: int) -> NDArray[np.uint8]: ...
    def state(self, row: int) -> NDArray[np.float64]: ...

class Target:
    def __new__(
        cls,
        *,
        name: str,
        content: str,
        axes: Sequence[AxisTuple],
        signals: Sequence[tuple[str, str]],
        formulas: Sequence[tuple[str, str]],
        control_dt: float,
        episode_steps: int,
        is_deterministic: bool,
        depends_on_seed: bool,
        termination: str,
        components: Sequence[tuple[str, str, str]],
        not_covered: Sequence[str],
        versions: Sequence[tuple[str, str]],
        random_axes: Sequence[str],
        simulate: Callable[[list[Request]], list[Outcome]],
        painter: Any = None,
    ) -> Target: ...
    def with_requirements(self, requirements: dict[str, str]) -> Target: ...
    @staticmethod
    def of_task(
        task: str,
        controller: str,
        preset: str,
        space: str,
        axes: Mapping[str, float | tuple[float, float] | str],
        noise: tuple[bool, float, float],
        folder: str | None = None,
        guard: str | None = None,
    ) -> Target: ...
    @property
    def axes(self) -> list[AxisTuple]: ...
    @property
    def hashes(self) -> list[str]: ...
    @property
    def signals(self) -> list[tuple[str, str]]: ...
    @property
    def formulas(self) -> list[tuple[str, str]]: ...

def policy_interface(target: str) -> tuple[str, int, int]: ...
def policy_target(
    target: str,
    policy: Any,
    *,
    images: Sequence[tuple[str, int, int]],
    preset: str,
    name: str,
    identified: tuple[str, str, list[str]],
    space: str,
    axes: Mapping[str, float | tuple[float, float] | str],
    noise: tuple[float, float],
    versions: Sequence[tuple[str, str]],
    is_deterministic: bool,
) -> Target: ...

RequestTuple = tuple[list[float | None], int, bool, float | None]

class PlanWorker:
    def __new__(cls, plan: str, hashes: list[str], threads: int) -> PlanWorker: ...
    def rollout(self, requests: list[RequestTuple]) -> list[tuple[Any, ...]]: ...

def recorded_plan(path: str) -> tuple[str, list[str]]: ...
def create_campaign(text: str, folder: str) -> list[tuple[str, str, bool]]: ...
def campaign_runs(folder: str) -> list[tuple[str, str, bool]]: ...
def complete_hardening(
    folder: str, name: str, *, threads: int, durable: bool, any_build: bool
) -> int: ...
def complete_run(
    folder: str,
    name: str,
    *,
    simulate: Callable[[list[RequestTuple]], list[tuple[Any, ...]]],
    durable: bool,
    any_build: bool,
    progress: Callable[[int, int], bool],
) -> bool: ...

Out = tuple[str | None, bool, bool, bool]
Answered = tuple[str, BaseException | None, list[str]]

def check_falsify(
    axes: list[AxisTuple], *, search: str, options: list[tuple[str, Any]], trials: int, budget: int,
    batch: int, new_mode_rate: float
) -> None: ...
def check_evaluate(
    axes: list[AxisTuple], *, episodes: int, batch: int, until: str | None, rate: float | None
) -> None: ...
def falsify(
    target: Target,
    *,
    formula: str | None,
    search: str,
    options: list[tuple[str, Any]],
    trials: int,
    budget: int,
    batch: int,
    fixed_seed: int | None,
    early_stopping: bool,
    keep_going: bool,
    new_mode_rate: float,
    isolate: bool | None,
    repeats: int | None,
    seed: int,
    out: Out,
    progress: Callable[[int, int], None] | None,
) -> Answered: ...
def evaluate(
    target: Target,
    *,
    episodes: int,
    batch: int,
    until: str | None,
    rate: float | None,
    control: bool,
    seed: int,
    out: Out,
    progress: Callable[[int, int], None] | None,
) -> Answered: ...
def evaluate_pairs(
    first: Target,
    second: Target,
    *,
    until: str,
    margin: float | None,
    measure: str,
    robustness_bounds: tuple[float, float] | None,
    episodes: int,
    batch: int,
    seed: int,
    out: tuple[str, str] | None,
    resume: bool,
    durable: bool,
    progress: Callable[[int, int], None] | None,
) -> tuple[tuple[str, str], bool]: ...
def sample_size(
    *,
    expect: float | None,
    pairs: tuple[float, float, float, float] | None,
    until: str,
    rate: float | None,
    margin: float | None,
    episodes: int,
    batch: int,
    replications: int,
    seed: int,
) -> str: ...
def simulate(
    target: Target, *, formula: str | None, values: list[float | None], repeat: int, seed: int
) -> list[dict[str, Any]]: ...
def repeat(
    target: Target,
    *,
    formula: str | None,
    values: list[float | None],
    repeats: int | None,
    scenarios: int | None,
    seed: int,
) -> str: ...

Replayed = tuple[str, dict[str, Any], float | None, list[str]]

def replay(target: Target, *, path: str, trial: int | None, number: int | None) -> Replayed: ...
def replay_counterexample(target: Target, path: str) -> Replayed: ...
def check_margin(axes: list[AxisTuple], *, budget: int) -> None: ...
def margin(
    target: Target,
    *,
    formula: str | None,
    budget: int,
    each_category: bool,
    seed: int,
    out: Out,
    progress: Callable[[int, int], None] | None,
) -> Answered: ...
def check_metamorphic(
    axes: list[AxisTuple], *, relations: list[tuple[str, dict[str, str], str]], pairs: int,
    batch: int, seed: int
) -> None: ...
def metamorphic(
    target: Target,
    *,
    formula: str | None,
    relations: list[tuple[str, dict[str, str], str]],
    pairs: int,
    batch: int,
    seed: int,
    out: Out,
    progress: Callable[[int, int], None] | None,
) -> Answered: ...
def check_risk(
    axes: list[AxisTuple], *, simulations: int, method: str, batch: int,
    distributions: dict[str, str]
) -> None: ...
def risk(
    target: Target,
    *,
    formula: str | None,
    simulations: int,
    method: str,
    batch: int,
    distributions: dict[str, str],
    seed: int,
    out: Out,
    progress: Callable[[int, int], None] | None,
) -> Answered: ...
def harden(
    task: str,
    controller: str,
    *,
    preset: str,
    space: str,
    axes: dict[str, Any],
    noise: tuple[bool, float, float],
    guard: str | None,
    requirements: dict[str, str],
    seed: int,
    table: str,
    out: str,
    is_resumed: bool,
    progress: Callable[[str, int, int], None] | None,
) -> str: ...
def record(
    target: str,
    controller: str,
    *,
    preset: str,
    space: str,
    axes: dict[str, Any],
    noise: tuple[bool, float, float],
    guard: str | None,
    requirements: dict[str, str],
    seed: int,
    episodes: int,
    format: str,
    relabel: str | None,
    cameras: list[str],
    size: list[int],
    only_successful: bool,
    archive: str | None,
    archive_share: float,
    out: str,
    progress: Callable[[int, int], None] | None,
) -> str: ...
def hardening_report(folder: str, probes: int | None, sensitivity: int) -> str: ...
def bisect(
    words: list[str], progress: Callable[[str, int, int], None] | None
) -> tuple[str, str]: ...
def bisection_report(document: str, probes: int | None, sensitivity: int) -> str: ...

class Scenarios:
    def __new__(
        cls, axes: list[AxisTuple], *, nominal: float, corners: float, archived: float,
        archive: list[str]
    ) -> Scenarios: ...
    def draw(self, seed: int, episode: int) -> tuple[str, dict[str, Any], int]: ...
    def at(self, values: list[float | None]) -> dict[str, Any]: ...

class TrainingEpisodes:
    def __new__(
        cls,
        task: str,
        environments: int,
        *,
        preset: str = "paper",
        reward: str = "shaped",
        seed: int = 0,
        time_limit: int | None = None,
        action_noise: float = 0.0,
        staggered: bool = False,
        threads: int | None = None,
    ) -> TrainingEpisodes: ...
    @property
    def task(self) -> str: ...
    @property
    def environments(self) -> int: ...
    @property
    def observation_size(self) -> int: ...
    @property
    def action_size(self) -> int: ...
    @property
    def episode_steps(self) -> int: ...
    @property
    def control_dt(self) -> float: ...
    @property
    def observation_names(self) -> list[str]: ...
    def reset(self) -> NDArray[np.float32]: ...
    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[
        NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_],
        dict[str, Any]
    ]: ...

def run_command(arguments: list[str]) -> int: ...
def set_child_program(words: list[str]) -> None: ...
def run_child() -> int: ...
