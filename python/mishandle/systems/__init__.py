"""What is simulated: functions, programs, tasks, and environments of Gymnasium."""

from mishandle._native import TrainingEpisodes
from mishandle.systems.processes import Process
from mishandle.systems.reductions import Reduced
from mishandle.systems.scenario_environments import ScenarioEnv
from mishandle.systems.task_environments import TaskEnv, TaskVectorEnv

__all__ = ["Process", "Reduced", "ScenarioEnv", "TaskEnv", "TaskVectorEnv", "TrainingEpisodes"]
