from __future__ import annotations

import math

import numpy as np

from duobench.core.spatial import SE3, length, rotation_by
from duobench.core.types import CONTROL_HZ, SIDES, Side
from duobench.teleop.shaping import BOX, LEASH, REACH, OneEuro, Shaper
from duobench.world.kinematics import inverse
from duobench.world.robot.frames import ROBOT

DOWN = SE3.about((1, 0, 0), math.pi)


def tool(x: float, y: float, z: float) -> SE3:
    return SE3(DOWN.rotation, np.array([x, y, z]))


def test_noise_of_a_hand_at_rest_is_smoothed() -> None:
    rng, smooth = np.random.default_rng(0), OneEuro()
    before, after = [], []
    for _ in range(300):
        shake, turn = rng.normal(scale=0.001, size=3), rng.normal(scale=0.005, size=3)
        noisy = SE3(rotation_by(turn) @ DOWN.rotation, shake + 0.3)
        before.append(noisy.translation)
        after.append(smooth(noisy).translation)
    steps = [np.linalg.norm(np.diff(each[30:], axis=0), axis=1).mean() for each in (before, after)]
    assert steps[1] < steps[0] / 4


def test_a_moving_hand_hardly_lags_and_arrives_exactly() -> None:
    smooth, speed = OneEuro(), 0.5
    lags = []
    for number in range(30):
        there = tool(speed * number / CONTROL_HZ, 0, 0)
        lags.append(length(there.translation - smooth(there).translation))
    assert max(lags) < 0.02
    for _ in range(60):
        found = smooth(there)
    assert max(found.distance(there)) < 1e-5


def test_it_turns_the_short_way_round() -> None:
    smooth = OneEuro()
    for number in range(240):
        pose = SE3.about((0, 0, 1), 2 * math.pi * number / 120)
        assert smooth(pose).distance(pose)[1] < 0.2


def test_a_tool_is_led_no_further_than_reach_box_and_leash_allow() -> None:
    rng = np.random.default_rng(1)
    for side in SIDES:
        for _ in range(50):
            wanted = tool(*rng.uniform([-1, -2, -1], [2, 2, 2]))
            shaped = Shaper(side, ROBOT)(wanted, wanted)
            wrist = (shaped.pose @ ROBOT.link7_from_tcp.inverse()).translation
            assert length(wrist - ROBOT.shoulders[side]) <= REACH + 1e-9
            assert shaped.is_limited == (length(shaped.pose.translation - wanted.translation) > 0)
            assert max(inverse.within_reach(ROBOT, side, shaped.pose).distance(shaped.pose)) < 1e-9
    here = tool(0.5, 0.2, 0.3)
    assert not Shaper(Side.LEFT, ROBOT)(here, here).is_limited
    pressed = Shaper(Side.LEFT, ROBOT)(here, here.moved(z=0.25))
    assert pressed.is_limited
    assert math.isclose(pressed.pose.translation[2], 0.55 - LEASH)
    deep = Shaper(Side.LEFT, ROBOT)(here.moved(z=-0.35), here.moved(z=-0.29))
    assert (deep.is_limited, deep.pose.translation[2]) == (True, BOX[0, 2])
