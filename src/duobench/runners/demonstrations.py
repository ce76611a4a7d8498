"""Generating demonstrations: a policy is recorded until every task has enough good episodes.

Which episodes those are does not depend on the number of workers or on interruptions: the first
ones, by index, that succeed.
"""

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from duobench.data import DataSet, Recording
from duobench.data.attempts import ATTEMPTS, ATTEMPTS_SCHEMA, Attempt, Attempts
from duobench.data.dataset import EPISODES, SUFFIX
from duobench.data.schema import AFTER_SUCCESS_S, steps_after_success
from duobench.envs.config import FIXED
from duobench.errors import OtherRunError, TooFewSuccessesError
from duobench.evaluation.episode import EpisodeResult, Job, RecordingPlan
from duobench.evaluation.policies import PolicyChoice
from duobench.evaluation.rollout import Observer
from duobench.files import begin_or_continue, encode, locked, read, remove_temporary, write
from duobench.randomness import TRAIN
from duobench.results.run import RUN_SCHEMA, Run, TimeLimits
from duobench.results.suite import Episode, Suite, TaskInfo
from duobench.runners.executor import Executor, executor_for
from duobench.runners.schedule import check_played
from duobench.types import CONTROL_HZ

RUN = "record.json"
"""What is recorded."""
MAX_EPISODES_PER_SUCCESS = 10
"""Episodes that are played for one that succeeds, on average, before a task is given up."""


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
        instructions: What the policy is told; see `EnvConfig`.
        keep_failures: Keep every episode, and count it, whether it succeeds or not.
        after_success: Seconds that a recording goes on after success, rounded to control steps.
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
        log = _Log(data, executor.prepare(), plan, command)
        return log.played_by(executor, observers)


_ADVICE = "Record into a folder of its own; data sets can be merged afterwards."


class _Log:
    """What was played for a data set; a recording is begun in it, or the one there continued."""

    def __init__(self, data: DataSet, run: Run, plan: RecordingPlan, command: str) -> None:
        self._data, self._run, self._plan, self._command = data, run, plan, command
        self._path = data.path / ATTEMPTS
        remove_temporary(data.path)
        begin_or_continue(
            data.path,
            data.path / RUN,
            run,
            RUN_SCHEMA,
            what="recording",
            foreign=f"{EPISODES}/*/*{SUFFIX}",
            advice=_ADVICE,
        )
        write(data.path / RUN, encode(run, RUN_SCHEMA))
        listed: tuple[Attempt, ...] = ()
        if self._path.exists():
            listed = read(self._path, Attempts, ATTEMPTS_SCHEMA).attempts
        # What is kept is what has a file: one may have been removed by hand, and one that was just
        # finished when everything was killed is not in the list.
        found = [*(each for each in listed if not each.kept), *map(self._kept, data.episodes())]
        self._attempts = {(each.task, each.episode): each for each in found}

    def _kept(self, path: Path) -> Attempt:
        """The attempt that an episode of the data set comes from, or an `OtherRunError`."""
        task, index = path.parent.name, int(path.stem) if path.stem.isdecimal() else 0
        info = Recording.read_info(path)
        outcome = info.outcome
        if info.after_success != self._plan.after_success:
            raise OtherRunError(
                f"{path} belongs to another recording; this one has seconds after success "
                f"{self._plan.after_success:g} instead of {info.after_success:g}. {_ADVICE}"
            )
        if path.stem != f"{index:05d}" or not outcome or not self._plan.is_of(info, task, index):
            raise OtherRunError(
                f"{path} was not recorded here under this name: it was renamed, merged, recovered, "
                "or recorded with other options. Move it away."
            )
        return Attempt(
            task=task,
            episode=index,
            success=outcome.success and not outcome.cut,
            stage=outcome.stage,
            steps=outcome.success_step
            if outcome.success_step is not None
            else Recording.read_length(path),
            kept=True,
            error=outcome.reason,
        )

    def played_by(
        self, executor: Executor, observers: Sequence[Observer[Attempt]]
    ) -> list[Attempt]:
        """Have episodes played until there are enough; all attempts, by task and index."""
        for observer in observers:
            observer.on_run_start(self._run, list(self._attempts.values()))
        while missing := [
            Episode(task=task, index=index, split=self._plan.split)
            for task in self._run.suite.tasks
            for index in self._next(task)
        ]:
            for result in executor.play(missing):
                attempt = self._add(result)
                for observer in observers:
                    observer.on_episode(attempt)
            check_played(executor.unplayed)
        return sorted(self._attempts.values())

    def _next(self, task: TaskInfo) -> list[int]:
        """The episodes to play next: those that are enough if all of them succeed."""
        missing, kept, index, wanted = list[int](), 0, 0, self._run.suite.episodes
        while kept < wanted:
            attempt = self._attempts.get((task.id, index))
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

    def _add(self, result: EpisodeResult) -> Attempt:
        record, recording = result.record, result.recording
        if recording is not None:
            self._data.add(record.task, f"{record.episode:05d}", recording)
        attempt = Attempt(
            task=record.task,
            episode=record.episode,
            success=record.success,
            stage=record.final_stage,
            steps=record.steps,
            kept=recording is not None,
            error=record.reason or None,
        )
        self._attempts[attempt.task, attempt.episode] = attempt
        played = Attempts(attempts=tuple(sorted(self._attempts.values())), command=self._command)
        write(self._path, encode(played, ATTEMPTS_SCHEMA))
        return attempt
