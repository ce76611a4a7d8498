"""Made-up entries of a leaderboard, as if they had been verified."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from duobench.policy import PolicyMetadata
from duobench.replay.verify import Verdict
from duobench.results.leaderboard import EPISODES, BoardEntry, make_entry
from duobench.results.records import EpisodeRecord, Key
from duobench.results.run import Run
from duobench.results.suite import TaskInfo, find_tasks
from tests.results.samples import sample_record, sample_run


def entry(
    name: str,
    share: float = 0.5,
    *,
    episodes: int = EPISODES,
    tasks: Sequence[TaskInfo] = (),
    lost: int = 0,
    object_state: bool = False,
    unverifiable: Sequence[tuple[str, int]] = (),
    commands: Sequence[str] = (),
    **changes: Any,
) -> BoardEntry:
    """An entry whose policy succeeds in the first episodes of each task and reaches nothing else.

    Args:
        name: Name of the policy.
        share: Which part of the episodes of each task are successes.
        episodes: Of each task.
        tasks: Tasks, by default all of the benchmark.
        lost: How many of the last records are not there.
        object_state: Whether the policy is privileged.
        unverifiable: What cannot be played again.
        commands: The commands that played it.
        changes: Fields of the run.
    """
    tasks = tasks or find_tasks(())
    run = sample_run(
        tasks=tuple(tasks),
        episodes=episodes,
        policy=name,
        metadata=PolicyMetadata(name="any", version="1", object_state=object_state),
        **changes,
    )
    digest = hashlib.sha256(repr((name, share, episodes)).encode()).hexdigest()
    records = of_run(run, share)
    records = records[: len(records) - lost]
    verdicts = {str(Verdict.EXACT): len(records)}
    condition = next(iter(run.conditions))
    keys = [Key(task, condition, episode) for task, episode in unverifiable]
    return make_entry(f"{name}.duobench.zip", digest, run, records, verdicts, keys, commands)


def of_run(run: Run, share: float) -> list[EpisodeRecord]:
    """Records of all episodes of a run, the first of each task successes."""
    made = []
    for task in run.suite.tasks:
        won = sample_record(task, 0, tuple(range(1, task.max_stage + 1)))
        lost = sample_record(task, 0, ())
        made += [
            replace(
                won if episode < share * run.suite.episodes else lost,
                episode=episode,
                policy=run.candidate.policy,
                config=run.candidate.config,
            )
            for episode in run.suite.indices
        ]
    return made
