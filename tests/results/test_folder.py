import json
import os
import signal
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from duobench.core.errors import EvaluationError, FileError, LockedError, OtherRunError, OutputError
from duobench.core.files import encode, locked
from duobench.core.randomness import SUITE_VERSION
from duobench.envs.config import EnvConfig
from duobench.policy import PolicyMetadata
from duobench.results.folder import RunFolder
from duobench.results.records import RECORD_SCHEMA
from duobench.results.run import TimeLimits
from tests.evaluation.processes import is_running
from tests.results.samples import (
    LIFT,
    TASKS,
    VERSIONS,
    key,
    sample_folder,
    sample_record,
    sample_records,
    sample_run,
)

RUN = sample_run()
RECORD = sample_record(LIFT, 0, (5, 9))


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    """A run with one record."""
    return sample_folder(tmp_path / "run", RUN, [RECORD])


def test_begun_run_can_be_begun_again(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "new" / "run")
    for _ in range(2):
        folder.begin(RUN)
        assert folder.read_run() == RUN


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"policy": "other"}, "policy other instead of mine"),
        ({"episodes": 3}, "episodes 3 instead of 4 or more"),
        ({"first_episode": 4}, "first episode 4 instead of 0"),
        ({"tasks": TASKS[:2]}, "tasks lift sort instead of lift sort turn"),
        ({"version": "2"}, f"suite version 2 instead of {SUITE_VERSION}"),
        ({"versions": {**VERSIONS, "mujoco": "4.0.9"}}, "version of mujoco 4.0.9 instead"),
        ({"trained_on": "real"}, "trained on real instead of"),
        ({"limits": TimeLimits(act_timeout=1)}, "time limit act_timeout 1 instead of 120"),
        ({"metadata": PolicyMetadata(name="mine", version="2")}, "policy's version 2 instead of 1"),
        (
            {"config": EnvConfig(cameras=(), action_mode="cartesian")},
            "environment's action_mode cartesian instead of joint",
        ),
    ],
)
def test_other_run_is_refused_with_what_differs(
    folder: RunFolder, changes: dict[str, Any], message: str
) -> None:
    before = folder.description.read_bytes()
    with pytest.raises(OtherRunError, match=rf"holds another evaluation; this one has .*{message}"):
        folder.begin(sample_run(**changes))
    assert folder.description.read_bytes() == before


def test_run_grows_and_its_description_with_it(tmp_path: Path) -> None:
    records = sample_records(RUN)
    folder = sample_folder(tmp_path / "run", RUN, records)
    folder.begin(sample_run(episodes=9))
    assert folder.read_run() == sample_run(episodes=9)
    assert folder.read_records(folder.read_run()) == records


def test_run_without_a_record_gives_way_to_a_corrected_one(tmp_path: Path) -> None:
    folder, run = sample_folder(tmp_path / "run", RUN, []), sample_run(policy="corrected")
    folder.begin(run)
    assert folder.read_run() == run


@pytest.mark.parametrize(
    ("name", "message"),
    [("file", "it is a file"), ("file/run", "Not a directory"), ("/proc/run", "No such file")],
)
def test_folder_that_cannot_be_made_is_refused(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "file").write_text("precious")
    with pytest.raises(OutputError, match=rf"{name}.*{message}"), locked(tmp_path / name):
        pass
    assert (tmp_path / "file").read_text() == "precious"


def test_run_killed_while_it_described_itself_can_be_begun_again(tmp_path: Path) -> None:
    (tmp_path / ".run.json.123.tmp").write_text("{")
    RunFolder(tmp_path).begin(RUN)
    assert [path.name for path in tmp_path.iterdir()] == ["run.json"]


def test_folder_with_strange_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(OtherRunError, match="not empty and holds no evaluation"):
        RunFolder(tmp_path).begin(RUN)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_records_come_back_in_the_order_of_the_run_without_those_that_are_missing(
    tmp_path: Path,
) -> None:
    records = sample_records(RUN)[2:-1]
    assert sample_folder(tmp_path / "run", RUN, records[::-1]).read_records(RUN) == records


