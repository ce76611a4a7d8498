import os
import signal
import time
from contextlib import closing
from pathlib import Path

import pytest

from duobench.core.errors import DataError, UnknownNameError
from duobench.data.processes import run_all
from tests.evaluation.processes import children, is_running, wait_until


class Works:
    """Does jobs that say what is to happen."""

    def __call__(self, job: str) -> tuple[str, int]:
        match job:
            case "fail":
                raise UnknownNameError("job", "fial", ["fail"])
            case "crash":
                raise ZeroDivisionError("no jobs")
            case "die":
                os.kill(os.getpid(), signal.SIGKILL)
            case "sleep":
                time.sleep(1000)
            case str() if job.startswith("/") and not Path(job).exists():
                Path(job).touch()
                os.kill(os.getpid(), signal.SIGKILL)
        return job, os.getpid()


class Vanishing:
    """A worker that ends by itself before it takes a job."""

    def __init__(self) -> None:
        os._exit(3)

    def __call__(self, job: str) -> str:
        return job


def test_every_job_is_done_once_by_as_many_processes_as_wanted() -> None:
    jobs = list("abcdef")
    for workers in (0, 1, 2):
        done = list(run_all(Works, jobs, workers))
        assert sorted(job for job, _ in done) == jobs
        others = {worker for _, worker in done} - {os.getpid()}
        assert len(others) <= workers
        assert bool(others) == bool(workers)
    assert list(run_all(Works, [], 2)) == []


def test_what_a_worker_was_doing_when_it_was_killed_is_done_again(tmp_path: Path) -> None:
    jobs = ["a", str(tmp_path / "once"), "b", "c"]
    assert sorted(job for job, _ in run_all(Works, jobs, 2)) == sorted(jobs)
    assert (tmp_path / "once").exists()


@pytest.mark.parametrize(
    ("make", "job", "error", "message"),
    [
        (Works, "fail", UnknownNameError, r"^Unknown job 'fial'. Did you mean 'fail'\?"),
        (Works, "crash", DataError, r"A worker failed(.|\n)*in __call__(.|\n)*no jobs"),
        (Works, "die", DataError, r"exit code -9\..*goes on from there"),
        (Vanishing, "a", DataError, "exit code 3"),
    ],
)
def test_error_of_a_job_and_repeated_deaths_are_said_and_end_the_others(
    make: type, job: str, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        list(run_all(make, [job, "sleep"], 2))


def test_who_closes_the_iterator_ends_the_workers() -> None:
    before = set(children(os.getpid()))
    with closing(run_all(Works, ["a", "sleep", "sleep"], 2)) as results:
        next(results)
        started = set(children(os.getpid())) - before
        assert started
    wait_until(
        lambda: sum(map(is_running, started)) <= 1,  # the library's tracker of resources stays
        "the end of the workers",
    )
