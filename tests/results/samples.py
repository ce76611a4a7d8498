"""Made-up runs and records, for what is computed from records alone."""

import random
import re
from dataclasses import fields, replace
from itertools import product
from pathlib import Path
from typing import Any

from duobench.core.randomness import SUITE_VERSION, episode_seed, policy_seed
from duobench.envs.config import EnvConfig
from duobench.envs.execution import WHOLE_CHUNKS
from duobench.policy import PolicyMetadata
from duobench.results.excess import Excess
from duobench.results.folder import RunFolder
from duobench.results.records import EpisodeRecord, Key
from duobench.results.run import Candidate, Run, TimeLimits
from duobench.results.scores import RunPart, summarize
from duobench.results.suite import CUSTOM, Suite, TaskInfo

VERSIONS: dict[str, Any] = {"duobench": "0", "mujoco": "4.0.0", "numpy": "2.4.6"}


def _task(path: str, title: str, category: str, stages: tuple[str, ...], horizon: int) -> TaskInfo:
    name = title.split(maxsplit=1)[0].lower()
    return TaskInfo(
        reference=path, id=name, title=title, category=category, stages=stages, horizon=horizon
    )


LIFT = _task("lift", "Lift <It>", "bimanual manipulation", ("touched", "raised"), 200)
SORT = _task(
    "pkg.tasks:SORT", "Sort", "parallel execution", ("one held", "one sorted", "both sorted"), 90
)
TURN = _task("turn", "Turn", "bimanual manipulation", ("held",), 50)
TASKS = (LIFT, SORT, TURN)
CONFIG = EnvConfig(cameras=())


def sample_run(**changes: Any) -> Run:
    """Run of three tasks; changes are fields of the run, of its suite or of its one policy."""
    suite: dict[str, Any] = {"tasks": TASKS, "episodes": 4} | _taken(changes, Suite)
    policy: dict[str, Any] = {
        "policy": "mine",
        "metadata": PolicyMetadata(name="mine", version="1"),
        "config": CONFIG,
    } | _taken(changes, Candidate)
    run: dict[str, Any] = {"limits": TimeLimits(), "versions": VERSIONS}
    run |= {"suite": Suite(**suite), "candidates": (Candidate(**policy),)}
    return Run(**run | changes)


DEGREES = Excess(joint=(90.0, 2.9), opening=(1.0, 1.0), change=87.0, first=(89.5, 90.5), speed=1.0)
"""Of a policy that answers in degrees."""


def _taken(changes: dict[str, Any], kind: type) -> dict[str, Any]:
    names = [field.name for field in fields(kind) if field.name in changes]
    return {name: changes.pop(name) for name in names}


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
        **dict.fromkeys(("unmet", "start", "end", "sent", "clipped", "excess")),
        "versions": {**VERSIONS, "python": "3.11", "platform": "Linux", "renderer": None},
    }
    return EpisodeRecord(**fields | changes)


def sample_records(run: Run, seed: int = 0) -> list[EpisodeRecord]:
    """One record for every episode, of varied success."""
    rng = random.Random(seed)
    records: list[EpisodeRecord] = []
    each = product(run.candidates, run.suite.shifts, run.suite.tasks, run.suite.indices)
    for candidate, shift, task, episode in each:
        stage = rng.randint(0, task.max_stage)
        record = sample_record(
            task,
            episode,
            tuple(sorted(rng.sample(range(1, task.horizon + 1), stage))),
            run=run.hash,
            policy=candidate.policy,
            policy_version=candidate.metadata.version,
            config=replace(candidate.config, shift=shift),
            execution=run.suite.execution_of(task.id, shift),
        )
        records.append(record)
    return records


def part_of(run: Run, records: list[EpisodeRecord]) -> RunPart:
    """The one part of a run."""
    (condition,) = run.conditions.values()
    return RunPart(run=run, condition=condition, results=summarize(TASKS, records))


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