@pytest.mark.parametrize(
    "changes",
    [
        {"episode": 1},
        {"seed": 7},
        {"policy_seed": 7},
        {"policy": "other"},
        {"policy_version": "2"},
        {"config": EnvConfig()},
        {"run": "0" * 64},
        {"suite_version": "0"},
        {"task": "turn"},
    ],
)
def test_record_of_another_run_is_refused(folder: RunFolder, changes: dict[str, Any]) -> None:
    (record,) = folder.read_records(RUN)
    folder.record(record.key).write_text(encode(replace(record, **changes), RECORD_SCHEMA))
    error = OtherRunError if "run" in changes else EvaluationError
    with pytest.raises(error, match=r"00000\.json (does not belong|belongs to another run)"):
        folder.read_records(RUN)


def test_another_schema_is_named(folder: RunFolder) -> None:
    for path in (folder.record(RECORD.key), folder.description):
        document = json.loads(path.read_text())
        path.write_text(json.dumps({**document, "schema": document["schema"] - 1}))
        schema = document["schema"]
        message = rf"{path.name}: Schema {schema - 1}; this version reads {schema}"
        with pytest.raises(FileError, match=message):
            folder.read_records(folder.read_run())


def test_folder_without_a_readable_run_says_so(tmp_path: Path) -> None:
    with pytest.raises(EvaluationError, match=r"run\.json is missing"):
        RunFolder(tmp_path).read_run()
    (tmp_path / "run.json").write_text("{}")
    with pytest.raises(FileError, match=r"Cannot read .*run\.json"):
        RunFolder(tmp_path).read_run()


def test_record_that_cannot_be_read_says_how_to_go_on(folder: RunFolder) -> None:
    folder.record(key(folder, "lift", 2)).mkdir(parents=True)
    with pytest.raises(FileError, match=r"00002\.json: Is a directory\. Delete the file and"):
        folder.read_records(RUN)


def test_run_of_endless_length_is_read(tmp_path: Path) -> None:
    run = sample_run(episodes=10**12)
    folder = sample_folder(tmp_path, run, [sample_record(LIFT, 3, (5, 9))])
    assert len(folder.read_records(run)) == 1


@contextmanager
def locking(path: Path, block: str) -> Generator[tuple[subprocess.Popen[str], str]]:
    """A process that locks a folder, and what it prints first; it is killed where that is done."""
    script = (
        "import os, sys, time\n"
        "from pathlib import Path\n"
        "from duobench.core.files import locked\n"
        f"with locked(Path(sys.argv[1])):\n    {block}\n    time.sleep(1000)\n"
    )
    command = [sys.executable, "-c", script, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout
        try:
            yield other, other.stdout.readline().strip()
        finally:
            other.kill()


def test_lock_does_not_outlive_a_kill_in_a_forked_child(tmp_path: Path) -> None:
    with locking(tmp_path, "os.fork() or print(os.getpid(), flush=True)") as (other, printed):
        other.kill()
        other.wait()
        assert is_running(int(printed))
        with locked(tmp_path):
            pass
        os.kill(int(printed), signal.SIGKILL)


def test_second_process_is_kept_out_until_the_first_is_gone(tmp_path: Path) -> None:
    with locking(tmp_path, "print('locked', flush=True)") as (other, printed):
        assert printed == "locked"
        with pytest.raises(LockedError, match="Another process"), locked(tmp_path):
            pass
        other.kill()
        other.wait()
    with locked(tmp_path):
        assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "name",
    ["00007.json", "0.json", "best.json", "../x/00000.json", "../../00000.json", "sub/00000.json"],
)
def test_file_under_a_wrong_name_is_no_record(folder: RunFolder, name: str) -> None:
    record = folder.record(RECORD.key)
    copy = record.parent / name
    copy.parent.mkdir(exist_ok=True)
    copy.write_bytes(record.read_bytes())
    with pytest.raises(EvaluationError, match=r"has a record of no episode of its run.*renamed"):
        folder.read_records(RUN)


def test_record_that_stands_for_another_episode_says_how_to_go_on(folder: RunFolder) -> None:
    record = folder.record(RECORD.key)
    record.rename(record.with_name("00001.json"))
    with pytest.raises(EvaluationError, match=r"expected was 1\. Delete the file and run the eval"):
        folder.read_records(RUN)
