"""The first example of teleoperation can be done as its page says it, step by step.

Who does it sees block, bowl and hands to a centimetre and ten degrees, see `keyboard`, and knows no
more of the task than the page says.
"""

from __future__ import annotations

import math
import re
import shlex
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from duobench.core.types import CONTROL_HZ, Array
from duobench.data import Actor, ActorKind, DataSet, find_problems
from duobench.teleop.messages import Discard, Keep
from duobench.teleop.teleoperation import TeleopState
from duobench.world.objects.blocks import LONG_BLOCK
from tests.docs.markdown import page_of, text_of
from tests.teleop.keyboard import Keyboard, seen
from tests.teleop.paging import lockstep_session

SECTION = text_of(page_of("teleoperation")).partition("## In two minutes")[2].partition("\n## ")[0]
LEFT, UP = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
RIGHT_OR_AWAY = np.array([1.0, -1.0, 0.0])
LAYOUTS = [0, *(pytest.param(number, marks=pytest.mark.slow) for number in (1, 2, 3))]
LONGEST = 2 * 60 * CONTROL_HZ
"""Control steps of the two minutes that the page promises."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Step:
    """What a step of the page says: keys, metres, a lean in radians, steps to wait, a stage."""

    keys: list[str]
    lengths: list[float]
    lean: float
    wait: int
    stage: int | None

    @classmethod
    def read(cls, text: str) -> Step:
        words = " ".join(text.split())
        degrees, stages, seconds = (
            [int(number) for number in re.findall(pattern, words)]
            for pattern in (r"(\d+) degrees", r"stage (\d)", r"(\d+) seconds")
        )
        return cls(
            keys=re.findall(r"\*\*(.+?)\*\*", words),
            lengths=[int(number) / 100 for number in re.findall(r"(\d+) cm", words)],
            lean=math.radians(*degrees or [0]),
            wait=round(CONTROL_HZ * sum(seconds)),
            stage=stages[0] if stages else None,
        )


STEPS = [Step.read(each) for each in re.findall(r"^\d\. ((?:.*\n)(?:   .*\n)*)", SECTION, re.M)]


def block(keys: Keyboard) -> tuple[Array, Array]:
    """The middle of the block, and its direction, by where its ends are seen."""
    pose = keys.simulation.pose("cube")
    half = pose.rotation[:, 0] * LONG_BLOCK / 2
    one, other = seen(pose.translation - half), seen(pose.translation + half)
    return (one + other) / 2, (other - one) / math.dist(one, other)


def hand(camera: Array, lean: float) -> Array:
    """Orientation of a hand that points down and leans towards its camera, on a level side."""
    along = -math.sin(lean) * camera - math.cos(lean) * UP
    across = np.cross(along, camera) / math.cos(lean)
    return np.column_stack([np.cross(across, along), across, along])


def pick_up(keys: Keyboard, step: Step) -> None:
    above, aside, low, lift = step.lengths
    middle, axis = block(keys)
    camera = axis * (1, 1, 0) * np.sign(axis @ RIGHT_OR_AWAY)
    keys.face(hand(camera / math.hypot(*camera), step.lean))
    at = middle + aside * camera
    keys.bring(at + above * UP)
    keys.bring([*at[:2], low])
    keys.grip(*step.keys)
    keys.bring([*at[:2], low + lift])


def lay_across(keys: Keyboard, step: Step) -> None:
    keys.face(hand(-LEFT, STEPS[0].lean))
    away, height = step.lengths
    keys.bring(keys.tool.translation + np.array([away, 0.0, height]) - block(keys)[0])


def clasp(keys: Keyboard, step: Step) -> None:
    away, aside = step.lengths
    orientation = hand(LEFT, step.lean)
    keys.face(orientation)
    middle, axis = block(keys)
    goal = middle + aside * axis * np.sign(axis @ LEFT)
    keys.bring(goal - away * orientation[:, 2])
    keys.bring(goal)
    keys.grip(*step.keys)


def let_go(keys: Keyboard, step: Step) -> None:
    keys.grip(*step.keys)
    keys.bring(keys.tool.apply((0.0, 0.0, -step.lengths[0])))


def put_down(keys: Keyboard, step: Step) -> None:
    over, low, lift = step.lengths
    x, y, _ = keys.tool.translation - block(keys)[0] + seen(keys.simulation.position("bowl"))
    keys.bring((x, y, over))
    keys.bring((x, y, low))
    keys.grip(*step.keys)
    keys.bring((x, y, low + lift))
    keys.wait(step.wait)


@pytest.mark.long
@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_first_example_can_be_done_as_its_page_says(tmp_path: Path, layout: int) -> None:
    (command,) = re.findall(r"^```\n(duobench teleop .*)\n```", SECTION, re.MULTILINE)
    _, _, task, *_, operator = shlex.split(command)
    actor = Actor(kind=ActorKind.SCRIPTED_OPERATOR, name=operator, device="mouse")
    data = DataSet.open(tmp_path)
    with closing(lockstep_session(task, data, actor=actor)) as session:
        for _ in range(layout):
            session.receive(Discard(), 0.0)
            session.advance(0.0)
        keys = Keyboard(session)
        for step, act in zip(STEPS, (pick_up, lay_across, clasp, let_go, put_down), strict=True):
            keys.learn(*step.keys)
            keys.take(*step.keys)
            act(keys, step)
            assert step.stage in {None, session.status()["stage"]}, act
        assert session.state is TeleopState.DECIDE
        keys.press("Enter")
        session.receive(Keep(), 0.0)
        session.advance(0.0)
        assert session.state is TeleopState.OVER
    (recording,) = data.recordings()
    assert recording.info.outcome is not None
    assert recording.info.outcome.success
    assert len(recording) < LONGEST
    assert not recording.clutch.all(axis=1).any()  # one arm at a time
    assert set(np.unique(recording.action[:, [7, 15]])) == {0.0, 1.0}  # open or closed
    assert not find_problems(data)
