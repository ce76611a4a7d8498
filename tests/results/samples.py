"""Made-up runs and records, for what is computed from records alone."""

import random
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

from duobench.envs.config import EnvConfig
from duobench.envs.execution import WHOLE_CHUNKS
from duobench.policy import PolicyMetadata
from duobench.randomness import SUITE_VERSION, episode_seed, policy_seed
from duobench.results.folder import RunFolder
from duobench.results.limits import TimeLimits
from duobench.results.records import EpisodeRecord, Key
from duobench.results.run import Candidate, Run
from duobench.results.suite import CUSTOM, Suite, TaskInfo
from duobench.shifts.shift import NO_SHIFT

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
    """Run of three tasks; changes are fields of the run, of its suite or of its one policy."""
    suite: dict[str, Any] = {
        "tasks": TASKS,
        "episodes": 4,
        "first_episode": 0,
        "version": SUITE_VERSION,
        "overtime": 1.0,
    }
    suite |= {"look": "default", "shifts": (NO_SHIFT,)}
    policy: dict[str, Any] = {
        "policy": "mine",
        "metadata": PolicyMetadata(name="mine", version="1"),
        "config": CONFIG,
        "batching": None,
        "trained_on": "",
    }
    fields: dict[str, Any] = {"limits": TimeLimits(), "versions": VERSIONS}
    for part in (suite, policy):
        part |= {name: changes.pop(name) for name in list(changes) if name in part}
    candidates = (Candidate(**policy),)
    return Run(**{"suite": Suite(**suite), "candidates": candidates} | fields | changes)


def key(folder: RunFolder, task: str, episode: int) -> Key:
    """What names an episode under the first condition of the run in a folder."""
    return Key(task, next(iter(folder.read_run().conditions)), episode)


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
        "run": sample_run().hash,
        "suite_version": SUITE_VERSION,
        "suite": CUSTOM,
        "execution": WHOLE_CHUNKS,
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
        "unmet": None,
        "start": None,
        "end": None,
        "sent": None,
        "clipped": None,
        "versions": {**VERSIONS, "python": "3.11", "platform": "Linux", "renderer": None},
    }
    return EpisodeRecord(**fields | changes)


def sample_records(run: Run, seed: int = 0) -> list[EpisodeRecord]:
    """One record for every episode, of varied success."""
    rng = random.Random(seed)
    records = []
    for candidate in run.candidates:
        for shift in run.suite.shifts:
            for task in run.suite.tasks:
                for episode in run.suite.indices:
                    stage = rng.randint(0, task.max_stage)
                    reached = tuple(sorted(rng.sample(range(1, task.horizon + 1), stage)))
                    record = sample_record(
                        task,
                        episode,
                        reached,
                        run=run.hash,
                        policy=candidate.policy,
                        policy_version=candidate.metadata.version,
                        config=replace(candidate.config, shift=shift),
                        execution=run.suite.execution_of(task.id, shift),
                    )
                    records.append(record)
    return records


def sample_folder(path: Path, run: Run, records: list[EpisodeRecord]) -> RunFolder:
    """Run folder with these records in it."""
    folder = RunFolder(path)
    folder.begin(run)
    for record in records:
        folder.write(replace(record, run=run.hash))
    return folder


def without_times(page: str) -> str:
    """Text of a report without its block of times, of which it has one."""
    rest, count = re.subn(r'<section id="times">.*?</section>', "", page, flags=re.DOTALL)
    assert count == 1
    return rest
