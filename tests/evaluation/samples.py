"""Made-up runs and records, for what is computed from records alone."""

import random
from pathlib import Path
from typing import Any

from duobench.evaluation.folder import RunFolder
from duobench.evaluation.records import EpisodeRecord, write_record
from duobench.evaluation.run import Run, TaskInfo

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


def sample_run(**changes: Any) -> Run:
    """Run of three tasks."""
    fields: dict[str, Any] = {
        "policy": "mine",
        "tasks": TASKS,
        "episodes": 4,
        "first_episode": 0,
        "videos": 1,
        "suite_version": "1",
        "versions": VERSIONS,
    }
    return Run(**fields | changes)


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
    fields: dict[str, Any] = {
        "suite_version": "1",
        "task": task.id,
        "episode": episode,
        "seed": 1000 + episode,
        "policy": "mine",
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
        "fingerprint": None if error else "ab" * 32,
        "versions": {**VERSIONS, "python": "3.11", "platform": "Linux", "renderer": None},
    }
    return EpisodeRecord(**fields | changes)


def sample_records(run: Run, seed: int = 0) -> list[EpisodeRecord]:
    """One record for every episode, of varied success."""
    rng = random.Random(seed)
    records = []
    for task in run.tasks:
        for episode in run.episode_indices:
            stage = rng.randint(0, task.max_stage)
            reached = tuple(sorted(rng.sample(range(1, task.horizon + 1), stage)))
            records.append(sample_record(task, episode, reached))
    return records


def sample_folder(path: Path, run: Run, records: list[EpisodeRecord]) -> RunFolder:
    """Run folder with these records in it."""
    folder = RunFolder(path)
    folder.begin(run)
    for record in records:
        write_record(folder.record(record.task, record.episode), record)
    return folder
