"""What an operator discards is not lost before the session ends, and every take is counted."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import pytest

from duobench.core.errors import BackendError, LockedError
from duobench.data import DataSet, find_problems, summarize
from duobench.data.attempts import SKIPPED, of_task
from duobench.data.recorder import UNDECIDED
from duobench.teleop.session_episodes import NOTHING_DISCARDED, SET_ASIDE
from duobench.teleop.teleoperation import DISCARDED, TeleopState
from tests.teleop.test_session import TASK, Desk

TAPS = 1000
SEED = 7
ASKS = ("keep", "discard", "restore")
HELD = dict.fromkeys((*ASKS, "recentre"), False)


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    made = Desk(tmp_path)
    yield made
    made.session.close()


def take(desk: Desk, steps: int = 5) -> None:
    """Record some steps of an episode."""
    desk.begin()
    desk.rise(steps - 1)


def files(folder: Path) -> dict[str, bytes]:
    """Content of the episodes by name."""
    return {path.stem: path.read_bytes() for path in DataSet(folder).episodes()}


def tried(folder: Path) -> list[tuple[int, bool, str | None]]:
    return [(each.episode, each.kept, each.error) for each in of_task(DataSet(folder), TASK)]


@pytest.mark.slow
def test_what_is_restored_has_the_bytes_of_what_was_kept(tmp_path: Path) -> None:
    kept, restored = Desk(tmp_path / "kept"), Desk(tmp_path / "restored")
    for one in (kept, restored):
        one.solve()
    kept.say("keep")
    restored.say("discard")
    assert files(tmp_path / "restored") == {}
    restored.bring_back()
    for one in (kept, restored):
        assert (one.session.kept, one.status("count")) == (1, 1)
        one.session.close()
    assert files(tmp_path / "restored") == files(tmp_path / "kept")
    assert find_problems(DataSet(tmp_path / "restored")) == []


def test_a_take_that_ran_comes_back_cut_where_it_was_discarded(tmp_path: Path) -> None:
    kept, restored = Desk(tmp_path / "kept"), Desk(tmp_path / "restored")
    for one in (kept, restored):
        take(one)
    kept.session.env.finish(reason=SET_ASIDE)
    kept.session.env.keep()
    restored.say("discard")
    take(restored, 3)
    restored.say("restore")
    assert restored.state is TeleopState.RECORDING, "what goes on goes on"
    restored.say("discard")
    restored.say("keep")
    assert files(tmp_path / "restored") == files(tmp_path / "kept")
    for one in (kept, restored):
        one.session.close()


def test_the_last_discarded_comes_back_first_and_nothing_comes_of_nothing(
    desk: Desk, tmp_path: Path
) -> None:
    desk.say("restore")
    assert desk.session.note == NOTHING_DISCARDED or "Waiting" in desk.session.note
    for steps in (4, 5, 6):
        take(desk, steps)
        desk.say("discard")
    for number, left in ((2, 2), (1, 1), (0, 0)):
        desk.bring_back()
        assert (min(files(tmp_path)), desk.status("discarded")) == (f"{number:05d}", left)
    assert [len(each) for each in desk.recordings()] == [4, 5, 6]
    assert desk.session.kept == 3


def test_discarded_episodes_go_with_the_session(desk: Desk, tmp_path: Path) -> None:
    take(desk)
    desk.say("discard")
    assert list((tmp_path / "discarded").rglob("*.parquet"))
    desk.session.close()
    assert not (tmp_path / "discarded").exists()
    assert files(tmp_path) == {}


def test_what_a_killed_session_has_discarded_is_offered_to_the_next(tmp_path: Path) -> None:
    killed = Desk(tmp_path)
    take(killed)
    killed.say("discard")
    with pytest.raises(LockedError, match="Another process"):
        Desk(tmp_path)
    killed.session._episodes._lock.close()  # as the system does when a process ends
    killed.session.env.discard()
    after = Desk(tmp_path)
    assert (after.status("discarded"), after.status("count")) == (1, 1)
    after.bring_back()
    assert list(files(tmp_path)) == ["00000"]
    after.session.close()


def test_what_a_session_that_broke_has_discarded_is_offered_to_the_next(tmp_path: Path) -> None:
    broken = Desk(tmp_path)
    take(broken)
    broken.say("discard")
    with pytest.raises(BackendError), broken.session:
        raise BackendError("A device is gone.")
    after = Desk(tmp_path)
    assert after.status("discarded") == 1
    with after.session:
        pass
    assert not (tmp_path / "discarded").exists()


def test_an_episode_is_not_restored_over_another(desk: Desk, tmp_path: Path) -> None:
    take(desk)
    desk.say("discard")
    place = DataSet(tmp_path).episode(TASK, "00000")
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(b"another")
    notes = desk.bring_back()
    assert "never overwritten" in notes
    assert (desk.state, desk.status("discarded")) == (TeleopState.WAITING, 1)
    assert place.read_bytes() == b"another"
    place.unlink()


def test_a_session_is_over_when_what_it_wanted_is_restored(tmp_path: Path) -> None:
    desk = Desk(tmp_path, episodes=1)
    take(desk)
    desk.say("discard")
    desk.bring_back()
    assert (desk.state, desk.session.kept) == (TeleopState.OVER, 1)
    desk.session.close()
    assert list(files(tmp_path)) == ["00000"]


def test_every_take_is_counted_and_layouts_that_were_given_up_are_named(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    desk.solve()
    desk.say("keep")
    desk.leave()  # the next hands have another clock
    take(desk)
    desk.say("discard")
    desk.say("discard")  # the next layout, which nobody has begun
    take(desk)
    assert tried(tmp_path)[-1] == (3, False, UNDECIDED), "what a kill would leave"
    desk.session.close()
    expected = [(0, True, None), (1, False, DISCARDED), (2, False, SKIPPED), (3, False, UNDECIDED)]
    assert tried(tmp_path) == expected
    (task,) = summarize(DataSet(tmp_path)).tasks
    assert task.attempted == "3 begun, 1 of them kept; given up: layouts 1, 2, 3"
    again = Desk(tmp_path)
    assert again.status("count") == 4, "it goes on with the next layout"
    take(again)
    again.say("discard")
    again.bring_back()
    again.session.close()
    assert tried(tmp_path) == [*expected, (4, True, None)]


def test_restoring_brings_back_the_question_and_not_the_answer(desk: Desk, tmp_path: Path) -> None:
    take(desk)
    desk.say("discard")
    desk.say("restore")
    assert (desk.state, desk.status("discarded")) == (TeleopState.DECIDE, 0)
    assert [each.id for each in desk.session.panel.buttons] == ["keep", "discard"]
    assert desk.status("note") == "Keep episode 00000 (0.2 s, stage 0 of 3), or discard it again?"
    desk.send(left=1, right=1, turns=5)
    assert (files(tmp_path), desk.session.kept) == ({}, 0), "nothing is kept unasked"
    desk.say("discard")
    assert (desk.state, desk.status("count")) == (TeleopState.WAITING, 1), "no layout is lost"
    assert tried(tmp_path) == [(0, False, DISCARDED)]
    assert desk.status("discarded") == 1, "it can be restored again"


def test_a_restored_take_is_asked_about_when_what_runs_is_decided(tmp_path: Path) -> None:
    """Also if that is the last one that is wanted: nothing that was asked back goes away."""
    desk = Desk(tmp_path, episodes=1)
    take(desk)
    desk.say("discard")
    take(desk, 4)
    desk.say("restore")
    desk.rise(2)
    assert desk.state is TeleopState.RECORDING
    assert "once this one is over" in desk.status("note")
    desk.session._end("Time is up.")
    desk.say("keep")
    assert (desk.state, desk.session.kept) == (TeleopState.DECIDE, 1)
    assert "Keep episode 00000" in desk.status("note")
    desk.say("restore")
    assert "Keep episode 00000" in desk.status("note"), "nothing comes of nothing"
    desk.say("keep")
    assert (desk.state, desk.session.kept) == (TeleopState.OVER, 1), "of the one layout"
    desk.session.close()
    assert tried(tmp_path) == [(0, True, None), (1, True, None)]
    assert sorted(files(tmp_path)) == ["00000", "00001"]


@pytest.mark.long
def test_a_thousand_taps_destroy_no_row(tmp_path: Path) -> None:
    """Words of the page and its keys, and buttons of a headset, in any order at any moment."""
    desk, draw = Desk(tmp_path, episodes=10 * TAPS), random.Random(SEED)
    seen: set[str] = set()
    takes = 0
    for _ in range(TAPS):
        if desk.state is TeleopState.WAITING:
            desk.begin()
        tap = draw.choice((*ASKS, "recentre", "squeeze"))
        running = f"{desk.status('count'):05d}"
        if tap == "squeeze":
            desk.send(left=1, right=draw.random(), trigger=draw.random())
        elif draw.random() < 0.5:
            desk.say(tap)
        else:
            desk.send(left=1, right=1, buttons=HELD | {tap: True})
            if desk.state is not TeleopState.WAITING:
                desk.send(left=1, right=1, buttons=HELD)
        if f"{desk.status('count'):05d}" != running:
            takes += 1
        assert seen <= (seen := {path.stem for path in _all(tmp_path)})
    while desk.state is not TeleopState.WAITING:  # else a restored one is asked about later
        running = desk.status("count")
        desk.say("discard")
        takes += desk.status("count") != running
    assert takes > TAPS // 10
    before = {path.stem: path.read_bytes() for path in _all(tmp_path)}
    while desk.status("discarded"):
        desk.bring_back()
    assert files(tmp_path) == before
    assert len(before) == takes
    desk.session.close()
    assert {name: files(tmp_path)[name] for name in before} == before


def _all(folder: Path) -> list[Path]:
    """Episodes in their place and discarded ones."""
    data = DataSet(folder)
    return data.episodes() + data.discarded.episodes()
