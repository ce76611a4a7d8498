"""What experts solve on the axes layout, physics and latency: the bound of the suite `robust`.

`nice python -m dev.benchmarks.bounds --out bounds.jsonl` plays 20 episodes of each task at each
level
and prints one table an axis. Each finished episode is a line of the file: the same command goes on
where it was stopped, `--table` prints what is there and plays nothing, and files of several
machines may be put together. `--ignore-lowered` plays every level as it is for tasks whose bounds
are not lowered.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import duobench
from dev.benchmarks.steps import Steps
from duobench.core.randomness import SUITE_VERSION, episode_seed
from duobench.envs.execution import ChunkExecution
from duobench.evaluation import policies
from duobench.evaluation.rollout import rollout
from duobench.tasks import catalog
from duobench.tasks.shifts import levels
from duobench.tasks.shifts.levels import latency_steps
from duobench.tasks.shifts.shift import ALL_AXES, LATENCY, LAYOUT, LEVELS, PHYSICS, Shift

BOUNDED = (LAYOUT, PHYSICS, LATENCY)
"""Axes that an expert meets; it sees neither images nor words."""
EPISODES = 20
GOOD = 0.9
"""Share of episodes that an expert has to solve; below it a level is lowered."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Job:
    """One condition of a task."""

    task: str
    axis: str
    level: int
    episodes: tuple[int, ...]
    ignores_lowered: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class Outcome:
    """How one episode ended."""

    suite: str
    task: str
    axis: str
    level: int
    episode: int
    stage: int
    success: bool
    steps: int


def play(job: Job) -> list[Outcome]:
    """Play one condition in this process."""
    if job.ignores_lowered:
        levels.LOWERED = {}  # type: ignore[misc] - of this process alone
    shift = Shift(axis=job.axis, level=job.level)
    env = duobench.make(job.task, cameras=False, shift=shift)
    policy = policies.source("expert").bind(env)
    execution = ChunkExecution(latency=latency_steps(shift, job.task))
    outcomes = []
    for episode in job.episodes:
        steps = Steps()
        seed = episode_seed(job.task, episode)
        rollout(env, policy, seed=seed, watchers=[steps], execution=execution)
        last = steps[-1]
        outcomes.append(
            Outcome(
                suite=SUITE_VERSION,
                task=job.task,
                axis=job.axis,
                level=job.level,
                episode=episode,
                stage=last.info["stage"],
                success=last.info["success"],
                steps=last.number,
            )
        )
    env.close()
    return outcomes


def read(path: Path) -> list[Outcome]:
    """The finished episodes in a file, without a last line that was cut off."""
    lines = path.read_text(encoding="utf-8").split("\n")[:-1] if path.exists() else []
    return [Outcome(**json.loads(line)) for line in lines]


def missing(jobs: Iterable[Job], done: Sequence[Outcome]) -> list[Job]:
    """What is left of jobs, without those of which nothing is."""
    there = {(each.task, each.axis, each.level, each.episode) for each in done}
    left = []
    for job in jobs:
        key = job.task, job.axis, job.level
        episodes = tuple(each for each in job.episodes if (*key, each) not in there)
        if episodes:
            left.append(Job(**{**asdict(job), "episodes": episodes}))
    return left


def table(outcomes: Sequence[Outcome], axis: str) -> str:
    """Successes of episodes by task and level, as Markdown; what is below 90 % is bold."""
    cells: defaultdict[tuple[str, int], list[bool]] = defaultdict(list)
    for each in outcomes:
        if each.axis == axis:
            cells[each.task, each.level].append(each.success)
    found = sorted({level for _, level in cells})
    heading = ["task", *(f"level {level}" for level in found)]
    rows = [heading, ["---"] * len(heading)]
    played = {task for task, _ in cells}
    for task in (name for name in catalog.names() if name in played):
        rows.append([f"`{task}`", *(_cell(cells[task, level]) for level in found)])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _cell(won: Sequence[bool]) -> str:
    text = f"{sum(won)}/{len(won)}" if won else "–"
    return text if sum(won) >= GOOD * len(won) else f"**{text}**"


def main() -> None:
    """Play what the arguments name, and print one table an axis."""
    parser = argparse.ArgumentParser(prog="python -m dev.benchmarks.bounds", description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--axes", nargs="+", choices=(*BOUNDED, ALL_AXES), default=BOUNDED)
    parser.add_argument("--levels", nargs="+", type=int, default=range(1, LEVELS + 1))
    parser.add_argument("--tasks", nargs="+", choices=catalog.names(), default=catalog.names())
    parser.add_argument("--episodes", type=int, default=EPISODES)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--ignore-lowered", action="store_true")
    parser.add_argument("--table", action="store_true", help="play nothing")
    arguments = parser.parse_args()
    jobs = [
        Job(
            task=task,
            axis=axis,
            level=level,
            episodes=tuple(range(arguments.episodes)),
            ignores_lowered=arguments.ignore_lowered,
        )
        for task in arguments.tasks
        for axis in arguments.axes
        for level in arguments.levels
    ]
    if not arguments.table:
        run(missing(jobs, read(arguments.out)), arguments.out, arguments.workers)
    outcomes = read(arguments.out)
    for axis in dict.fromkeys(each.axis for each in outcomes):
        print(f"{axis}\n\n{table(outcomes, axis)}\n")


def run(jobs: Sequence[Job], out: Path, workers: int) -> None:
    """Play jobs side by side, and append what comes out to a file as it comes."""
    if out.exists() and not out.read_text(encoding="utf-8").endswith("\n"):
        out.write_text("".join(_line(each) for each in read(out)), encoding="utf-8")
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        for outcomes in pool.imap_unordered(play, jobs):
            with out.open("a", encoding="utf-8") as file:
                file.write("".join(map(_line, outcomes)))


def _line(outcome: Outcome) -> str:
    facts: Mapping[str, object] = asdict(outcome)
    return json.dumps(facts) + "\n"


if __name__ == "__main__":
    main()
