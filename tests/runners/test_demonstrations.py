import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from duobench.data import ActorKind, DataSet, Outcome, Recording
from duobench.data.stream import INTERRUPTED
from duobench.errors import DataError, EvaluationError, OtherRunError, OutputError
from duobench.files import locked
from duobench.randomness import instruction_number
from duobench.results.suite import find_tasks
from duobench.runners.demonstrations import ATTEMPTS, record
from duobench.tasks import catalog
from tests.data.tools import room
from tests.evaluation import toy_tasks
from tests.evaluation.processes import children, is_running, wait_until
from tests.evaluation.toy_tasks import seed_of

TASKS = ("bin_sort",)
SOMETIMES = "tests.runners.test_demonstrations:Sometimes"


ODD = "an odd episode"


class Sometimes:
    """Raises in the episodes with odd indices, of the first ten; otherwise nothing is done."""

    def __init__(self) -> None:
        from duobench.policy import PolicyMetadata

        self.metadata = PolicyMetadata(name="sometimes", cameras=(), version="1")

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002
        if seed in {seed_of("bin_sort", index, "train") for index in range(1, 10, 2)}:
            raise ValueError(ODD)

    def act(self, observation):
        return observation["agent_pos"][None]


def played(data: DataSet, policy: str = "expert", **arguments):
    arguments = {"episodes": 2, "workers": 0} | arguments
    return record(policy, find_tasks(arguments.pop("tasks", TASKS)), data, **arguments)


def contents(data: DataSet) -> dict[str, bytes]:
    return {str(path.relative_to(data.path)): path.read_bytes() for path in data.episodes()}


def test_the_data_set_does_not_depend_on_workers_or_interruptions(tmp_path):
    one, other = DataSet.open(tmp_path / "one"), DataSet.open(tmp_path / "other")
    first = played(one, episodes=3)
    assert [attempt.success for attempt in first] == [True] * 3
    played(other, episodes=1)
    assert played(other, episodes=3, workers=2) == first
    assert contents(one) == contents(other)
    assert (one.path / ATTEMPTS).read_bytes() == (other.path / ATTEMPTS).read_bytes()
    info = Recording.read_info(one.episodes()[0])
    assert info.split == "train"
    assert info.actor.kind is ActorKind.EXPERT
    assert info.actor.version
    assert info.outcome is not None
    assert info.outcome.success


def test_what_is_missing_is_recorded_again_and_nothing_else(tmp_path):
    data = DataSet.open(tmp_path)
    played(data)
    before = contents(data)
    first, second = data.episodes()
    second.unlink()
    (data.path / ATTEMPTS).unlink()
    stamp = first.stat().st_mtime_ns
    second.with_suffix(".part").write_bytes(b"left by a kill")
    played(data)
    assert contents(data) == before
    assert first.stat().st_mtime_ns == stamp
    assert not data.partials()


def test_failures_are_counted_and_left_out_unless_asked_for(tmp_path):
    data = DataSet.open(tmp_path / "all")
    attempts = played(data, SOMETIMES, keep_failures=True, episodes=6)
    assert len(attempts) == len(data.episodes()) == 6
    assert not any(attempt.success for attempt in attempts)
    broken = [attempt for attempt in attempts if attempt.error]
    assert [attempt.episode for attempt in broken] == [1, 3, 5]
    assert ODD in str(broken[0].error)
    path = data.episode("bin_sort", f"{broken[0].episode:05d}")
    outcome = Recording.read_info(path).outcome
    assert outcome is not None
    assert (outcome.kept, outcome.cut) == (False, True)
    assert ODD in str(outcome.reason)

    data = DataSet.open(tmp_path / "good")
    with pytest.raises(EvaluationError, match="Only 0 of the first 10 episodes of bin_sort succ"):
        played(data, "hold", episodes=1)
    assert not data.episodes()


def test_instructions_vary_on_request(tmp_path):
    data = DataSet.open(tmp_path)
    played(data, "hold", keep_failures=True, episodes=4, instructions="varied")
    infos = [Recording.read_info(path) for path in data.episodes()]
    words = catalog.get("bin_sort").instructions
    numbers = [
        instruction_number("bin_sort", info.seed or 0, len(words), "train") for info in infos
    ]
    assert len(set(numbers)) > 1
    assert [info.instruction for info in infos] == [words[number] for number in numbers]


def test_another_recording_is_refused_with_the_difference(tmp_path):
    data = DataSet.open(tmp_path)
    played(data, episodes=1)
    with pytest.raises(OtherRunError, match="policy hold instead of expert"):
        played(data, "hold")
    with pytest.raises(OtherRunError, match="split eval instead of train"):
        played(data, split="eval")
    with pytest.raises(OtherRunError, match="instructions varied instead of fixed"):
        played(data, instructions="varied")
    with locked(data.path), pytest.raises(OutputError, match="Another process is writing"):
        played(data)


