import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from duobench.cli import main
from duobench.core.errors import (
    DataError,
    EvaluationError,
    FileError,
    GoneError,
    OtherRunError,
    OutputError,
)
from duobench.core.files import locked
from duobench.core.randomness import instruction_number
from duobench.data import ActorKind, DataSet, Outcome, Recording
from duobench.data.attempts import ATTEMPTS, RUN
from duobench.data.check import find_problems
from duobench.data.stream import INTERRUPTED
from duobench.data.summary import summarize
from duobench.evaluation.runners.evaluations import record
from duobench.policy import HoldPolicy, PolicyMetadata
from duobench.results.suite import find_tasks
from duobench.tasks import catalog
from tests.data.tools import room
from tests.evaluation import toy_tasks
from tests.evaluation.processes import children, is_running, wait_until
from tests.evaluation.runners import toy_failures
from tests.evaluation.toy_tasks import seed_of
from tests.quick_first import quick_first

TASKS = ("bin_sort",)
SOMETIMES = "tests.evaluation.runners.test_demonstrations:Sometimes"
ODD = "an odd episode"


class Sometimes(HoldPolicy):
    """Raises in the episodes with odd indices, of the first ten; otherwise nothing is done."""

    metadata = PolicyMetadata(name="sometimes", cameras=(), version="1")

    def reset(self, instruction, seed):
        super().reset(instruction, seed)
        if seed in {seed_of("bin_sort", index, "train") for index in range(1, 10, 2)}:
            raise ValueError(ODD)


def played(data, policy="expert", **arguments):
    arguments = {"episodes": 2, "workers": 0} | arguments
    return record(policy, find_tasks(arguments.pop("tasks", TASKS)), data, **arguments)


def contents(data):
    return {str(path.relative_to(data.path)): path.read_bytes() for path in data.episodes()}


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """Two episodes of the expert, recorded in this process."""
    data = DataSet.open(tmp_path_factory.mktemp("two"))
    assert [attempt.success for attempt in played(data)] == [True] * 2
    return data


@pytest.fixture
def data(two, tmp_path):
    """The same, to go on with."""
    shutil.copytree(two.path, tmp_path / "data")
    return DataSet.open(tmp_path / "data")


@pytest.fixture
def empty(tmp_path):
    return DataSet.open(tmp_path / "empty")


def test_a_recording_may_begin_with_a_later_episode(two, data, empty):
    (attempt,) = played(empty, episodes=1, first=1)
    assert attempt.episode == 1
    (path,) = empty.episodes()
    assert path.read_bytes() == two.episodes()[1].read_bytes()
    played(empty, episodes=1, first=1)  # what is there is enough
    with pytest.raises(OtherRunError, match="first episode 0 instead of 1"):
        played(empty, episodes=2)
    with pytest.raises(OtherRunError, match="first episode 1 instead of 0"):
        played(data, first=1)
    assert contents(data) == contents(two)
    with pytest.raises(EvaluationError, match="from -1"):
        played(DataSet.open(empty.path.with_name("none")), first=-1)


@pytest.mark.slow
def test_the_data_set_does_not_depend_on_workers_or_interruptions(two, empty):
    played(empty, episodes=1)
    assert played(empty, workers=2) == played(two)
    assert contents(two) == contents(empty)
    assert (two.path / ATTEMPTS).read_bytes() == (empty.path / ATTEMPTS).read_bytes()
    info = Recording.read_info(two.episodes()[0])
    assert (info.split, info.actor.kind, info.outcome.success) == ("train", ActorKind.EXPERT, True)
    assert info.actor.version


def test_what_is_missing_is_recorded_again_and_nothing_else(two, data):
    first, second = data.episodes()
    second.unlink()
    (data.path / ATTEMPTS).unlink()
    stamp = first.stat().st_mtime_ns
    second.with_suffix(".part").write_bytes(b"left by a kill")
    played(data)
    assert contents(data) == contents(two)
    assert first.stat().st_mtime_ns == stamp
    assert not data.partials()


