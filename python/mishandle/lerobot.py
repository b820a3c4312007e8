"""Policies of LeRobot for Gymnasium environments, and the results of its ``lerobot-eval`` as run
files."""

import contextlib
import copy
import json
import os
import pathlib
import sqlite3
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mishandle.ask.falsification import Evaluation, evaluate
from mishandle.base.files import PathLike
from mishandle.errors import InvalidTypeError, InvalidValueError, MissingPackageError
from mishandle.runs.targets import Formulas
from mishandle.scenarios.axes import Axis
from mishandle.scenarios.requests import Request
from mishandle.systems.interface import Outcome, System

_KNOWN = ("pixels", "agent_pos", "environment_state", "robot_state", "policy", "camera_obs")
"""Names in the observations of LeRobot's environments, which its own code renames."""


class LeRobotPolicy:
    """A policy of LeRobot with its processors, as :func:`policy` returns it: a function of one
    observation. It keeps a queue of actions for each row, which :meth:`reset` empties."""

    def __init__(
        self, model: Any, processors: tuple[Any, Any], *, instruction: str,
        rename: Mapping[str, str], seed: int | None
    ) -> None:
        self._model, (self._before, self._after) = model.eval(), processors
        self._instruction, self._rename, self._seed = instruction, dict(rename), seed

    @property
    def identity(self) -> list[Any]:
        """What decides how it acts: weights, settings, processors with their statistics. Its queues
        are a state."""
        steps = [step for pipeline in (self._before, self._after) for step in pipeline.steps]
        processors = [(type(step), step.get_config(), step.state_dict()) for step in steps]
        model = (type(self._model), vars(self._model.config), self._model.state_dict())
        return [model, processors, self._instruction, self._rename, self._seed]

    def reset(self, rows: int = 1) -> None:
        """Starts episodes."""
        import torch

        if self._seed is not None:
            torch.manual_seed(self._seed)
        self._model.reset()

    def act(self, observations: Sequence[Any], rows: int) -> NDArray[np.float32]:
        """Returns one action per row."""
        import torch

        seen = {
            self._rename.get(name, name): tensor
            for name, tensor in _tensors(_stacked(observations)).items()
        }
        # Some policies fill in cameras that the robot lacks.
        missing = sorted(
            name for name in self._model.config.input_features.keys() - seen.keys()
            if "empty_camera" not in name
        )
        if missing:
            raise InvalidValueError(
                f"the policy sees {', '.join(missing)}, but the observation has "
                f"{', '.join(sorted(seen))}; pass rename={{...}} with the name of the policy for "
                "each name of the observation"
            )
        seen["task"] = [self._instruction] * len(observations)
        batch = self._before(seen)
        with torch.inference_mode():
            actions = self._model.select_action(batch)
        return np.asarray(self._after(actions).to("cpu").numpy())

    def __call__(self, observation: Any) -> NDArray[np.float32]:
        return np.asarray(self.act([observation], 1)[0])