def test_recordings_go_on_after_success_beyond_the_horizon(tmp_path):
    data = DataSet.open(tmp_path)
    asked = {"tasks": [toy_tasks.NUDGE_NAME], "episodes": 2}
    (first, second) = played(data, "random", **asked)
    for attempt, rows in zip((first, second), data.recordings(), strict=True):
        assert attempt.success
        assert attempt.steps == rows.success_step == len(rows) - 30
    assert len(rows) > toy_tasks.HORIZON
    data.episodes()[1].unlink()
    for after, said in ((0.0, "0 instead of 1"), (0.5, "0.5 instead of 1")):
        with pytest.raises(OtherRunError, match=f"seconds after success {said}"):
            played(data, "random", after_success=after, **asked)
    assert played(data, "random", after_success=0.99, **asked) == [first, second]


def test_episodes_of_another_origin_are_not_mixed_in(tmp_path):
    data = DataSet.open(tmp_path / "a")
    played(data, episodes=1)
    (data.path / "record.json").unlink()
    with pytest.raises(OtherRunError, match="is not empty and holds no recording"):
        played(data, episodes=1)


def test_a_file_of_another_name_is_named(tmp_path):
    data = DataSet.open(tmp_path)
    played(data, episodes=1)
    data.episodes()[0].rename(data.episode("bin_sort", "best"))
    with pytest.raises(OtherRunError, match=r"best\.parquet was not recorded here"):
        played(data, episodes=1)


def test_a_damaged_episode_stops_the_recording_with_its_name(tmp_path):
    data = DataSet.open(tmp_path)
    played(data, episodes=1)
    data.episodes()[0].write_bytes(b"rubbish")
    with pytest.raises(DataError, match=r"00000\.parquet"):
        played(data, episodes=1)


def test_a_killed_recording_goes_on_to_the_same_bytes(tmp_path):
    whole, killed = DataSet.open(tmp_path / "whole"), DataSet(tmp_path / "killed")
    played(whole, episodes=2)
    command = [sys.executable, "-m", "duobench", "record", "--out", str(killed.path)]
    command += ["--variety", "none", "--tasks", *TASKS, "--episodes", "2", "--workers", "2"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2] / "src")}
    child = subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, start_new_session=True
    )
    wait_until(killed.episodes, "an episode")
    workers = children(child.pid)
    os.killpg(child.pid, signal.SIGKILL)
    child.wait()
    wait_until(lambda: not any(map(is_running, workers)), "the end of orphaned workers")
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)
    assert contents(killed) == contents(whole)
    assert not killed.partials()


def test_a_recording_of_another_episode_is_dropped(tmp_path, monkeypatch):
    monkeypatch.setenv(toy_tasks.MARKS, str(tmp_path))
    monkeypatch.setenv(toy_tasks.MISBEHAVIOUR, "swaps_recordings")
    asked = {"tasks": [toy_tasks.WAVE_NAME], "keep_failures": True}
    first, again = DataSet.open(tmp_path / "first"), DataSet.open(tmp_path / "again")
    played(first, "hold", workers=1, **asked)
    assert (tmp_path / "swapped-once").exists()
    played(again, "hold", workers=1, **asked)
    assert contents(first) == contents(again)


def renamed(data: DataSet) -> None:
    data.episodes()[0].rename(data.episode("bin_sort", "00007"))


def unpadded(data: DataSet) -> None:
    data.episodes()[0].rename(data.episode("bin_sort", "0"))


def recovered(data: DataSet) -> None:
    path = data.episodes()[0]
    recording = Recording.read(path)
    outcome = Outcome(success=False, stage=0, max_stage=5, kept=False, reason=INTERRUPTED, cut=True)
    replace(recording, info=replace(recording.info, outcome=outcome)).write(path)


@pytest.mark.parametrize("change", [renamed, unpadded, recovered])
@pytest.mark.parametrize("keep_failures", [False, True])
def test_episodes_that_are_not_what_their_number_says_are_not_counted(
    tmp_path, change, keep_failures
):
    data = DataSet.open(tmp_path)
    played(data, episodes=1, keep_failures=keep_failures)
    change(data)
    with pytest.raises(OtherRunError, match="was not recorded here under this name"):
        played(data, episodes=1, keep_failures=keep_failures)


def test_failures_that_were_kept_do_not_count_as_successes(tmp_path):
    data = DataSet.open(tmp_path)
    played(data, SOMETIMES, episodes=1, keep_failures=True)
    with pytest.raises(OtherRunError, match="with other options"):
        played(data, SOMETIMES, episodes=1)


def test_a_full_disk_is_no_failure_of_the_policy(tmp_path):
    data = DataSet.open(tmp_path / "full")
    with room(30_000), pytest.raises(OutputError, match="File too large"):
        played(data, episodes=1)
    assert not (data.path / ATTEMPTS).exists()
    whole = DataSet.open(tmp_path / "whole")
    assert played(data, episodes=1) == played(whole, episodes=1)
    assert contents(data) == contents(whole)
