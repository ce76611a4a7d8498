"""Generating demonstrations: a policy is recorded until every task has enough good episodes.

Which episodes those are does not depend on the number of workers or on interruptions: the first
ones, by index, that succeed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from duobench.data import DataSet, Recording
from duobench.data.dataset import EPISODES, SUFFIX
from duobench.data.schema import AFTER_SUCCESS_S, steps_after_success
from duobench.envs.config import FIXED
from duobench.errors import OtherRunError, TooFewSuccessesError, UnplayedError
from duobench.evaluation.episode import EpisodeResult, Job, RecordingPlan
from duobench.evaluation.policies import PolicyChoice
from duobench.evaluation.rollout import Observer
from duobench.files import begin_or_continue, encode, locked, read, remove_temporary, write
from duobench.randomness import TRAIN
from duobench.results.limits import TimeLimits
from duobench.results.run import RUN_SCHEMA, Run
from duobench.results.suite import Episode, Suite, TaskInfo
from duobench.runners.executor import executor_for
from duobench.types import CONTROL_HZ

RUN, ATTEMPTS = "record.json", "attempts.json"
"""What is recorded, and how the episodes went that were played for it."""
ATTEMPTS_SCHEMA = 1
MAX_EPISODES_PER_SUCCESS = 10
"""Episodes that are played for one that succeeds, on average, before a task is given up."""


@dataclass(frozen=True, kw_only=True, slots=True, order=True)
class Attempt:
    """An episode that was played for a data set; sorted by task and index."""

    task: str
    episode: int
    """Index of the episode in its split."""
    success: bool
    stage: int
    """The last stage that it reached."""
    steps: int
    """Control steps until it succeeded or ended."""
    kept: bool
    """Whether it is in the data set."""
    error: str | None
    """The last line of the error that it failed with."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Attempts:
    """All of them, by task and index."""

    attempts: tuple[Attempt, ...] = ()
    """In order."""
    command: str = ""
    """The command that played the last of them; empty if there was none."""


def record(  # noqa: PLR0913
    policy: str,
    tasks: Sequence[TaskInfo],
    data: DataSet,
    *,
    episodes: int = 50,
    split: str = TRAIN,
    instructions: str = FIXED,
    keep_failures: bool = False,
    after_success: float = AFTER_SUCCESS_S,
    limits: TimeLimits | None = None,
    workers: int = 1,
    observers: Sequence[Observer[Attempt]] = (),
    command: str = "",
) -> list[Attempt]:
    """Record episodes of a policy until a data set has enough of every task.

    Args:
        policy: `expert`, a baseline's name, or `module:attribute`.
        tasks: What to record.
        data: Where; a data set that holds the same recording is continued.
        episodes: How many successful episodes of each task.
        split: Layouts that the episodes begin with. Those of "eval" are what policies are evaluated
            on: what learns from them cannot be evaluated any more.
        instructions: What the policy is told: the task's instruction ("fixed"), or in each episode
            one that is sampled from it and the task's paraphrases ("varied").
        keep_failures: Keep every episode, and count it, whether it succeeds or not.
        after_success: Seconds that a recording goes on after success, rounded to control steps; 0
            ends it there.
        limits: How long the policy may take.
        workers: Processes that play side by side; with 0 this process plays.
        observers: Called about the progress, in this process.
        command: The command that starts the recording, for the list of attempts.

    Returns:
        Every episode that was played, by task and index.

    Raises:
        OtherRunError: If the data set holds another recording.
        OutputError: If it is in use or cannot be written.
        TooFewSuccessesError: If the policy hardly ever succeeds; what is finished is kept.
        UnplayedError: If an episode could not be played because a process died in it each time.
        PolicyError: If the policy cannot be made, or does not fit the environment.
        OptionError: If the seconds after success are negative or not finite.
    """
    plan = RecordingPlan(
        split=split,
        keep_failures=keep_failures,
        after_success=steps_after_success(after_success) / CONTROL_HZ,
        instructions=instructions,
    )
    job = Job(
        policy=PolicyChoice.parse(policy),
        suite=Suite(tasks=tuple(tasks), episodes=episodes),
        limits=limits or TimeLimits(),
        recording=plan,
    )
    executor = executor_for(job, workers)
    with locked(data.path), closing(executor):
        run = executor.prepare()
        log = _begin(data, run, plan)
        for observer in observers:
            observer.on_run_start(run, list(log.values()))
        while missing := [
            Episode(task=task, index=index, split=split)
            for task in job.suite.tasks
            for index in _next(task, log, episodes)
        ]:
            for result in executor.play(missing):
                attempt = _write(data, result)
                log[attempt.task, attempt.episode] = attempt
                played = Attempts(attempts=tuple(sorted(log.values())), command=command)
                write(data.path / ATTEMPTS, encode(played, ATTEMPTS_SCHEMA))
                for observer in observers:
                    observer.on_episode(attempt)
            if executor.unplayed:
                raise UnplayedError.of(
                    {f"{e.task.id}, episode {e.index}": why for e, why in executor.unplayed.items()}
                )
    return sorted(log.values())


