"""Policies that sample without their seed, from generators of many kinds; processes import them."""

import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from duobench.policy import HoldPolicy

STAND_INS = str(Path(__file__).parent / "stand_ins")
SIZE = 16


class Diffuses(HoldPolicy):
    """Samples with torch, which it imports for its first answer, and makes its model there too."""

    model: Any = None

    def act(self, observation: Mapping[str, Any]) -> np.ndarray:
        if STAND_INS not in sys.path:
            sys.path.insert(0, STAND_INS)
        import torch

        if self.model is None:
            self.model = torch.cuda.randn(SIZE) + torch.randn(SIZE)
        noise = torch.randn(SIZE) + torch.cuda.randn(SIZE)
        time.sleep(0.001)  # lets episodes beside this one in between
        return super().act(observation) + 0.01 * (noise + 0.1 * self.model / SIZE)


class Imports(Diffuses):
    """Is made with weights that no seed decides, after torch is there."""

    def __init__(self) -> None:
        super().__init__()
        if STAND_INS not in sys.path:
            sys.path.insert(0, STAND_INS)
        import torch

        self.model = torch.randn(SIZE) + np.random.normal(size=SIZE)  # noqa: NPY002


class AsksTheSystem(HoldPolicy):
    """Takes its noise from the operating system."""

    def act(self, observation: Mapping[str, Any]) -> np.ndarray:
        return super().act(observation) + 1e-4 * np.frombuffer(os.urandom(SIZE), np.uint8)


class Remembers(HoldPolicy):
    """Counts its answers, whatever a reset says."""

    answers = 0

    def act(self, observation: Mapping[str, Any]) -> np.ndarray:
        self.answers += 1
        return super().act(observation) + 1e-3 * self.answers


class Drifts(HoldPolicy):
    """Answers as a file says that another command may have changed."""

    def act(self, observation: Mapping[str, Any]) -> np.ndarray:
        return super().act(observation) + float(os.environ.get("DUOBENCH_TEST_DRIFT", "0"))


class Orders(HoldPolicy):
    """Goes through a set of texts, whose order follows from hashes."""

    def act(self, observation: Mapping[str, Any]) -> np.ndarray:
        order = [*{f"part {k}" for k in range(16)}]
        return super().act(observation) + 1e-3 * np.array([int(part[5:]) for part in order])
