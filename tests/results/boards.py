"""Made-up entries of a leaderboard, as if they had been verified."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from duobench.evaluation.replay.verify import Verdict
from duobench.policy import PolicyMetadata
from duobench.results.leaderboard import EPISODES, BoardEntry, make_entry
from duobench.results.records import EpisodeRecord, Key
from duobench.results.run import Run
from duobench.results.salt import Round
from duobench.results.suite import TaskInfo, find_tasks
from tests.results.samples import sample_record, sample_run


def entry(  # noqa: PLR0913
    name: str,
    share: float = 0.5,
    *,
    episodes: int = EPISODES,
    tasks: Sequence[TaskInfo] = (),
    lost: int = 0,
    object_state: bool = False,
    unverifiable: Sequence[tuple[str, int]] = (),
    commands: Sequence[str] = (),
    hosted: Round | None = None,
    repeated: int = 0,
    noted: int | None = None,
    **changes: Any,
) -> BoardEntry:
    """An entry whose policy succeeds in the first episodes of each task and reaches nothing else.

    A share of the episodes of each task are successes; the last records may be lost, some may be
    unverifiable, the first begun twice, the attempts of some noted, and changes are fields of the
    run. Without tasks it has those of the benchmark.
    """
    run = sample_run(
        tasks=tuple(tasks or find_tasks(())),
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
    for number, record in enumerate(records[:repeated]):
        records[number] = replace(record, attempt=2, earlier=("policy",))
    return make_entry(
        f"{name}.duobench.zip",
        digest,
        run,
        records,
        verdicts,
        keys,
        noted={record.key.path for record in records[:noted]},
        commands=commands,
        hosted=hosted,
    )


def of_run(run: Run, share: float) -> list[EpisodeRecord]:
    """Records of all episodes of a run, the first of each task successes."""
    made: list[EpisodeRecord] = []
    candidate = run.candidate
    for task in run.suite.tasks:
        won, lost = (
            sample_record(task, 0, reached, policy=candidate.policy, config=candidate.config)
            for reached in (tuple(range(1, task.max_stage + 1)), ())
        )
        made += [
            replace(won if episode < share * run.suite.episodes else lost, episode=episode)
            for episode in run.suite.indices
        ]
    return made
