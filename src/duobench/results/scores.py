"""Scores of records, condition by condition: success, progress, and where episodes ended.

The quantities are those of the paper, computed from records alone, in any order.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

from duobench.results.excess import MOST, NOTABLE, Excess
from duobench.results.records import NOT_REPEATABLE, Condition, Record
from duobench.results.run import Candidate, Run
from duobench.results.suite import Suite, TaskInfo

CONFIDENCE = 0.95
"""Confidence of the intervals in tables and reports."""
TIME_POINTS = 101
"""Samples of the progress curve: 0 %, 1 %, ..., 100 % of the horizon."""
REPEATABILITY: Mapping[bool | None, str] = {
    True: "With one seed, its first answer was the same twice.",
    False: f"This policy is {NOT_REPEATABLE}: with one seed, its first answers were not the same.",
}
"""Sentences of a run on its policy, which was asked the same twice, or again by a later command."""
FAR_OFF = (
    "Limits of the arms changed most targets of an episode. Numbers in other units, such as "
    "degrees, or arms in the other order look so: the report has a table of targets beyond limits."
)
"""Sentence of a run where `RunPart.is_far_off`."""
_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?!\w)")
"""A number that is a word of its own, not a part of a name."""


def wilson_interval(
    successes: int, trials: int, confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Wilson's score interval (lower and upper end) for the probability of a success.

    It stays inside 0..1 and keeps its coverage for few trials and for rates near 0 and 1, where
    the textbook interval (rate plus or minus two standard errors) collapses to a point. Without
    trials nothing is known, and it is 0..1.
    Source: E. B. Wilson, "Probable inference, the law of succession, and statistical inference",
    J. Am. Stat. Assoc. 22 (1927).
    """
    if trials == 0:
        return 0.0, 1.0
    z = NormalDist().inv_cdf((1.0 + confidence) / 2.0)
    rate = successes / trials
    shrink = 1.0 + z * z / trials
    centre = (rate + z * z / (2 * trials)) / shrink
    half = (
        z
        / shrink
        * math.sqrt(rate * (1.0 - rate) / trials + z * z / (4 * trials * trials))
    )
    low = 0.0 if successes == 0 else max(0.0, centre - half)
    high = 1.0 if successes == trials else min(1.0, centre + half)
    return low, high