@pytest.mark.long
def test_failures_are_counted_and_left_out_unless_asked_for(empty, tmp_path):
    attempts = played(empty, SOMETIMES, keep_failures=True, episodes=6)
    assert len(attempts) == len(empty.episodes()) == 6
    assert not any(attempt.success for attempt in attempts)
    broken = [attempt for attempt in attempts if attempt.error]
    assert [attempt.episode for attempt in broken] == [1, 3, 5]
    outcome = Recording.read_info(empty.episode("bin_sort", "00001")).outcome
    assert (outcome.kept, outcome.cut) == (False, True)
    assert ODD in broken[0].error
    assert ODD in outcome.reason
    with pytest.raises(OtherRunError, match="with other options"):
        played(empty, SOMETIMES, episodes=6)
    good = DataSet.open(tmp_path / "good")
    with pytest.raises(EvaluationError, match="Only 0 of the first 10 episodes of bin_sort succ"):
        played(good, "hold", episodes=1)
    assert not good.episodes()


@pytest.mark.slow
def test_instructions_vary_on_request(empty):
    played(empty, "hold", keep_failures=True, episodes=4, instructions="varied")
    infos = [Recording.read_info(path) for path in empty.episodes()]
    words = catalog.get("bin_sort").instructions
    numbers = [instruction_number("bin_sort", info.seed, len(words), "train") for info in infos]
    assert len(set(numbers)) > 1
    assert [info.instruction for info in infos] == [words[number] for number in numbers]


@pytest.mark.parametrize(
    ("policy", "options", "message"),
    [
        ("hold", {}, "policy hold instead of expert"),
        ("expert", {"split": "eval"}, "split eval instead of train"),
        ("expert", {"instructions": "varied"}, "instructions varied instead of fixed"),
        ("expert", {"after_success": 0.0}, "seconds after success 0 instead of 1"),
        ("expert", {"after_success": 0.5}, "seconds after success 0.5 instead of 1"),
    ],
)
def test_another_recording_is_refused_with_the_difference(two, policy, options, message):
    with pytest.raises(OtherRunError, match=message):
        played(two, policy, **options)


def test_two_do_not_write_one_data_set(two):
    with locked(two.path), pytest.raises(OutputError, match="Another process is writing"):
        played(two)


def test_recordings_go_on_after_success_beyond_the_horizon(empty):
    asked = {"tasks": [toy_tasks.NUDGE_NAME]}
    (first, second) = played(empty, "random", **asked)
    for attempt, rows in zip((first, second), empty.recordings(), strict=True):
        assert attempt.success
        assert attempt.steps == rows.success_step == len(rows) - 30
    assert len(rows) > toy_tasks.HORIZON
    empty.episodes()[1].unlink()
    assert played(empty, "random", after_success=0.99, **asked) == [first, second]


def undescribed(data):
    (data.path / "record.json").unlink()


def named(name):
    return lambda data: data.episodes()[0].rename(data.episode("bin_sort", name))


def damaged(data):
    data.episodes()[0].write_bytes(b"rubbish")


def spoilt(data):
    """A file whose end, which says what it holds, is sound."""
    path = data.episodes()[0]
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 255
    path.write_bytes(content)


def copied(name):
    return lambda data: shutil.copy(data.episodes()[0], data.episode("bin_sort", name))


def elsewhere(data):
    path = data.episode("carry_pot", "00000")
    path.parent.mkdir()
    data.episodes()[0].rename(path)


def changed(data):
    path = data.path / RUN
    path.write_text(path.read_text().replace("expert", "hold"))


def recovered(data):
    path = data.episodes()[0]
    recording = Recording.read(path)
    outcome = Outcome(success=False, stage=0, max_stage=5, kept=False, reason=INTERRUPTED, cut=True)
    replace(recording, info=replace(recording.info, outcome=outcome)).write(path)


@pytest.mark.parametrize("keep_failures", [False, True])
@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (undescribed, OtherRunError, "is not empty and holds no recording"),
        (named("best"), OtherRunError, r"best\.parquet was not recorded here under this name"),
        (named("00007"), OtherRunError, "was not recorded here under this name"),
        (named("0"), OtherRunError, "was not recorded here under this name"),
        (recovered, OtherRunError, "was not recorded here under this name"),
        (copied("00007"), OtherRunError, "was not recorded here under this name"),
        (copied("00001"), OtherRunError, "was not recorded here under this name"),
        (elsewhere, OtherRunError, "was not recorded here under this name"),
        (changed, FileError, "checksum"),
        (damaged, DataError, r"00000\.parquet.*Remove the file, and the same command records it"),
        (spoilt, DataError, r"00000\.parquet.*Remove the file, and the same command records it"),
    ],
)
def test_episodes_that_are_not_what_they_should_be_stop_the_recording(
    data, change, error, message, keep_failures
):
    change(data)
    with pytest.raises(error, match=message):
        played(data, keep_failures=keep_failures)
    assert find_problems(data)


