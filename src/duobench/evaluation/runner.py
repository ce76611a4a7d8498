"""Running an evaluation: what is missing in a folder is played, then everything is reported."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import closing, suppress
from typing import Protocol

from duobench.errors import EvaluationError, RenderingError
from duobench.evaluation.folder import RunFolder
from duobench.evaluation.metrics import Results
from duobench.evaluation.pool import Pool
from duobench.evaluation.records import EpisodeRecord
from duobench.evaluation.report import write_report
from duobench.evaluation.run import Run
from duobench.evaluation.seat import Played, Seat
from duobench.evaluation.suite import Trial, trials
from duobench.sim import rendering


class Observer(Protocol):
    """Something that shows how far a run is."""

    def on_run_start(self, run: Run, finished: Sequence[EpisodeRecord]) -> None:
        """The run begins, or goes on with some episodes already finished."""
        ...

    def on_record(self, record: EpisodeRecord) -> None:
        """One more episode is finished, and its record written."""
        ...


def evaluate(
    run: Run,
    folder: RunFolder,
    *,
    workers: int = 1,
    observers: Sequence[Observer] = (),
    retry_broken: bool = False,
) -> Results:
    """Play the episodes of a run that have no record yet, and write the report.

    The results do not depend on the number of workers, on the order in which episodes finish, or
    on how often the run was stopped and started again.

    Args:
        run: What to play.
        folder: Where everything is written; a folder that holds the same run is continued.
        workers: Processes that play side by side; 0 or 1 plays in this process. With more, a
            script that calls this needs the usual `if __name__ == "__main__":` guard.
        observers: Who is told about the progress, in this process.
        retry_broken: Also play the episodes again whose records say that they broke off.

    Returns:
        What all records of the run add up to.

    Raises:
        EvaluationError: If the number of workers is negative, or the folder cannot be made, holds
            another run, is in use, or has a broken record.
        PolicyError: If the policy cannot be made, or does not fit the environment.
        DuoBenchError: If the environment cannot be made.
    """
    if workers < 0:
        raise EvaluationError(
            f"The number of workers is 1 or more, or 0 for this process alone; got {workers}."
        )
    with folder.locked():
        folder.begin(run)
        finished = folder.read_records(run)
        if retry_broken:
            for record in finished:
                if record.error is not None:
                    folder.discard(record.task, record.episode)
            finished = [record for record in finished if record.error is None]
        for observer in observers:
            observer.on_run_start(run, finished)
        done = {(record.task, record.episode) for record in finished}
        missing = [trial for trial in trials(run) if (trial.task.id, trial.episode) not in done]
        if workers > 1 and len(missing) > 1:
            _prepare_graphics(run, workers)
            playing = Pool(run=run, folder=folder, workers=workers).play(missing)
        else:
            playing = _play_here(run, folder, missing)
        with closing(playing):
            for played in playing:
                folder.note_timing(played.note())
                for observer in observers:
                    observer.on_record(played.record)
        return write_report(folder)


def _prepare_graphics(run: Run, workers: int) -> None:
    """Choose how to draw before there are workers, so that not each of them finds out for itself.

    A policy of somebody's own may see pictures or not; only its worker knows. If it does and
    nothing can draw, the worker is the one to say so.
    """
    if run.videos:
        rendering.prepare(processes=workers)
    elif ":" in run.policy:
        with suppress(RenderingError):
            rendering.prepare(processes=workers)


def _play_here(run: Run, folder: RunFolder, missing: Sequence[Trial]) -> Generator[Played]:
    """Play trials in this process."""
    if not missing:
        return
    with closing(Seat(run, folder)) as seat:
        for trial in missing:
            seat.prepare(trial.task)
            yield seat.play(trial)
