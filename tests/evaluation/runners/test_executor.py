"""Workers are real processes here, and really hang, die and leave helpers behind.

A policy is apart from the simulator, and is asked once before anything is played or written.
"""

import os
import socket
import threading
import time
from pathlib import Path

import pytest

from duobench.core.errors import (
    MachineryError,
    OtherRunError,
    PolicyError,
    RenderingError,
    UnplayedError,
)
from duobench.evaluation.runners import executor, process
from duobench.evaluation.runners.process import Channel
from duobench.evaluation.runners.worker import EpisodeError, Report, Request
from duobench.policy import Batching
from duobench.results.journal import Ended
from duobench.results.run import Resuming, TimeLimits
from duobench.results.suite import find_tasks
from tests.evaluation import toy_batches, toy_tasks
from tests.evaluation.conftest import assert_same_episodes, compared
from tests.evaluation.processes import is_running, wait_until
from tests.evaluation.runners.test_batches import episodes, named
from tests.quick_first import quick_first

WAVE = {"workers": 1, "episodes": 1, "tasks": find_tasks([toy_tasks.WAVE_NAME])}


def marked(tmp_path: Path, kind: str) -> list[int]:
    """Numbers of the processes that left a mark."""
    return [int(path.name.split("-")[1]) for path in (tmp_path / "marks").glob(f"{kind}-*")]


def assert_gone(pids: list[int]) -> None:
    wait_until(lambda: not any(map(is_running, pids)), "the end of the helpers")


@pytest.mark.long
def test_dying_workers_are_replaced_and_their_episodes_played_again(play, reference, tmp_path):
    folder, results = play("DiesOnce", workers=2, episodes=1)
    assert results.overall.errors == 0
    assert_same_episodes(folder, reference, 2)
    helpers = marked(tmp_path, "helper")
    assert len(helpers) == 2
    assert_gone(helpers)


@pytest.mark.long
def test_episode_that_always_kills_its_simulator_is_set_aside_and_all_others_are_played(
    play, tmp_path, monkeypatch
):
    monkeypatch.setenv(toy_tasks.MISBEHAVIOUR, "dies_in_one")
    message = r"1 episode could not be played\. .* nod, episode 1: in each of 3 .*by SIGKILL\."
    with pytest.raises(UnplayedError, match=message):
        play("hold", workers=1, episodes=3)
    records = (tmp_path / "run" / "records").glob("*/*/*")
    assert sorted(f"{path.parts[-3]}/{path.name}" for path in records) == [
        *(f"nod/0000{k}.json" for k in (0, 2)),
        *(f"wave/0000{k}.json" for k in (0, 1, 2)),
    ]
    assert (tmp_path / "run" / "index.html").exists()
    _, results = play(
        "hold", workers=2, episodes=3, resuming=Resuming(unplayed_count_as_failures=True)
    )
    records = results.tasks[1].records
    assert [bool(record.reason) for record in records] == [False, True, False]
    assert "It was not played: in each of 3 attempts" in records[1].reason
    assert records[1].earlier == ("worker",) * 5


@pytest.mark.long
@pytest.mark.parametrize("policy", ["DiesInOne", named(toy_batches.DiesInOne)])
def test_policy_whose_process_ends_twice_in_an_episode_has_failed_it(play, policy):
    folder, results = play(policy, workers=2, episodes=3)
    (record,) = [each for one in results.tasks for each in one.records if each.error]
    assert "In 2 attempts the policy's process ended by itself, the last time: " in record.reason
    assert (record.task, record.earlier[-1], record.sent) == ("nod", "policy", None)
    assert folder.attempts()[record.key.path] == (*record.earlier, "error")


@pytest.mark.long
def test_ends_of_a_policy_are_counted_over_commands(play):
    folder, results = play("DiesOnce", workers=1, episodes=1)
    record = results.tasks[0].records[0]
    assert (record.attempt, record.earlier, record.error) == (2, ("policy",), None)
    folder.discard(record.key)
    for mark in (folder.path.parent / "marks").iterdir():
        mark.unlink()
    _, results = play("DiesOnce", workers=1, episodes=1)
    record = results.tasks[0].records[0]
    assert record.earlier == ("policy", "failure")
    assert "In 2 attempts the policy's process ended by itself" in record.reason


