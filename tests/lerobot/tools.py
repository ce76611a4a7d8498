"""What tests with LeRobot share: short recordings, small trainings, and its programs."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.data import Recorder

HERE = Path(__file__).parent
HAS_GROOT = find_spec("tree") is not None
"""Whether dm-tree is here, which GR00T needs."""
NEEDS_GROOT = pytest.mark.skipif(
    not HAS_GROOT, reason="dm-tree is not installed here: delete .venv-lerobot, make test-lerobot"
)
SCRIPTS = Path(sys.executable).parent
QUICK = ("--batch_size=2", "--num_workers=0", "--policy.device=cpu", "--log_freq=1")
TINY = (
    *QUICK,
    "--policy.dim_model=32",
    "--policy.n_heads=2",
    "--policy.dim_feedforward=32",
    "--policy.n_encoder_layers=1",
    "--policy.n_vae_encoder_layers=1",
)
"""What makes a training of ACT small enough for a test; the last of two equal options counts."""
OFFLINE = {"HF_HUB_OFFLINE": "1", "HF_DATASETS_OFFLINE": "1", "OMP_NUM_THREADS": "1"}


def record(env: Recorder, seed: int = 0) -> None:
    """An episode in which the arms move a little, until the environment ends it."""
    observation, _ = env.reset(seed=seed)
    home, over, step = observation["agent_pos"].astype(float), False, 0
    while not over:
        step += 1
        _, _, _, over, _ = env.step(home + 0.05 * np.sin(step / 5))
    env.close()


def load(root: Path, **options: Any) -> Any:
    """A data set, as LeRobot reads it."""
    from lerobot.datasets import LeRobotDataset

    return LeRobotDataset("duobench/demos", root=root, video_backend="pyav", **options)


def run(command: list[str], folder: Path | None = None, **variables: str) -> str:
    """What a program printed that ended well, without the net; those of LeRobot are found."""
    path = os.pathsep.join([str(SCRIPTS), os.environ["PATH"]])
    result = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, **OFFLINE, "PATH": path, **variables},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, (result.stdout + result.stderr)[-3000:]
    return result.stdout
