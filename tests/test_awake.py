"""Time that does not pass while a process is stopped."""

import pytest

from duobench.core.machine import LAPSE_S, Awake


@pytest.fixture
def now(monkeypatch):
    moment = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: moment[0])
    return moment


def test_time_passes_where_nothing_notes_it(now):
    now[0] += 1000.0
    assert Awake().seconds_since(100.0) == 1000.0


def test_what_lies_between_two_notes_is_no_time_if_it_is_long(now):
    awake = Awake()
    for seconds in (0.0, 1.0, LAPSE_S, 60.0, 0.5):
        now[0] += seconds
        awake.note()
    assert awake.seconds_since(100.0) == pytest.approx(1.0 + LAPSE_S + 0.5)
    assert awake.seconds_since(100.0 + 1.0 + LAPSE_S + 20.0) == pytest.approx(0.5)
    now[0] += 30.0  # asked before the next note
    assert awake.seconds_since(100.0) == pytest.approx(1.0 + LAPSE_S + 0.5)
    assert awake.seconds_since(now[0]) == 0.0


def test_a_long_life_of_short_stops_is_remembered_for_a_while_only(now):
    awake = Awake()
    for _ in range(1000):
        now[0] += 10.0
        awake.note()
    assert awake.seconds_since(now[0] - 55.0) == pytest.approx(0.0)