@pytest.mark.long
@pytest.mark.parametrize("misbehaviour", ["answers_for_another", "answers_twice"])
def test_result_that_nobody_asked_for_is_dropped(
    play, reference, tmp_path, monkeypatch, misbehaviour
):
    monkeypatch.setenv(toy_tasks.MISBEHAVIOUR, misbehaviour)
    folder, results = play("random", workers=1, episodes=2)
    assert list((tmp_path / "marks").iterdir())
    assert results.overall.errors == 0
    assert_same_episodes(folder, reference, 4)
    ended = [each.how for each in folder.entries() if isinstance(each, Ended)]
    assert sum(how in ("success", "failure") for how in ended) == 4
    assert {*ended} <= {"success", "failure", "worker"}


@pytest.mark.slow
def test_policy_that_spoils_its_clock_fails_its_episode_alone(play):
    _, results = play("SpoilsClock", workers=1, episodes=2, tasks=find_tasks([toy_tasks.NOD_NAME]))
    for record in results.tasks[0].records:
        assert record.reason.startswith("PolicyTimeoutError")
        assert 0 <= record.steps <= record.horizon


def test_time_to_read_a_message_grows_with_its_length_alone(monkeypatch):
    """Eight times as long takes eight times as long, on any machine; were all looked through again
    with each piece that comes, it would be up to sixty-four times.
    """
    monkeypatch.setattr(process, "_PIECE", 4096)
    short, long = (reading_time(length << 20) for length in (2, 16))
    assert long < 20 * short


def reading_time(length: int) -> float:
    """Processor time that a message of this many bytes, and one after it, take to be read."""
    reports: list[Report] = [EpisodeError("a" * length), EpisodeError("short")]
    ours, theirs = socket.socketpair()
    sender = Channel(theirs, Request)
    receiver = Channel(ours, Report)
    thread = threading.Thread(target=lambda: [sender.send(report) for report in reports])
    received: list[Report] = []
    start = time.process_time()
    with ours, theirs:
        thread.start()
        while len(received) < len(reports):
            received += receiver.receive()
        thread.join()
    assert received == reports
    return time.process_time() - start


@pytest.mark.long
def test_policy_that_hangs_fails_its_episode_and_the_run_goes_on(play):
    _, results = play("Hangs", **WAVE | {"episodes": 2, "limits": TimeLimits(act_timeout=3.0)})
    first, second = results.tasks[0].records
    assert first.error == (
        "PolicyTimeoutError: The policy did not answer within 3 s, its limit for one reset or act."
        "\n"
    )
    assert first.versions == second.versions
    assert second.error is None


@pytest.mark.long
@pytest.mark.parametrize("limits", [{"act_timeout": 3.0}, {"episode_timeout": 3.0}])
def test_stopped_policy_keeps_what_its_episode_had_reached(play, limits):
    asked = WAVE | {"limits": TimeLimits(**limits)}
    alone, _ = play("Tires", "alone", **asked | {"workers": 0})
    folder, results = play("Tires", **asked)
    ((record,),) = [one.records for one in results.tasks]
    assert record.reason.startswith("PolicyTimeoutError")
    assert [stage for _, stage in record.stage_changes] == [1, 2]
    assert (record.steps, record.final_stage, record.success) == (22, 2, False)
    assert compared(folder) == compared(alone)


def test_what_looks_like_an_interrupt_of_a_policy_is_its_error(play):
    _, results = play("Interrupts", workers=1, episodes=1)
    assert [one.records[0].reason for one in results.tasks] == ["KeyboardInterrupt"] * 2


def test_one_worker_is_a_process_of_its_own_and_its_helpers_end_with_it(play, tmp_path):
    play("HasHelpers", **WAVE)
    (policy,) = marked(tmp_path, "policy")
    helpers = marked(tmp_path, "helper")
    assert policy != os.getpid()
    assert len(helpers) == 3
    assert_gone([policy, *helpers])
    assert (tmp_path / "marks" / "closed").exists()


@pytest.mark.slow
@pytest.mark.parametrize("workers", [0, 1])
def test_fault_of_the_machinery_is_played_again_and_then_ends_the_run(play, monkeypatch, workers):
    if workers:
        monkeypatch.setenv(toy_tasks.MISBEHAVIOUR, "has_no_graphics")
    else:
        monkeypatch.setattr("duobench.evaluation.episode.rollout", toy_tasks.without_graphics)
    message = r"wave, episode 0 cannot be played; in each of 3 attempts .* The driver hangs\."
    with pytest.raises(MachineryError, match=message):
        play("hold", workers=workers, episodes=1)


