"""Self-imitation: a network plays layouts of `train`, and learns from what succeeded as well.

Nobody shows it anything more: what counts as success is what counts everywhere, and is recorded
like a demonstration. `table.py --self-imitation N` does that for every task.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from demonstrations import Demonstrations

from duobench.data import DataSet
from duobench.data.lerobot.export import export_lerobot
from duobench.data.lerobot.options import ExportOptions
from duobench.results.suite import find_tasks
from duobench.runners import record


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
    options = ExportOptions(cameras=(), object_state=True, action="cartesian")
    export_lerobot(data, folder / "export", options, per_task=True)
    done = Demonstrations.load(folder / "export" / task, successes)
    return done, {"successes": successes, "played": len(played)}
