"""Self-imitation: a network plays layouts of `train`, and learns from what succeeded as well.

Nobody shows it anything more: what counts as success is what counts everywhere, and is recorded
like a demonstration. `table.py --self-imitation N` does that for every task.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

from demonstrations import Demonstrations

from duobench.data import DataSet
from duobench.evaluation.runners import record
from duobench.results.suite import find_tasks

EXPORTED = ("--per-task", "--cameras", "none", "--object-state", "--action", "cartesian")


def practise(
    policy: str, task: str, folder: Path, successes: int
) -> tuple[Demonstrations, dict[str, Any]]:
    """Have a policy play until so many episodes have succeeded; goes on where it was stopped.

    Returns:
        The successes, as `network.py` learns from them, and what is told of them: how many
        episodes were played.

    Raises:
        TooFewSuccessesError: It hardly ever succeeds.
    """
    data = DataSet.open(folder / "episodes")
    played = record(policy, find_tasks([task]), data, episodes=successes)
    out = folder / "export"
    command = [sys.executable, "-m", "duobench", "export", "lerobot", data.path, "--out", out]
    subprocess.run([*command, *EXPORTED], check=True)
    done = Demonstrations.load(out / task, successes)
    return done, {"successes": successes, "played": len(played)}
