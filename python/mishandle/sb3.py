"""Training with Stable-Baselines3."""

from typing import Any

import gymnasium
from gymnasium.vector import AutoresetMode
from mishandle.base.packages import needed
from mishandle.errors import InvalidValueError


def vec_env(env: gymnasium.vector.VectorEnv[Any, Any, Any]) -> Any:
    """Returns a Gymnasium vector environment as a `VecEnv` of Stable-Baselines3.

    Parameters
    ----------
    env : gymnasium.vector.VectorEnv
        Environments with the autoreset mode ``SAME_STEP``, for instance of
        ``gymnasium.make_vec("mishandle/PointReaching-v0", num_envs=64,
        autoreset_mode="SameStep")``.

    Returns
    -------
    stable_baselines3.common.vec_env.VecEnv
        Timeouts are reported as ``TimeLimit.truncated`` and the last observation of an episode as
        ``terminal_observation``, so that the return is bootstrapped. ``VecMonitor`` and
        ``VecNormalize`` can wrap it.

    Raises
    ------
    ImportError
        If Stable-Baselines3 is not installed.
    ValueError
        If the autoreset mode is another one.
    """
    with needed("vec_env needs Stable-Baselines3: pip install stable-baselines3"):
        from stable_baselines3.common.vec_env import VecEnv
    mode = env.metadata.get("autoreset_mode")
    if mode is not AutoresetMode.SAME_STEP:
        raise InvalidValueError(
            f'the autoreset mode is {mode}; pass autoreset_mode="SameStep" to gymnasium.make_vec'
        )

    class Adapter(VecEnv):  # type: ignore[misc, unused-ignore]
        def __init__(self) -> None:
            super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
            self._actions: Any = None

        def reset(self) -> Any:
            seeds: Any = None if all(seed is None for seed in self._seeds) else list(self._seeds)
            observations, _ = env.reset(seed=seeds, options=self._options[0] or None)
            self._reset_seeds()
            self._reset_options()
            return observations

        def step_async(self, actions: Any) -> None:
            self._actions = actions

        def step_wait(self) -> Any:
            observations, rewards, terminated, truncated, info = env.step(self._actions)
            infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
            ended = terminated | truncated
            for row in ended.nonzero()[0]:
                infos[row]["terminal_observation"] = info["final_obs"][row]
                infos[row]["TimeLimit.truncated"] = bool(truncated[row] and not terminated[row])
            return observations, rewards, ended, infos

        def close(self) -> None:
            env.close()

        def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
            return [getattr(env, attr_name)] * len(self._get_indices(indices))

        def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
            raise NotImplementedError(
                "the environments are stepped together and have no attributes of their own"
            )

        def env_method(
            self, method_name: str, *arguments: Any, indices: Any = None, **keywords: Any
        ) -> list[Any]:
            raise NotImplementedError(
                "the environments are stepped together and have no methods of their own"
            )

        def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
            return [False] * len(self._get_indices(indices))

    return Adapter()
