"""Made-up runs and records, for what is computed from records alone."""

import random
import re
from pathlib import Path
from typing import Any

from duobench.envs.config import EnvConfig
from duobench.policy import PolicyMetadata
from duobench.randomness import SUITE_VERSION, episode_seed, policy_seed
from duobench.results.folder import RunFolder
from duobench.results.limits import TimeLimits
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import Suite, TaskInfo

VERSIONS: dict[str, Any] = {"duobench": "0", "mujoco": "4.0.0", "numpy": "2.4.6"}

LIFT = TaskInfo(
    reference="lift",
    id="lift",
    title="Lift <It>",
    category="bimanual manipulation",
    stages=("touched", "raised"),
    horizon=200,
)
SORT = TaskInfo(
    reference="pkg.tasks:SORT",
    id="sort",
    title="Sort",
    category="parallel execution",
    stages=("one held", "one sorted", "both sorted"),
    horizon=90,
)
TURN = TaskInfo(
    reference="turn",
    id="turn",
    title="Turn",
    category="bimanual manipulation",
    stages=("held",),
    horizon=50,
)
TASKS = (LIFT, SORT, TURN)


CONFIG = EnvConfig(cameras=())


def sample_run(**changes: Any) -> Run:
    """Run of three tasks; changes are fields of the run or of its suite."""
    suite: dict[str, Any] = {
        "tasks": TASKS,
        "episodes": 4,
        "first_episode": 0,
        "version": SUITE_VERSION,
        "overtime": 1.0,
    }
    suite["look"] = "default"
    fields: dict[str, Any] = {
        "policy": "mine",
        "videos": 1,
        "limits": TimeLimits(),
        "metadata": PolicyMetadata(name="mine", version="1"),
        "config": CONFIG,
        "versions": VERSIONS,
    }
    suite |= {name: changes.pop(name) for name in list(changes) if name in suite}
    return Run(**{"suite": Suite(**suite)} | fields | changes)


def sample_record(
    task: TaskInfo = SORT,
    episode: int = 0,
    reached: tuple[int, ...] = (10, 20, 30),
    error: str | None = None,
    **changes: Any,
) -> EpisodeRecord:
    """Record of an episode that reached stage k after reached[k - 1] steps."""
    stage = len(reached)
    is_success = stage == task.max_stage and error is None
    seed = episode_seed(task.id, episode, CONFIG.split)
    fields: dict[str, Any] = {
        "suite_version": SUITE_VERSION,
        "task": task.id,
        "episode": episode,
        "seed": seed,
        "policy_seed": policy_seed(task.id, seed, CONFIG.split),
        "policy": "mine",
        "policy_version": "1",
        "config": CONFIG,
        "instruction": f"Do the {task.id}.",
        "success": is_success,
        "success_at_end": is_success,
        "final_stage": stage,
        "max_stage": task.max_stage,
        "stage_changes": tuple((step, number) for number, step in enumerate(reached, 1)),
        "steps": reached[-1] if is_success else task.horizon,
        "horizon": task.horizon,
        "terminated": is_success,
        "truncated": not is_success and error is None,
        "error": error,
        "layout": {"poses": {"cube": [0.5, 0.1, 0.0, 0.0, 0.0, 0.0, 1.0]}, "variants": {}},
        "state_hash": None if error else "ab" * 32,
        "versions": {**VERSIONS, "python": "3.11", "platform": "Linux", "renderer": None},
    }
    return EpisodeRecord(**fields | changes)


def sample_records(run: Run, seed: int = 0) -> list[EpisodeRecord]:
    """One record for every episode, of varied success."""
    rng = random.Random(seed)
    records = []
    for task in run.suite.tasks:
        for episode in run.suite.indices:
            stage = rng.randint(0, task.max_stage)
            reached = tuple(sorted(rng.sample(range(1, task.horizon + 1), stage)))
            records.append(sample_record(task, episode, reached))
    return records


def sample_folder(path: Path, run: Run, records: list[EpisodeRecord]) -> RunFolder:
    """Run folder with these records in it."""
    folder = RunFolder(path)
    folder.begin(run)
    for record in records:
        folder.write(record, None)
    return folder


def without_times(page: str) -> str:
    """Text of a report without its block of times, of which it has one."""
    rest, count = re.subn(r'<section id="times">.*?</section>', "", page, flags=re.DOTALL)
    assert count == 1
    return rest
