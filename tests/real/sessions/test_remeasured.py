"""A rig that is measured again while an evaluation goes on, and one that is another."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from duobench.core.errors import OtherRunError
from duobench.core.types import Side
from duobench.evaluation.replay.verification import Verdict, verify
from duobench.real.cell import Obstacle
from duobench.real.rig import CameraCalibration, CameraConfig, GripperConfig, Rig
from duobench.real.sessions.trials_report import write_trials_report
from duobench.results.bundle import open_source, read_source, write_bundle
from duobench.results.comparison import compare
from duobench.world.robot.cameras import HEAD
from tests.real.sessions.operator import POLICIES, Operator, Stand, played, records, trials
from tests.real.simulated import CAMERA, simulated_rig

FIRST = simulated_rig()
LENS = CameraCalibration(fx=740.0, fy=740.0, cx=640.0, cy=360.0, pose=(0.0,) * 6 + (1.0,))


def gripper(rig: Rig, **fields: int) -> Rig:
    return replace(
        rig, grippers={**rig.grippers, Side.LEFT: replace(rig.grippers[Side.LEFT], **fields)}
    )


def arm(rig: Rig, **fields: float) -> Rig:
    return replace(rig, arms={**rig.arms, Side.RIGHT: replace(rig.arms[Side.RIGHT], **fields)})


def head(rig: Rig, camera: CameraConfig) -> Rig:
    return replace(rig, cameras={**rig.cameras, HEAD: camera})


AGAIN = head(
    gripper(replace(FIRST, name="after the move"), open_count=5, closed_count=226),
    replace(FIRST.cameras[HEAD], calibration=LENS),
)


def then_stop(operator: Operator) -> None:
    operator.trial(2)
    operator.stand.session.stop()


@pytest.mark.slow
def test_evaluation_goes_on_where_its_rig_was_measured_again(tmp_path: Path) -> None:
    path = tmp_path / "t"
    played(path, then_stop, POLICIES, rig=FIRST, is_complete=False)
    stand = played(path, trials(2), POLICIES, rig=AGAIN)
    folder = stand.folder
    found = [record.rig for each in records(folder).values() for record in each]
    assert sorted(map(str, found)) == sorted([FIRST.hash, AGAIN.hash])
    assert {Rig.read(file).hash: file.stem for file in (path / "rigs").iterdir()} == {
        rig.hash: rig.hash for rig in (FIRST, AGAIN)
    }
    assert Rig.read(folder.rig) == AGAIN
    report = write_trials_report(folder)
    assert report.rigs.startswith("2 measurements")
    assert "2 measurements" in folder.page.read_text()
    (pair,) = compare([str(folder.run.path)]).pairs
    assert pair.paired
    assert pair.conditions == ()
    assert {each.verdict for each in verify(open_source(folder.run.path)).findings} == {
        Verdict.UNVERIFIABLE
    }
    write_bundle(folder.run, tmp_path / "b.duobench.zip")
    assert read_source(tmp_path / "b.duobench.zip") == read_source(folder.run.path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rig: arm(rig, speed_fraction=0.25), "arms.right.speed_fraction 0.25 instead of"),
        (lambda rig: arm(rig, moment_threshold=5.0), "arms.right.moment_threshold 5.0 instead of"),
        (lambda rig: gripper(rig, force=200), "grippers.left.force 200 instead of"),
        (
            lambda rig: head(rig, CameraConfig(driver=CAMERA, gain=2.0)),
            "cameras.head.gain 2.0 instead of None",
        ),
        (
            lambda rig: replace(
                rig, obstacles={"name": Obstacle(centre=(1.0, 1.0, 0.1), size=(0.1, 0.1, 0.1))}
            ),
            "obstacles.name",  # whatever it is called
        ),
        (
            lambda rig: replace(rig, cameras={}),
            "cameras.head.driver None instead of tests.real.simulated:SimulatedCamera",
        ),
    ],
    ids=("speed", "threshold", "force", "gain", "obstacle", "fewer cameras"),
)
def test_another_rig_is_refused_with_what_is_different(
    change: Callable[[Rig], Rig], words: str, tmp_path: Path
) -> None:
    Stand(tmp_path / "t", POLICIES, rig=FIRST).ending.close()
    before = sorted(file.read_bytes() for file in tmp_path.rglob("*.json"))
    with pytest.raises(OtherRunError, match=words):
        Stand(tmp_path / "t", POLICIES, rig=change(FIRST))
    assert sorted(file.read_bytes() for file in tmp_path.rglob("*.json")) == before


def test_everything_but_what_is_measured_makes_a_rig(tmp_path: Path) -> None:
    assert AGAIN.hash != FIRST.hash
    assert AGAIN.chosen == FIRST.chosen
    assert "grippers.left.port" in FIRST.chosen
    assert not any("count" in place or "calibration" in place for place in FIRST.chosen)
    other = replace(FIRST, grippers={**FIRST.grippers, Side.LEFT: GripperConfig(port="/dev/x")})
    assert other.chosen != FIRST.chosen
    FIRST.write(tmp_path / "rig.json")
    assert Rig.read(tmp_path / "rig.json").chosen == FIRST.chosen