def policy(
    source: Any, *, processors: tuple[Any, Any] | None = None, device: str = "cpu",
    instruction: str = "", rename: Mapping[str, str] | None = None, seed: int | None = None
) -> LeRobotPolicy:
    """Returns a policy of LeRobot for :func:`mishandle.evaluate`, :func:`mishandle.falsify` and all
    other questions.

    Parameters
    ----------
    source : path or PreTrainedPolicy
        Folder of a policy, such as ``checkpoints/last/pretrained_model`` of ``lerobot-train``, or a
        policy in memory.
    processors : tuple, optional
        Pre- and postprocessor of a policy in memory, from LeRobot's ``make_pre_post_processors``.
        Those of a folder are in the folder.
    device : str
        Device of a policy from a folder, as for PyTorch.
    instruction : str
        The task in words, for policies that read one.
    rename : mapping, optional
        The policy's names of features, by those of the observation: ``{"observation.images.over":
        "observation.image"}``.
    seed : int, optional
        Random seed of PyTorch at the start of each episode, which makes a policy that samples its
        actions deterministic.

    Notes
    -----
    Observations become features as in LeRobot's own evaluation. Of other environments, an array of
    bytes of the shape (height, width, 3) is ``observation.images.NAME``, every other part
    ``observation.NAME``, and an observation of one array ``observation.state``. Actions reach the
    environment as they are.
    """
    try:
        from lerobot.configs.policies import PreTrainedConfig
        from lerobot.policies.factory import get_policy_class, make_pre_post_processors
    except ImportError as error:
        needs = f"a policy of LeRobot needs LeRobot ({error})"
        raise MissingPackageError(needs, "lerobot") from error
    if not isinstance(source, (str, os.PathLike)):
        if not hasattr(source, "select_action") or processors is None:
            raise InvalidTypeError(
                f"a {type(source).__name__} is not a policy of LeRobot with its processors: pass "
                "the folder of a policy, or a policy and processors=make_pre_post_processors(...)"
            )
        model = source
    else:
        folder = pathlib.Path(source)
        for name in ("config.json", "model.safetensors"):
            if not (folder / name).is_file():
                raise InvalidValueError(
                    f"{folder} is not the folder of a LeRobot policy: it has no {name}"
                )
        config = PreTrainedConfig.from_pretrained(folder)
        config.device = device
        if hasattr(config, "pretrained_backbone_weights"):
            # The folder has the weights; LeRobot would download others first.
            config.pretrained_backbone_weights = None
        model = get_policy_class(config.type).from_pretrained(folder, config=config, strict=True)
        processors = make_pre_post_processors(
            config, pretrained_path=str(folder),
            preprocessor_overrides={"device_processor": {"device": device}}
        )
    return LeRobotPolicy(model, processors, instruction=instruction, rename=rename or {}, seed=seed)


def _stacked(observations: Sequence[Any]) -> Any:
    """Returns a batch of observations; of dictionaries, also of nested ones, a dictionary of
    batches."""
    if isinstance(observations[0], dict):
        return {name: _stacked([each[name] for each in observations]) for name in observations[0]}
    return np.stack(observations)


def _tensors(batch: Any) -> dict[str, Any]:
    """Returns a batch of observations as LeRobot's features."""
    import torch
    from lerobot.envs.utils import preprocess_observation

    if not isinstance(batch, dict):
        batch = {"agent_pos": batch}
    others = {name: values for name, values in batch.items() if name not in _KNOWN}
    images = {
        name: values for name, values in others.items()
        if values.dtype == np.uint8 and values.ndim == 4
    }
    return {
        **{
            f"observation.{name}": torch.from_numpy(values).float()
            for name, values in others.items() if name not in images
        },
        **preprocess_observation({"pixels": images}),
        **preprocess_observation({name: values for name, values in batch.items() if name in _KNOWN})
    }


class _Episode(NamedTuple):
    task: str
    seed: int | None
    success: float
    sum_reward: float
    max_reward: float


