"""What records add up to, condition by condition: success, progress, and where episodes ended.

The quantities are those of the paper, computed from records alone, in whatever order they come.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

from duobench.results.attempts import MARK, MARKED, repeats_text
from duobench.results.excess import MOST, NOTABLE
from duobench.results.records import NOT_REPEATABLE, Condition, EpisodeRecord
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
    """What a number of episodes add up to."""

    label: str
    """Whose episodes: a task's title, a category, or all of them."""
    episodes: int
    successes: int
    errors: int
    mean_final_progress: float | None
    """Mean of last stage over the task's number of stages; None without episodes."""
    repeated: int = 0
    """Episodes that were begun more than once."""
    repeated_successes: int = 0
    """How many of them succeeded."""

    @property
    def worst_rate(self) -> float | None:
        """Share of successes if every episode that was begun more than once had failed."""
        worst = self.successes - self.repeated_successes
        return worst / self.episodes if self.episodes else None

    @property
    def is_marked(self) -> bool:
        """Whether that is another number by more than `MARKED`."""
        return self.repeated_successes > MARKED * self.episodes

    @property
    def success_rate(self) -> float | None:
        """Share of successes; None without episodes."""
        return self.successes / self.episodes if self.episodes else None

    @property
    def interval(self) -> tuple[float, float]:
        """95 % Wilson interval of the success rate."""
        return wilson_interval(self.successes, self.episodes)

    def numbers(self) -> dict[str, Any]:
        """What every file for programs has of it."""
        return {
            "episodes": self.episodes,
            "successes": self.successes,
            "success_rate": self.success_rate,
            "wilson_95": list(self.interval),
            "mean_final_progress": self.mean_final_progress,
            "errors": self.errors,
            "begun_more_than_once": self.repeated,
            "worst_case_success_rate": self.worst_rate,
        }


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskResult:
    """Results of one task."""

    task: TaskInfo
    score: Score
    last_stage_counts: tuple[int, ...]
    """How many episodes ended with stage 0, 1, ..., last as their highest."""
    progress: tuple[float, ...]
    """Mean progress 0..1 after 0 %, 1 %, ..., 100 % of the horizon; empty without episodes. An
    episode that is over keeps its last stage, so that it ends at the mean final progress."""
    records: tuple[EpisodeRecord, ...]
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


def score(label: str, records: Sequence[EpisodeRecord]) -> Score:
    """Add up episodes, of one task or of several."""
    return Score(
        label=label,
        episodes=len(records),
        successes=sum(record.success for record in records),
        errors=sum(record.error is not None for record in records),
        repeated=sum(record.attempt > 1 for record in records),
        repeated_successes=sum(
            record.success for record in records if record.attempt > 1
        ),
        mean_final_progress=(
            math.fsum(record.progress for record in records) / len(records)
            if records
            else None
        ),
    )


def progress_curve(records: Sequence[EpisodeRecord], horizon: int) -> tuple[float, ...]:
    """Mean progress 0..1 of episodes of one task at `TIME_POINTS` times up to the horizon."""
    if not records:
        return ()
    steps = [point * horizon // (TIME_POINTS - 1) for point in range(TIME_POINTS)]
    full = len(records) * records[0].max_stage
    return tuple(
        sum(record.stage_after(step) for record in records) / full for step in steps
    )


def task_result(task: TaskInfo, records: Iterable[EpisodeRecord]) -> TaskResult:
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


def summarize(tasks: Sequence[TaskInfo], records: Sequence[EpisodeRecord]) -> Results:
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
    """What was played of a run under one condition: what a page, a row or a column is about."""

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
        """How many episodes it has, finished or not."""
        return self.run.suite.size

    @property
    def records(self) -> list[EpisodeRecord]:
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
    def repeats(self) -> str:
        """How many episodes were begun more than once, why, and the worst case; or nothing."""
        said = repeats_text(record.earlier for record in self.records)
        overall = self.results.overall
        if not overall.repeated_successes:
            return said
        worst, rate = percent(overall.worst_rate), percent(overall.success_rate)
        return f"{said} Counted as failures, they would make success {worst} % instead of {rate} %."

    @property
    def excess(self) -> str:
        """How far a policy asked for more than the arms do, and why perhaps; or nothing."""
        told = [
            (found, clipped, one.steps)
            for one in self.records
            if (found := one.excess) and (clipped := one.clipped)
            if found.questions
            or (found.change > NOTABLE and clipped > MOST * one.steps)
        ]
        if not told:
            return ""
        found, clipped, steps = zip(*told, strict=True)
        return (
            f"Limits of the arms changed what was to be sent in {sum(clipped)} of {sum(steps)} "
            f"control steps of {len(told)} of {len(self.records)} episodes: "
            f"{max(found, key=lambda one: one.change)}."
        )

    def facts(self, *names: str) -> dict[str, Any]:
        """What files for programs say of what was run, by these names and in their order."""
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
            "shift": self.condition.shift.name,
            "versions": self.run.versions,
            "first_episode": suite.first_episode,
            "expected_episodes": self.size,
        }
        return {name: facts[name] for name in names}


