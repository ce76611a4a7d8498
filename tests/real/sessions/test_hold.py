"""A hold holds: what was pressed before it moves nothing after it, and it spoils nothing."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.core.types import Side
from duobench.real.sessions.cameras import Film
from duobench.real.sessions.messages import Activate, Hold, Home, Message, Placed, Start
from duobench.real.sessions.session import (
    CONNECTION_LOST,
    HELD_BY_OPERATOR,
    TAKEN_OVER,
    Phase,
    Stopped,
)
from duobench.real.sessions.trials_folder import LogKind
from duobench.real.supervisor import State
from duobench.world.robot.mounts import HOME_JOINTS
from tests.quick_first import quick_first
from tests.real.rigs import once_while_homing, put
from tests.real.sessions.operator import Operator, Stand, only_record, played, run

SILENT = "The operator's page gave no sign for 2.0 s."


@pytest.fixture
def stand(tmp_path: Path) -> Iterator[Stand]:
    made = Stand(tmp_path / "t")
    with made.ending:
        yield made


class Waiting:
    """A view whose messages wait while something else happens."""

    def __init__(self, *messages: Message) -> None:
        self._messages = list(messages)

    def publish(self) -> None: ...

    def next(self) -> Message:
        if not self._messages:
            raise Stopped
        return self._messages.pop(0)

    @contextmanager
    def moving(self) -> Iterator[None]:
        yield


def place(stand: Stand, *messages: Message) -> list[State]:
    """Let a session do what waited; the states that the arms came to."""
    states: list[State] = []
    enter = stand.duo.supervisor.enter

    def entered(state: State, **more: Any) -> bool:
        states.append(state)
        return enter(state, **more)

    stand.duo.supervisor.enter = entered  # type: ignore[method-assign]
    stand.session.view = Waiting(*messages)
    with pytest.raises(Stopped):
        stand.session.place()
    return states


def test_home_that_waits_moves_nothing_after_a_hold(stand: Stand) -> None:
    stand.session.take(Home())
    stand.session.take(Hold())
    assert State.HOMING not in place(stand, Home())
    assert "confirmed" in stand.session.message
    stand.session.take(Home())
    assert place(stand, Home())[0] is State.HOMING


def test_start_that_waits_begins_nothing_after_a_hold(stand: Stand) -> None:
    stand.session.phase = Phase.READY
    stand.session.take(Start())
    stand.session.take(Hold())
    assert place(stand, Start()) == []
    assert "confirmed" in stand.session.message


def test_word_of_a_page_that_is_lost_meanwhile_moves_nothing(stand: Stand) -> None:
    stand.server.on_message(Home())
    stand.server.on_driver_lost(False)
    assert State.HOMING not in place(stand, Home())


def test_word_that_was_refused_does_not_count_later(stand: Stand) -> None:
    stand.duo.arms["left"].fail("joint_reflex")  # type: ignore[attr-defined]
    stand.duo.clock.wait_until(stand.duo.clock.now() + 0.1)
    stand.session.take(Home())
    place(stand, Home())
    assert "joint_reflex" in stand.session.message
    assert not stand.duo.supervisor.is_confirmed


@pytest.mark.parametrize("message", [Home(), Activate(), Placed()])
def test_page_forgets_at_a_hold_what_waits(stand: Stand, message: Message) -> None:
    view = stand.session.view
    stand.server.on_message(message)
    assert view.next() == message
    stand.server.on_message(message)
    stand.server.on_message(Hold())
    assert view.next() is None


def test_double_click_is_one_motion(stand: Stand) -> None:
    view = stand.session.view
    stand.server.on_message(Activate())
    stand.server.on_message(Activate())
    assert view.next() == Activate()
    with view.moving():
        pass
    assert view.next() is None


def test_page_that_goes_after_the_last_step_spoils_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand, held = Stand(tmp_path / "t"), []
    finish = Film.on_episode_end

    def slowly(film: Film, error: BaseException | None) -> None:
        held.append(stand.duo.held)
        stand.server.on_driver_lost(False)
        finish(film, error)

    monkeypatch.setattr(Film, "on_episode_end", slowly)

    with stand.ending:
        assert run(stand, lambda operator: operator.trial(1, 2))
    record, judged = only_record(stand)
    assert (record.final_stage, judged.repeated) == (2, ())
    assert held == ["The episode is over."]


def test_nothing_before_the_first_command_makes_a_trial_invalid(tmp_path: Path) -> None:
    """A silent page, a hold and a fault: on the way home, and while the policy is first asked."""

    def script(operator: Operator) -> None:
        duo, session = operator.stand.duo, operator.stand.session
        put(duo, HOME_JOINTS + np.array([0.3, 0, 0, 0, 0, 0, 0]))
        once_while_homing(duo, lambda: session.lose(SILENT))
        operator.start()
        operator.until(lambda status: SILENT in status["message"])
        operator.phase("ready")
        operator.say("start")
        operator.phase("playing")
        operator.press(3)
        operator.next_chunk(partial(operator.fail, Side.LEFT, "no answer"))
        operator.until(lambda status: status["fault"])
        operator.phase("ready")
        (start,) = (each for each in operator.status["panel"]["buttons"] if each["id"] == "start")
        assert (start["why_not"], start["is_next"]) == ("a fault stands", False)
        operator.recover()
        operator.say("start")
        operator.phase("playing")
        operator.say("hold")
        operator.next_chunk()
        operator.until(lambda status: HELD_BY_OPERATOR in status["message"])
        operator.phase("ready")
        assert operator.status["trial"]["attempt"] == 1
        operator.say("start")
        operator.phase("playing")
        operator.play([[1]])
        operator.finish()

    stand = played(tmp_path / "t", script)
    record, judged = only_record(stand)
    assert (record.final_stage, judged.repeated) == (1, ())
    assert [press.stage for press in judged.presses] == [1]
    kinds = [entry.kind for entry in stand.folder.read_log()]
    assert kinds.count(LogKind.NOT_BEGUN) == 3
    assert kinds.count(LogKind.BEGIN) == kinds.count(LogKind.END) == 1
    assert stand.folder.compared() == ""


@pytest.mark.parametrize(
    ("gives_way", "reason"), quick_first([(False, CONNECTION_LOST), (True, TAKEN_OVER)])
)
def test_page_that_goes_before_spoils_the_trial(
    tmp_path: Path, gives_way: bool, reason: str
) -> None:
    def script(operator: Operator) -> None:
        operator.begin()
        operator.next_chunk()
        operator.next_chunk(partial(operator.stand.server.on_driver_lost, gives_way))
        operator.attempt(2)
        operator.trial(1)

    _, judged = only_record(played(tmp_path / "t", script))
    (one,) = judged.repeated
    assert one.reason == reason