Log = dict[tuple[str, int], Attempt]
_ADVICE = "Record into a folder of its own; data sets can be merged afterwards."


def _begin(data: DataSet, run: Run, plan: RecordingPlan) -> Log:
    """Begin a recording in a data set, or continue the one that is there."""
    path = data.path / RUN
    remove_temporary(data.path)
    begin_or_continue(
        data.path,
        path,
        run,
        RUN_SCHEMA,
        what="recording",
        foreign=f"{EPISODES}/*/*{SUFFIX}",
        advice=_ADVICE,
    )
    write(path, encode(run, RUN_SCHEMA))
    attempts = data.path / ATTEMPTS
    listed: tuple[Attempt, ...] = ()
    if attempts.exists():
        listed = read(attempts, Attempts, ATTEMPTS_SCHEMA).attempts
    log = {(each.task, each.episode): each for each in listed if not each.kept}
    # What is kept is what has a file: one may have been removed by hand, and one that was just
    # finished when everything was killed is not in the list.
    for path in data.episodes():
        attempt = _kept(path, plan)
        log[attempt.task, attempt.episode] = attempt
    return log


def _kept(path: Path, plan: RecordingPlan) -> Attempt:
    """The attempt that an episode of the data set comes from, or an `OtherRunError`."""
    task, index = path.parent.name, int(path.stem) if path.stem.isdecimal() else 0
    info = Recording.read_info(path)
    outcome = info.outcome
    if info.after_success != plan.after_success:
        raise OtherRunError(
            f"{path} belongs to another recording; this one has seconds after success "
            f"{plan.after_success:g} instead of {info.after_success:g}. {_ADVICE}"
        )
    if path.stem != f"{index:05d}" or outcome is None or not plan.is_of(info, task, index):
        raise OtherRunError(
            f"{path} was not recorded here under this name: it was renamed, merged, recovered, or "
            "recorded with other options. Move it away."
        )
    return Attempt(
        task=task,
        episode=index,
        success=outcome.success and not outcome.cut,
        stage=outcome.stage,
        steps=Recording.read_length(path) if outcome.success_step is None else outcome.success_step,
        kept=True,
        error=outcome.reason,
    )


def _next(task: TaskInfo, log: Mapping[tuple[str, int], Attempt], wanted: int) -> list[int]:
    """The episodes to play next: those that are enough if all of them succeed."""
    missing, kept, index = [], 0, 0
    while kept < wanted:
        attempt = log.get((task.id, index))
        if attempt is None:
            missing.append(index)
        kept += attempt is None or attempt.kept
        index += 1
        if index > MAX_EPISODES_PER_SUCCESS * wanted:
            raise TooFewSuccessesError(
                f"Only {kept - len(missing)} of the first {index - len(missing)} episodes of "
                f"{task.id} succeeded; {wanted} are wanted. What succeeded is kept."
            )
    return missing


def _write(data: DataSet, result: EpisodeResult) -> Attempt:
    """Write the recording of an episode, if it is kept."""
    record, recording = result.record, result.recording
    if recording is not None:
        data.add(record.task, f"{record.episode:05d}", recording)
    return Attempt(
        task=record.task,
        episode=record.episode,
        success=record.success,
        stage=record.final_stage,
        steps=record.steps,
        kept=recording is not None,
        error=record.reason or None,
    )
