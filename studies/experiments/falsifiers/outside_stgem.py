"""STGEM's `falsify` with its default test generator, OGAN: random tests first, then tests of a generative adversarial network.

STGEM scales robustness by the range of the output, which a user must state. Here it is three times the first value, clipped.
"""

import contextlib
import io
import warnings
from typing import Any

import numpy as np
import torch
from stgem.features import FeatureVector, Real
from stgem.sut import SystemUnderTest
from stgem.task import falsify
from trial import Trial


class System(SystemUnderTest):
    def __init__(self, trial: Trial) -> None:
        super().__init__()
        self.trial, self.scale = trial, 0.0

    def new_ifv(self) -> FeatureVector:
        return FeatureVector(features=[Real(f"x{index}", 0, 1) for index in range(self.trial.system.dimension)])

    def new_ofv(self) -> FeatureVector:
        return FeatureVector(features=[Real("robustness", -1, 1)])

    def from_ifv_to_testinput(self, input_fv: FeatureVector) -> list[float]:
        return input_fv.to_list()

    def execute_test(self, test_input: list[float]) -> tuple[float, dict[str, Any]]:
        value = self.trial.one(np.array(test_input))
        self.scale = self.scale or 3 * abs(value) or 1.0
        return float(np.clip(value / self.scale, -1, 1)), {}

    def from_testouput_to_ofv(self, output: float) -> FeatureVector:
        return FeatureVector(values=[output], features=[Real("robustness", -1, 1)])


def ogan(trial: Trial) -> None:
    torch.set_num_threads(1)
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        warnings.simplefilter("ignore")
        falsify(System(trial), "robustness >= 0", limit=trial.budget, seed=trial.seed)