@pytest.mark.parametrize("workers", quick_first([0, 1]))
def test_policy_that_needs_images_where_nothing_renders_ends_the_run(play, monkeypatch, workers):
    monkeypatch.setenv("MUJOCO_GL", "off")
    with pytest.raises(RenderingError, match="switched off by MUJOCO_GL=off"):
        play("Sees", workers=workers, episodes=1)


@pytest.mark.long
def test_simulation_that_does_not_come_back_is_played_again(play, monkeypatch):
    monkeypatch.setattr(executor, "GRACE_S", 1.0)
    tasks = find_tasks([f"{toy_tasks.__name__}:STUCK"])
    limits = TimeLimits(episode_timeout=5.0)
    _, results = play("hold", workers=1, episodes=1, tasks=tasks, limits=limits)
    assert (results.overall.episodes, results.overall.errors) == (1, 0)


# --- the policy is apart, and asked in advance ---------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("workers", [1, 2])
def test_policy_that_searches_its_process_finds_no_simulator(play, reference, workers):
    folder, results = play("Searches", workers=workers)
    assert results.overall.errors == 0
    assert_same_episodes(folder, reference, 8)


@pytest.mark.slow
def test_batch_policy_that_searches_its_process_finds_no_simulator(play):
    runs = [
        play(named(policy, Batching(size=2)), policy.__name__, workers=2, episodes=2)
        for policy in (toy_batches.Searches, toy_batches.Wanders)
    ]
    assert [results.overall.errors for _, results in runs] == [0, 0]
    searched, plain = (episodes(folder) for folder, _ in runs)
    assert searched == plain


@pytest.mark.long
@pytest.mark.parametrize(
    ("policy", "workers", "error", "message"),
    [
        ("Searches", 0, PolicyError, "does not answer .*first observation.*RuntimeError: found"),
        ("IsTooWide", 0, PolicyError, "does not answer .*first observation.*17"),
        ("IsTooWide", 1, PolicyError, "does not answer .*first observation.*17"),
        ("DiesAtOnce", 1, PolicyError, "does not answer .*first observation.*process ended"),
        ("dies_when_made", 1, MachineryError, "3 workers in a row.*ended by SIGKILL"),
    ],
)
def test_policy_that_cannot_answer_is_refused_before_anything_is_written(
    play, tmp_path, policy, workers, error, message
):
    with pytest.raises(error, match=f"(?s){message}"):
        play(policy, workers=workers)
    assert not (tmp_path / "run" / "run.json").exists()


@pytest.mark.slow
def test_run_of_nothing_but_errors_gives_way_to_a_changed_policy(play, reference):
    _, results = play("RaisesInTheSecondAnswer", workers=1)
    assert results.overall.errors == results.overall.episodes == 8
    folder, results = play("random")
    assert results.overall.errors == 0
    assert compared(folder) == reference


@pytest.mark.slow
def test_run_with_one_good_episode_is_kept_unless_it_is_begun_anew(play, reference):
    folder, _ = play("BreaksOnce")
    stranger = folder.path / "notes.txt"
    stranger.write_text("mine")
    with pytest.raises(OtherRunError, match="another evaluation"):
        play("random")
    again, _ = play("random", resuming=Resuming(fresh=True))
    assert stranger.read_text() == "mine"
    stranger.unlink()
    assert compared(again) == reference


def test_nothing_is_removed_where_there_is_no_run(play, tmp_path):
    mine = tmp_path / "run" / "records" / "wave" / "00000.json"
    mine.parent.mkdir(parents=True)
    mine.write_text("mine")
    with pytest.raises(OtherRunError, match="holds no evaluation"):
        play("random", resuming=Resuming(fresh=True))
    assert mine.read_text() == "mine"


@pytest.mark.long
def test_time_of_the_policy_is_known_apart_from_waiting_for_it(play):
    folder, results = play("Dawdles", workers=1, episodes=1)
    times = [entry.times for entry in folder.entries() if isinstance(entry, Ended)]
    assert len(times) == 2
    for each in times:
        assert each is not None
        assert each.policy >= 0.1 * (toy_tasks.HORIZON - 1)
        assert each.waiting > 0
    assert results.overall.errors == 0