def group_by_condition(run: Run, records: Iterable[EpisodeRecord]) -> list[RunPart]:
    """The parts of a run in the order of its conditions, those without a record included."""
    found: dict[Condition, list[EpisodeRecord]] = {
        each: [] for each in run.conditions.values()
    }
    for record in records:
        found[record.condition].append(record)
    return [
        RunPart(run=run, condition=condition, results=summarize(run.suite.tasks, ours))
        for condition, ours in found.items()
    ]


def clipping(result: TaskResult) -> dict[str, int]:
    """How often limits of the arms changed commands of a task; empty if no record knows it."""
    known = [
        (record.clipped, record.steps)
        for record in result.records
        if record.clipped is not None
    ]
    if not known:
        return {}
    return {
        "steps": sum(clipped for clipped, _ in known),
        "all_steps": sum(steps for _, steps in known),
        "episodes": sum(clipped > 0 for clipped, _ in known),
        "all_episodes": len(known),
    }


@dataclass(frozen=True, kw_only=True, slots=True)
class FailedStage:
    """The episodes of a task that failed after the same stage."""

    stage: int
    """The last stage that they reached, 0 for none."""
    records: tuple[EpisodeRecord, ...]
    """The episodes, by index."""
    unmet: tuple[tuple[int, str], ...]
    """What did not hold of the next stage, in words, and before it in how many episodes, most
    frequent first. A number that is not the same in all of them is a range."""

    @property
    def errors(self) -> int:
        """How many of them failed with an error."""
        return sum(record.error is not None for record in self.records)

    @property
    def unexplained(self) -> int:
        """How many of them have a record that does not say what did not hold."""
        return sum(not (record.error or record.unmet) for record in self.records)


def failed_stages(result: TaskResult) -> tuple[FailedStage, ...]:
    """The failed episodes of a task by the last stage that they reached, lowest first."""
    failed = [record for record in result.records if not record.success]
    return tuple(
        FailedStage(stage=stage, records=tuple(ours), unmet=_unmet(ours))
        for stage in range(result.task.max_stage + 1)
        if (ours := [record for record in failed if record.final_stage == stage])
    )


def _unmet(records: Iterable[EpisodeRecord]) -> tuple[tuple[int, str], ...]:
    """What did not hold in episodes, without those that an error ended."""
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


def percent(share: float | None) -> str:
    """A share as per cent with one digit; a dash where there is none."""
    return "–" if share is None else f"{100 * share:.1f}"


def rate_text(score: Score) -> str:
    """Success rate as per cent, marked if repeated attempts may have earned more than a point."""
    return f"{percent(score.success_rate)}{MARK * score.is_marked}"


def interval_percent(score: Score) -> str:
    """The Wilson interval as per cent."""
    return "–".join(map(percent, score.interval))


def progress_text(score: Score) -> str:
    """Mean final progress with three digits; a dash where there is none."""
    return (
        "–" if score.mean_final_progress is None else f"{score.mean_final_progress:.3f}"
    )
