"""What a run must have played to be ranked, and in what one differs from it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields

from duobench.envs.config import EnvConfig
from duobench.looks.look import Look
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.tasks import catalog

EPISODES = 100
"""Episodes of each task that count, 0 to 99, as in the paper."""
CHOSEN_BY_POLICY = frozenset(
    {
        *("cameras", "image_size", "object_state", "action_mode", "binary_gripper", "chunk"),
        *("render_mode", "render_size"),
    }
)
"""Fields of a configuration that make no episode easier or harder for the others to compare with.

What a policy sees and how it acts is its own affair. All other fields have their defaults.
"""


def counted(records: Iterable[EpisodeRecord]) -> list[EpisodeRecord]:
    """The records of episodes that a ranked run is made of."""
    return [record for record in records if record.episode < EPISODES]


def deviations(run: Run, records: Iterable[EpisodeRecord]) -> tuple[str, ...]:
    """Why a run is not ranked, one phrase each; none if it has played the whole suite.

    Args:
        run: The run.
        records: Its records.
    """
    default = EnvConfig()
    found = [
        f"{name.replace('_', ' ')} {_word(value)} instead of {expected}"
        for name in (field.name for field in fields(EnvConfig))
        if name not in CHOSEN_BY_POLICY
        and (value := getattr(run.config, name)) != (expected := getattr(default, name))
    ]
    tasks = catalog.names()
    played = {(record.task, record.episode) for record in counted(records)}
    if len(run.suite.tasks) < len(tasks):
        found.append(f"{len(run.suite.tasks)} of {len(tasks)} tasks")
    missing = {task.id: EPISODES for task in run.suite.tasks}
    for task, _ in played:
        missing[task] -= 1
    if lacking := sum(missing.values()):
        found.append(
            f"{lacking:,} of {EPISODES * len(missing):,} episodes of its tasks are missing"
        )
    return tuple(found)


def _word(value: object) -> str:
    return "of its own" if isinstance(value, Look) else str(value)
