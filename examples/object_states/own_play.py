"""A network plays layouts of `train` by itself: to learn from that, or to tell how good it is.

Demonstrations begin with layout 0, what it plays or sees at rest to learn from with `LEARNED`, and
what networks are told apart by with `TRIED`: these never meet, and no layout of `eval` decides
anything. What counts as success is what counts everywhere.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from demonstrations import Demonstrations
from learning import once

import duobench
from duobench.core.errors import check_known
from duobench.core.randomness import TRAIN, episode_seed
from duobench.data import DataSet
from duobench.evaluation import rollout
from duobench.evaluation.runners import record
from duobench.policy import Policy
from duobench.results import find_tasks
from duobench.results.run import needed_options
from duobench.tasks import catalog
from duobench.world.robot.gripper import DEFAULT_GRIPPER

LEARNED, TRIED = 10_000, 20_000
"""Numbers of the first layouts of `train` for each of these."""
EXPORTED = (
    "--per-task",
    "--cameras",
    "none",
    "--object-state",
    "--action",
    "cartesian",
)


def practise(
    policy: str, task: str, folder: Path, episodes: int, gripper: str = DEFAULT_GRIPPER
) -> tuple[Demonstrations, dict[str, Any]]:
    """Have a policy play until so many episodes have succeeded; goes on where it was stopped.

    Args:
        policy: What plays, as `module:attribute`.
        task: Its task.
        folder: Where recordings, and their export, are written.
        episodes: How many.
        gripper: What is on the arms.

    Returns:
        The successes, as `network.py` learns from them, and what is told of them: how many
        episodes were played.

    Raises:
        TooFewSuccessesError: It hardly ever succeeds.
    """

    def play() -> dict[str, Any]:
        data = DataSet.open(folder / "episodes")
        played = record(
            policy,
            find_tasks([task]),
            data,
            episodes=episodes,
            first=LEARNED,
            gripper=gripper,
        )
        command = [sys.executable, "-m", "duobench", "export", "lerobot", data.path]
        command += ["--out", out]
        subprocess.run([*command, *EXPORTED], check=True)
        return {"successes": episodes, "played": len(played)}

    out = folder / "export"
    told = once(folder / "own.json", play)
    return Demonstrations.load(out / task, episodes), told


class Trial:
    """Trial of networks on layouts of `train`, which are the same ones every time.

    Args:
        task: The task.
        episodes: How many layouts.
        gripper: What is on the arms.

    Raises:
        UnknownNameError: There is no such task.
    """

    def __init__(
        self, task: str, episodes: int, gripper: str = DEFAULT_GRIPPER
    ) -> None:
        check_known("task", task, catalog.names())
        self.task = task
        self.episodes = episodes
        self.gripper = gripper
        self._env: Any = None

    def score(self, policy: Policy) -> tuple[int, float]:
        """How many episodes a policy succeeds in, and its mean final progress."""
        if self._env is None:
            options = needed_options(policy.metadata)
            self._env = duobench.make(
                self.task, split=TRAIN, gripper=self.gripper, **options
            )
        successes, progress = 0, []
        for number in range(TRIED, TRIED + self.episodes):
            seed = episode_seed(self.task, number, TRAIN)
            rollout(self._env, policy, seed=seed)
            judge = self._env.get_wrapper_attr("judge")
            last = len(self._env.get_wrapper_attr("definition").stages)
            successes += judge.stage == last
            progress.append(judge.stage / last)
        return successes, float(np.mean(progress))
