"""A run that is really killed, and goes on; `dev.benchmarks.kills` does it more often."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from dev.benchmarks.kills import disturb
from duobench.results.folder import RunFolder
from tests.children import environment
from tests.evaluation import toy_tasks
from tests.evaluation.conftest import compared
from tests.evaluation.processes import children, is_running, wait_until

SCRIPT = """
import sys
from pathlib import Path
from rich.console import Console
from duobench.results.folder import RunFolder
from duobench.cli.shared.console import results_table
from duobench.results.report import read_parts
from duobench.results.run import TimeLimits
from duobench.evaluation.runners.evaluations import evaluate
from tests.evaluation.conftest import small_suite

folder, workers, policy = RunFolder(Path(sys.argv[1])), int(sys.argv[2]), sys.argv[3]
limits = TimeLimits(act_timeout=float(sys.argv[4]))
suite = small_suite(episodes=EPISODES)
evaluate(policy, suite, folder, videos=1, workers=workers, limits=limits)
Console(width=130).print(results_table(read_parts(folder)[0]))
"""
EPISODES = 4


def start(
    script: Path, folder: Path, workers: int, policy: str = "random", act_timeout: float = 120.0
) -> Any:
    return subprocess.Popen(
        [sys.executable, str(script), str(folder), str(workers), policy, str(act_timeout)],
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.fixture
def script(tmp_path: Path) -> Path:
    path = tmp_path / "evaluate.py"
    path.write_text(SCRIPT.replace("EPISODES", str(EPISODES)))
    return path


@pytest.mark.slow
def test_killed_run_goes_on_to_the_same_table(script, tmp_path):
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    with start(script, whole, 0) as process:
        expected, complaint = process.communicate()
    assert process.returncode == 0, complaint

    records = RunFolder(killed).path / "records"
    with start(script, killed, 2) as process:
        wait_until(lambda: len(list(records.glob("*/*/*.json"))) >= 2, "two records")
        workers = children(process.pid)
        process.send_signal(signal.SIGKILL)
        process.communicate()
    assert process.returncode == -signal.SIGKILL
    assert workers
    wait_until(lambda: not any(map(is_running, workers)), "the end of orphaned workers")
    kept = {path: path.stat().st_mtime_ns for path in records.glob("*/*/*.json")}
    assert 2 <= len(kept) < 2 * EPISODES

    with start(script, killed, 2) as process:
        table, complaint = process.communicate()
    assert process.returncode == 0, complaint
    assert table.split() == expected.split()
    assert "All tasks" in table
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert compared(RunFolder(killed)) == compared(RunFolder(whole))
    names = [{path.relative_to(one) for path in one.rglob("*")} for one in (whole, killed)]
    assert names[0] == names[1]


@pytest.mark.slow
def test_interrupted_run_stops_and_keeps_what_is_finished(script, tmp_path):
    folder = tmp_path / "run"
    with start(script, folder, 2) as process:
        records = folder / "records"
        wait_until(lambda: list(records.glob("*/*/*.json")), "a record")
        workers = children(process.pid)
        process.send_signal(signal.SIGINT)
        process.communicate()
    assert process.returncode != 0
    assert workers
    wait_until(lambda: not any(map(is_running, workers)), "the end of the workers")
    run_folder = RunFolder(folder)
    assert run_folder.read_records(run_folder.read_run())


@pytest.mark.slow
def test_suspended_run_fails_no_policy_for_the_time_that_it_was_stopped(
    script, tmp_path, monkeypatch
):
    monkeypatch.setenv(toy_tasks.MARKS, str(tmp_path))
    slow, act_timeout = f"{toy_tasks.__name__}:ThinksTwice", 4.0
    with start(script, tmp_path / "run", 1, slow, act_timeout) as process:
        wait_until((tmp_path / "thinking").exists, "a policy that thinks")
        job = [process.pid, *children(process.pid)]
        for pid in job:
            os.kill(pid, signal.SIGSTOP)
        time.sleep(act_timeout + 2)
        for pid in job:
            os.kill(pid, signal.SIGCONT)
        _, complaint = process.communicate()
    assert len(job) >= 3  # a worker and the policy beside it
    assert process.returncode == 0, complaint
    folder = RunFolder(tmp_path / "run")
    assert [record.error for record in folder.read_records(folder.read_run())] == [None] * 8


def test_helpers_of_a_policy_end_with_a_killed_run(script, tmp_path, monkeypatch):
    monkeypatch.setenv(toy_tasks.MARKS, str(tmp_path))
    with start(script, tmp_path / "run", 1, f"{toy_tasks.__name__}:HasHelpers") as process:
        wait_until(lambda: len(list(tmp_path.glob("helper-*"))) == 3, "the helpers")
        process.send_signal(signal.SIGKILL)
        process.communicate()  # until nobody holds its output open
    helpers = [int(path.name.split("-")[1]) for path in tmp_path.glob("helper-*")]
    wait_until(lambda: not any(map(is_running, helpers)), "the end of the helpers")


@pytest.mark.long
def test_results_are_the_same_after_ten_kills(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    counts = sum((counts for _, counts in disturb(tmp_path, 10, 1, port)), Counter[str]())
    assert counts.total() == 10
    assert len(counts) > 1