@pytest.mark.parametrize(
    "harm", quick_first([damaged, spoilt, lambda data: data.episodes()[0].unlink()])
)
def test_an_episode_whose_file_is_removed_is_recorded_again(two, data, harm):
    harm(data)
    path = data.episode("bin_sort", "00000")
    (problem,) = find_problems(data)
    assert problem.path == path
    path.unlink(missing_ok=True)
    assert [each.what for each in find_problems(data)] == [
        "It was kept, as attempts say, and is missing."
    ]
    assert summarize(data).differences == {"bin_sort": "missing 1: 00000"}
    played(data)
    assert contents(data) == contents(two)
    assert (find_problems(data), summarize(data).differences) == ([], {})


def test_files_that_attempts_do_not_know_are_counted(data, capsys):
    copied("00007")(data)
    named("00009")(data)
    words = "missing 1: 00000; not noted 2: 00007, 00009; not what their names say 2: 00007, 00009"
    main(["data", "info", str(data.path), "--no-images"])
    assert words in " ".join(capsys.readouterr().out.split())
    with pytest.raises(SystemExit, match="1"):
        main(["data", "check", str(data.path)])
    assert words in " ".join(capsys.readouterr().out.split())
    shutil.rmtree(data.path / "episodes")
    with pytest.raises(DataError, match=r"no episode\. Of bin_sort missing 2: 00000, 00001\."):
        summarize(data)


def test_what_is_kept_of_failures_is_no_problem(empty):
    played(empty, SOMETIMES, keep_failures=True, episodes=3)
    assert {each.what for each in find_problems(empty)} == {"It has no actions."}  # it broke


@pytest.mark.long
def test_a_killed_recording_goes_on_to_the_same_bytes(two, tmp_path):
    killed = DataSet(tmp_path / "killed")
    command = [sys.executable, "-m", "duobench", "record", "--out", str(killed.path)]
    command += ["--variety", "none", "--tasks", *TASKS, "--episodes", "2", "--workers", "2"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3] / "src")}
    child = subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, start_new_session=True
    )
    wait_until(killed.episodes, "an episode")
    workers = children(child.pid)
    os.killpg(child.pid, signal.SIGKILL)
    child.wait()
    wait_until(lambda: not any(map(is_running, workers)), "the end of orphaned workers")
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)
    assert contents(killed) == contents(two)
    assert not killed.partials()


@pytest.mark.slow
def test_a_recording_of_another_episode_is_dropped(tmp_path, monkeypatch):
    monkeypatch.setenv(toy_tasks.MARKS, str(tmp_path))
    monkeypatch.setenv(toy_tasks.MISBEHAVIOUR, "swaps_recordings")
    sets = [DataSet.open(tmp_path / name) for name in ("first", "again")]
    for data in sets:
        played(data, "hold", workers=1, tasks=[toy_tasks.WAVE_NAME], keep_failures=True)
        assert (tmp_path / "swapped-once").exists()
    assert contents(sets[0]) == contents(sets[1])


@pytest.mark.parametrize("workers", quick_first([0, 1]))
def test_what_a_policy_says_that_it_intended_is_its_own_fault(tmp_path, workers):
    data, policy = DataSet(tmp_path), f"{toy_failures.__name__}:Intends"
    (wave,) = find_tasks([toy_tasks.WAVE_NAME])
    found = record(policy, [wave], data, episodes=3, keep_failures=True, workers=workers)
    assert ["nonsense" in (each.error or "") for each in found] == [False, True, False]


@pytest.mark.slow
def test_a_full_disk_is_no_failure_of_the_policy(two, empty):
    with room(30_000), pytest.raises(OutputError, match="File too large"):
        played(empty)
    assert not (empty.path / ATTEMPTS).exists()
    assert played(empty) == played(two)
    assert contents(empty) == contents(two)


def test_a_data_set_that_is_removed_while_it_is_recorded_is_said_to_be_gone(empty):
    class Removes:
        def on_run_start(self, run, finished):
            """Nothing is shown."""

        def on_episode(self, _played):
            shutil.rmtree(empty.path)

    with pytest.raises(GoneError, match=f"{empty.path} was removed while it was written into"):
        played(empty, observers=[Removes()])
    assert not empty.path.exists()
