"""A task of Mishandle as an environment for skrl's agents: tensors, and every reset is a termination."""

import gymnasium
import mishandle
import numpy as np
import torch
from skrl.envs.torch.wrappers import Wrapper


class Environment(Wrapper):
    """Rows of `TrainingEpisodes`. Timeouts are terminations, as in skrl 0.10's wrappers of Isaac's gyms.

    `points` has the data that `mishandle train --csv` writes: after each `iteration_steps` control steps, the environment
    steps so far and the mean return of the episodes that ended in this iteration.
    """

    def __init__(self, task, settings, seed, threads, iteration_steps):
        env = mishandle.systems.TrainingEpisodes(
            task,
            settings["episodes"]["environments"],
            seed=seed,
            time_limit=settings["episodes"]["time_limit"],
            threads=threads,
        )
        super().__init__(env)
        self.device = torch.device("cpu")
        self.num_envs_ = env.environments
        self.spaces = {
            "observation_space": gymnasium.spaces.Box(-5.0, 5.0, (env.observation_size,)),
            "action_space": gymnasium.spaces.Box(-1.0, 1.0, (env.action_size,)),
        }
        self.iteration_steps = iteration_steps
        self.points = []
        self.steps = 0
        self.returns = np.zeros(env.environments)
        self.ended = []
        self.observations = None

    @property
    def num_envs(self):
        return self.num_envs_

    @property
    def observation_space(self):
        return self.spaces["observation_space"]

    @property
    def state_space(self):
        return self.spaces["observation_space"]

    @property
    def action_space(self):
        return self.spaces["action_space"]

    def reset(self):
        """Returns the first observations; later the present ones, because a row starts its next episode by itself."""
        if self.observations is None:
            self.observations = torch.from_numpy(self._env.reset())
        return self.observations, {}

    def step(self, actions):
        observations, rewards, terminated, truncated, info = self._env.step(actions.detach().numpy())
        ended = terminated | truncated
        self.follow(rewards, ended)
        self.observations = torch.from_numpy(observations)
        column = lambda array: torch.from_numpy(array).view(-1, 1)
        rewards = column(rewards.astype(np.float32))
        return self.observations, rewards, column(ended), column(np.zeros_like(ended)), info

    def follow(self, rewards, ended):
        self.returns += rewards
        self.ended.extend(self.returns[ended])
        self.returns[ended] = 0.0
        self.steps += 1
        if self.steps % self.iteration_steps == 0:
            mean = np.mean(self.ended) if self.ended else None
            self.points.append((self.steps * self.num_envs, mean))
            self.ended.clear()

    def close(self):
        pass