@dataclass(frozen=True, kw_only=True, slots=True)
class Score:
    """Score of a number of episodes."""

    label: str
    """Whose episodes: a task's title, a category, or all of them."""
    episodes: int
    successes: int
    errors: int
    mean_final_progress: float | None
    """Mean of last stage over the task's number of stages; None without episodes."""
    repeated: int = 0
    """Episodes that were begun more than once."""

    @property
    def success_rate(self) -> float | None:
        """Share of successes; None without episodes."""
        return self.successes / self.episodes if self.episodes else None

    @property
    def interval(self) -> tuple[float, float]:
        """95 % Wilson interval of the success rate."""
        return wilson_interval(self.successes, self.episodes)

    def numbers(self) -> dict[str, Any]:
        """Numbers of it in every file for programs."""
        return {
            "episodes": self.episodes,
            "successes": self.successes,
            "success_rate": self.success_rate,
            "wilson_95": list(self.interval),
            "mean_final_progress": self.mean_final_progress,
            "errors": self.errors,
            "begun_more_than_once": self.repeated,
        }


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskResult:
    """Results of one task."""

    task: TaskInfo
    score: Score
    last_stage_counts: tuple[int, ...]
    """Number of episodes by their highest stage: 0, 1, ..., last."""
    progress: tuple[float, ...]
    """Mean progress 0..1 after 0 %, 1 %, ..., 100 % of the horizon; empty without episodes. An
    episode that is over keeps its last stage, so that it ends at the mean final progress."""
    records: tuple[Record, ...]
    """The episodes, by index."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Results:
    """Results of a run."""

    tasks: tuple[TaskResult, ...]
    """Task by task, in the order of the run."""
    categories: tuple[Score, ...]
    """Category by category, in the order in which they first appear; episodes are pooled."""
    overall: Score
    """All episodes pooled; with equally many of each task this is the mean over the tasks."""

    def played(self, task_id: str) -> TaskResult | None:
        """The results of a task by its id; None if it has no finished episode."""
        return next(
            (one for one in self.tasks if one.task.id == task_id and one.records), None
        )


def score(label: str, records: Sequence[Record]) -> Score:
    """Add up episodes, of one task or of several."""
    return Score(
        label=label,
        episodes=len(records),
        successes=sum(record.success for record in records),
        errors=sum(record.error is not None for record in records),
        repeated=sum(record.attempt > 1 for record in records),
        mean_final_progress=(
            math.fsum(record.progress for record in records) / len(records)
            if records
            else None
        ),
    )


def progress_curve(records: Sequence[Record], horizon: int) -> tuple[float, ...]:
    """Mean progress 0..1 of episodes of one task at `TIME_POINTS` times up to the horizon."""
    if not records:
        return ()
    steps = [point * horizon // (TIME_POINTS - 1) for point in range(TIME_POINTS)]
    full = len(records) * records[0].max_stage
    return tuple(
        sum(record.stage_after(step) for record in records) / full for step in steps
    )


def task_result(task: TaskInfo, records: Iterable[Record]) -> TaskResult:
    """Results of one task from its records, in any order; records of other tasks are left out."""
    ours = sorted(
        (r for r in records if r.task == task.id), key=lambda record: record.episode
    )
    counts = Counter(record.final_stage for record in ours)
    return TaskResult(
        task=task,
        score=score(task.title, ours),
        last_stage_counts=tuple(counts[stage] for stage in range(task.max_stage + 1)),
        progress=progress_curve(ours, task.horizon),
        records=tuple(ours),
    )


def summarize(tasks: Sequence[TaskInfo], records: Sequence[Record]) -> Results:
    """Results of a run from its tasks and its finished episodes, in any order."""
    each = tuple(task_result(task, records) for task in tasks)
    categories = tuple(
        score(
            category,
            [r for one in each if one.task.category == category for r in one.records],
        )
        for category in dict.fromkeys(task.category for task in tasks)
    )
    overall = score("All tasks", [record for one in each for record in one.records])
    return Results(tasks=each, categories=categories, overall=overall)


@dataclass(frozen=True, kw_only=True, slots=True)
class RunPart:
    """Part of a run under one condition, as of a page, a row or a column."""

    run: Run
    condition: Condition
    results: Results

    @property
    def candidate(self) -> Candidate:
        """The policy."""
        return self.run.of(self.condition.policy)

    @property
    def suite(self) -> Suite:
        """The suite, with the shift of the condition alone."""
        return replace(self.run.suite, shifts=(self.condition.shift,))

    @property
    def size(self) -> int:
        """Number of episodes, finished or not."""
        return self.run.suite.size

    @property
    def records(self) -> list[Record]:
        """The finished episodes, task by task."""
        return [record for one in self.results.tasks for record in one.records]

    @property
    def is_repeatable(self) -> bool | None:
        """Whether first answers with one seed were always the same; None if none was asked for."""
        asked = {one.first_answer for one in self.records if one.first_answer}
        questions = {one.question for one in asked}
        is_same = len(asked) == len(questions)
        return (
            all(one.answer != NOT_REPEATABLE for one in asked) and is_same
            if asked
            else None
        )

    @property
    def repeatability(self) -> str:
        """The same in a sentence; empty if it was not asked."""
        return REPEATABILITY.get(self.is_repeatable, "")

    @property
    def is_far_off(self) -> bool:
        """Whether limits of the arms changed most targets of an episode, by more than a trifle."""
        return any(
            one.excess.change > NOTABLE and one.clipped > MOST * one.steps
            for one in self.records
            if one.excess and one.clipped
        )

    def facts(self, *names: str) -> dict[str, Any]:
        """Facts about the run in files for programs, by these names and in their order."""
        candidate, suite = self.candidate, self.run.suite
        facts: dict[str, Any] = {
            "policy": candidate.policy,
            "policy_name": candidate.metadata.name,
            "policy_version": candidate.metadata.version,
            "privileged": candidate.privileged,
            "repeatable": self.is_repeatable,
            "domain": self.condition.domain,
            "rig": self.run.rig,
            "trained_on": candidate.trained_on,
            "suite_version": suite.version,
            "suite": suite.label,
            "execute": suite.execution.execute,
            "latency": suite.execution.latency,
            "look": self.condition.look,
            "robot": self.condition.robot,
            "shift": self.condition.shift.name,
            "versions": self.run.versions,
            "first_episode": suite.first_episode,
            "expected_episodes": self.size,
        }
        return {name: facts[name] for name in names}


def group_by_condition(run: Run, records: Iterable[Record]) -> list[RunPart]:
    """The parts of a run in the order of its conditions, those without a record included."""
    found: dict[Condition, list[Record]] = {
        each: [] for each in run.conditions.values()
    }
    for record in records:
        found[record.condition].append(record)
    return [
        RunPart(run=run, condition=condition, results=summarize(run.suite.tasks, ours))
        for condition, ours in found.items()
    ]


@dataclass(frozen=True, kw_only=True, slots=True)
class Clipping:
    """Targets of a task that limits of the arms changed."""

    steps: int
    all_steps: int
    episodes: int
    all_episodes: int
    excess: Excess
    """The largest of every number."""


def clipping(result: TaskResult) -> Clipping | None:
    """Targets of a task beyond limits of the arms; None where no record has one."""
    known = [record for record in result.records if record.clipped is not None]
    excesses = [record.excess for record in known if record.excess is not None]
    if not excesses:
        return None
    return Clipping(
        steps=sum(record.clipped or 0 for record in known),
        all_steps=sum(record.steps for record in known),
        episodes=sum(bool(record.clipped) for record in known),
        all_episodes=len(known),
        excess=Excess.furthest(excesses),
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class FailedStage:
    """The episodes of a task that failed after the same stage."""

    stage: int
    """The last stage that they reached, 0 for none."""
    records: tuple[Record, ...]
    """The episodes, by index."""
    unmet: tuple[tuple[int, str], ...]
    """Unmet parts of the next stage, in words, and before it in how many episodes, most
    frequent first. A number that is not the same in all of them is a range."""

    @property
    def errors(self) -> int:
        """Number of episodes that failed with an error."""
        return sum(record.error is not None for record in self.records)

    @property
    def unexplained(self) -> int:
        """Number of records that do not say which constraints did not hold."""
        return sum(not (record.error or record.unmet) for record in self.records)


def failed_stages(result: TaskResult) -> tuple[FailedStage, ...]:
    """The failed episodes of a task by the last stage that they reached, lowest first."""
    failed = [record for record in result.records if not record.success]
    return tuple(
        FailedStage(stage=stage, records=tuple(ours), unmet=_unmet(ours))
        for stage in range(result.task.max_stage + 1)
        if (ours := [record for record in failed if record.final_stage == stage])
    )


def _unmet(records: Iterable[Record]) -> tuple[tuple[int, str], ...]:
    """Unmet parts of stages in episodes, without those that an error ended."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for record in records:
        if record.error is None:
            for text in dict.fromkeys(record.unmet or ()):
                alike.setdefault(tuple(_NUMBER.split(text)), []).append(text)
    found = [(len(texts), _merged(texts)) for texts in alike.values()]
    return tuple(sorted(found, key=lambda one: (-one[0], one[1])))


def _merged(texts: Sequence[str]) -> str:
    """One sentence for several that differ in numbers only: "20 to 50 mm above mat"."""
    columns = zip(*(_NUMBER.findall(text) for text in texts), strict=True)
    ranges = (_range(column) for column in columns)
    return _NUMBER.sub(lambda _: next(ranges), texts[0])


def _range(numbers: Sequence[str]) -> str:
    low, high = min(numbers, key=float), max(numbers, key=float)
    return low if float(low) == float(high) else f"{low} to {high}"


def percent(share: float | None, digits: int = 1) -> str:
    """Share as per cent; a dash for None."""
    return "–" if share is None else f"{100 * share:.{digits}f}"


def interval_percent(score: Score) -> str:
    """The Wilson interval as per cent."""
    return "–".join(map(percent, score.interval))


def progress_text(progress: float | None) -> str:
    """Mean final progress, with the two digits of the paper; a dash for None."""
    return "–" if progress is None else f"{progress:.2f}"