def read_evaluation(
    path: PathLike, formula: Formulas = None, *, task: str | None = None, start_seed: int = 1000,
    name: str | None = None, out: PathLike | None = None
) -> Evaluation:
    """Writes the results of LeRobot's ``lerobot-eval`` as a run file, with one simulation for each
    episode.

    The success rate of the result has an interval, and :func:`mishandle.compare` compares two such
    runs. The run has the outcomes alone, so nothing can be simulated again. LeRobot need not be
    installed.

    Parameters
    ----------
    path : path
        ``eval_info.json``.
    formula : str or dict of str, optional
        A formula or formulas of the signals ``success`` (1 or 0), ``sum_reward`` and
        ``max_reward``; by default LeRobot's own success.
    task : str, optional
        The task whose episodes are read, such as ``"libero_10/3"``; by default all, in the order of
        the tasks.
    start_seed : int
        ``--seed`` of ``lerobot-eval``, which newer files do not contain: the seed of the first
        episode of a task. ``compare`` refuses runs of different seeds.
    name : str, optional
        Name of the target; by default the groups of the tasks.
    out : path, optional
        Run file; by default the first free name in the folder ``runs``.
    """
    episodes = [
        episode for episode in _episodes(pathlib.Path(path)) if task in (None, episode.task)
    ]
    if not episodes:
        known = sorted({episode.task for episode in _episodes(pathlib.Path(path))})
        raise InvalidValueError(
            f"{path} has no episodes of the task {task!r}; its tasks are "
            f"{', '.join(known) or 'none'}"
        )
    if episodes[0].seed is not None:
        start_seed = episodes[0].seed
        if [episode.seed for episode in episodes] != list(
            range(start_seed, start_seed + len(episodes))
        ):
            raise InvalidValueError(
                f"the seeds in {path} do not count up from {start_seed}, so its episodes cannot "
                "be paired"
            )
    name = name or "+".join(sorted({episode.task.partition("/")[0] for episode in episodes}))
    axis = Axis(
        "start_seed", start_seed, start_seed, nominal=start_seed, kind="model",
        meaning="seed of the first episode of a task"
    )
    system = _Recorded(name, episodes)

    def written(file: PathLike | None) -> Evaluation:
        with warnings.catch_warnings():
            # Its one axis has one value.
            warnings.simplefilter("ignore", UserWarning)
            return evaluate(
                system, formula or {"success": "always(success >= 0.5)"}, [axis],
                episodes=len(episodes), out=file, plan={"evaluate": {"control": False}}
            )

    # A run draws the seeds of its simulations. A first run says which episode each stands for.
    with tempfile.TemporaryDirectory() as folder:
        first = written(pathlib.Path(folder) / "seeds.sqlite").path
        with contextlib.closing(sqlite3.connect(first)) as run:
            system.places = {
                int(seed): number - 1
                for number, seed in run.execute("SELECT number, seed FROM simulations")
            }
    # A copy does not know its system, which has no simulations but these.
    return copy.copy(written(out))


class _Recorded(System):
    """Episodes that were simulated elsewhere. ``places`` has the episode of each seed of a
    simulation."""

    def __init__(self, name: str, episodes: Sequence[_Episode]) -> None:
        self.name = name
        self.signals = [("success", ""), ("sum_reward", ""), ("max_reward", "")]
        self.control_dt, self.steps, self.versions, self.exceptions = 1.0, 1, [], []
        self.places: dict[int, int] = {}
        self._episodes = episodes

    def simulate(self, batch: Sequence[Request]) -> list[Outcome]:
        found = [self._episodes[self.places.get(request.seed, 0)] for request in batch]
        # A trace has two samples at least.
        return [
            Outcome(
                "completed", np.array([[each.success, each.sum_reward, each.max_reward]] * 2), 1,
                total_reward=each.sum_reward
            )
            for each in found
        ]

    def code(self) -> list[Any]:
        # A hash sees plain tuples.
        return [tuple(each) for each in self._episodes]


def _episodes(path: pathlib.Path) -> list[_Episode]:
    """Returns the episodes in a file of ``lerobot-eval``, in the order of the tasks. Files of
    LeRobot 0.3 and older have no tasks."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        if "per_episode" in document:
            return [
                _Episode(
                    "lerobot-eval", each["seed"], float(each["success"]), float(each["sum_reward"]),
                    float(each["max_reward"])
                )
                for each in document["per_episode"]
            ]
        tasks = sorted(document["per_task"], key=lambda each: (each["task_group"], each["task_id"]))
        return [
            _Episode(
                f"{each['task_group']}/{each['task_id']}", None, float(success), float(total),
                float(largest)
            )
            for each in tasks
            for success, total, largest in zip(
                *(each["metrics"][name] for name in ("successes", "sum_rewards", "max_rewards")),
                strict=True
            )
        ]
    except OSError as error:
        raise InvalidValueError(f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise InvalidValueError(
            f"{path} is not an eval_info.json of lerobot-eval: {type(error).__name__}: {error}"
        ) from error
