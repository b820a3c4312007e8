# Types only; `help(mishandle.VectorEnv)` prints the documentation.

from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

__version__: str

class MishandleError(Exception): ...

class Info(TypedDict):
    final_observation: NDArray[np.float32]

class VectorEnv:
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
    ) -> VectorEnv: ...
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
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], Info]: ...
