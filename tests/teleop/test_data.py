"""What is recorded in a session is data: checked, shown, replayed, exported as that of experts."""

import re
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from duobench.cli import main
from duobench.data import DataSet, ExportOptions, export_lerobot, find_problems
from duobench.envs.sim_env import sim_of
from duobench.evaluation.replay import replay
from duobench.teleop.teleoperation import TeleopState
from tests.teleop.operator import Operator, said
from tests.teleop.paging import lockstep_session, record

TASKS = ("bin_sort", "carry_pot")
EPISODES = 2


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> DataSet:
    found = DataSet.open(tmp_path_factory.mktemp("people") / "data")
    for task in TASKS:
        record(task, found, EPISODES)
    return found


@pytest.mark.long
def test_the_page_and_the_terminal_say_who_recorded(
    data: DataSet, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["data", "info", str(data.path), "--no-images"])
    said = capsys.readouterr().out
    page = (data.path / "index.html").read_text(encoding="utf-8")
    assert "Recorded by scripted operator follower with hands" in said
    assert "bin_sort: a hand led an arm in 100% of the steps" in said
    assert "scripted operator follower with hands, whose hands led in 100 % of the steps" in page
    assert "person" not in page
    assert "bin_sort: 2 begun, 2 of them kept" in said
    assert page.count("2 begun, 2 of them kept") == len(TASKS)


@pytest.mark.slow
def test_nothing_is_wrong_with_it(data: DataSet, capsys: pytest.CaptureFixture[str]) -> None:
    assert not find_problems(data)
    main(["data", "check", str(data.path)])
    assert str(len(TASKS) * EPISODES) in capsys.readouterr().out


@pytest.mark.slow
def test_every_episode_is_replayed_to_the_last_bit(data: DataSet) -> None:
    for task in TASKS:
        assert all(each.is_exact for each in replay(task, data.recordings(task)))


class Dropping(Operator):
    """Lets everything go for good while both cubes are above their bowls: they fall alone."""

    has_let_go = False

    def next_message(self) -> bytes:
        hands = super().next_message()
        simulation = sim_of(self._session.env).simulation
        away = [
            simulation.position(f"{colour}_cube") - simulation.position(f"{colour}_bowl")
            for colour in ("white", "black")
        ]
        if self._arms is not None:
            self.has_let_go |= bool((np.abs(away) < (0.01, 0.01, 0.06)).all())
        if not self.has_let_go:
            return hands
        return re.sub(rb'"(squeeze|trigger)": [0-9.]+', rb'"\1": 0.0', hands)


def test_what_falls_after_it_was_let_go_is_recorded_to_the_last_stage(tmp_path: Path) -> None:
    with closing(lockstep_session("bin_sort", tmp_path)) as session:
        operator = Dropping(session)
        while session.state is not TeleopState.OVER:
            session.receive(said(operator.next_message()), 0.0)
            session.advance(0.0)
            assert session.status()["pace"] != "standing", session.status()
    (recording,) = DataSet(tmp_path).recordings()
    assert recording.success_step is not None
    led = int(np.flatnonzero(recording.clutch.any(axis=1))[-1])
    assert recording.stage[led] < recording.stage[-1]
    assert 15 < recording.success_step - led < 91
    assert all(each.is_exact for each in replay("bin_sort", [recording]))


@pytest.mark.parametrize("action", ["joint", "cartesian_relative"])
def test_it_is_exported_in_every_mode(data: DataSet, tmp_path: Path, action: str) -> None:
    options = ExportOptions(cameras=(), action=action, after_success=True)
    exported = export_lerobot(data, tmp_path / "out", options, workers=0)
    assert exported.episodes == len(TASKS) * EPISODES
    assert exported.frames == sum(map(len, data.recordings()))
