"""A whole task by mouse and keys alone: a program moves the pointer as a person would.

In lockstep, one control step for each message of the page; see `leading`.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from duobench.core.spatial import SE3
from duobench.data import DataSet, find_problems
from duobench.envs.sim_env import sim_of
from duobench.tasks.experts.handover import present, receive_pose, tool
from duobench.tasks.experts.motion import Arms, down, nearest_turn
from duobench.tasks.experts.scripts.transfer_cube import (
    BAR,
    MEETING_POINT,
    RECEIVER_GRIP,
    RISE,
    SLANT,
)
from duobench.teleop.teleoperation import TeleopState
from duobench.world.robot.frames import ROBOT
from tests.pages.leading import follower, led
from tests.pages.mouse_operator import MouseOperator

WINDOW = {"width": 1000, "height": 480}
ASIDE = tool((0.50, 0.30, 0.38), along=(0.0, -0.6, -1.0), camera=(0.0, 1.0, 0.0))
COARSE = 0.02
"""How near in metres is near enough on the way to somewhere else."""
OPEN, CLOSED = 1.0, 0.0


def hand_over(operator: MouseOperator, arms: Arms) -> None:
    """Do what the expert of transfer_cube does, one hand after the other, by what is seen."""
    giver, receiver = BAR.giver, BAR.giver.other
    operator.lead(receiver, ASIDE, COARSE)
    while not arms.grasps(giver, BAR.body):
        block = arms.sim.pose(BAR.body)
        x, y, _ = block.translation - ROBOT.shoulders[giver]
        outwards = math.atan2(y, x) + giver.sign * math.radians(15)
        yaw = nearest_turn(block.yaw, math.pi, outwards)
        x, y, _ = block.translation + BAR.grip * np.array([math.cos(yaw), math.sin(yaw), 0.0])
        grasp = down(x, y, BAR.height, yaw=yaw)
        operator.grip(giver, OPEN)
        operator.lead(giver, grasp.moved(z=0.10), 0.005)
        operator.lead(giver, grasp)
        operator.grip(giver, CLOSED)
        operator.lead(giver, grasp.moved(z=0.15), COARSE)
    operator.lead(giver, present(BAR, MEETING_POINT, RISE))
    clasp = receive_pose(arms, BAR, RECEIVER_GRIP, SLANT)
    operator.lead(receiver, clasp @ SE3.at(z=-0.10), 0.005)
    operator.lead(receiver, clasp)
    operator.grip(receiver, CLOSED)
    operator.grip(giver, OPEN)
    operator.lead(giver, operator.tool(giver) @ SE3.at(z=-0.12), COARSE)
    x, y, _ = arms.sim.position("bowl")
    goal = tool((x, y, 0.075), along=(0.0, -0.6, -1.0), camera=(0.0, 1.0, 0.0))
    operator.lead(receiver, goal.moved(z=0.10), 0.005)
    operator.lead(receiver, goal)
    operator.grip(receiver, OPEN)


def test_a_task_is_solved_by_mouse_and_keys(tmp_path: Path) -> None:
    actor = follower("mouse")
    with led(tmp_path, "transfer_cube", actor, WINDOW) as one:
        hand_over(MouseOperator(one), Arms(sim_of(one.session.env).simulation))
        while one.session.state is not TeleopState.DECIDE:
            one.turn()
        one.page.keyboard.press("Enter")
        while one.session.state is not TeleopState.OVER:
            one.turn()
    data = DataSet.open(tmp_path)
    (recording,) = data.recordings()
    outcome, info = recording.info.outcome, recording.info
    assert outcome is not None
    assert (outcome.success, outcome.kept, outcome.cut) == (True, True, False)
    assert (info.actor, info.task) == (actor, "transfer_cube")
    assert recording.stage.max() == 4
    assert not recording.clutch.all(axis=1).any()  # one hand at a time
    assert recording.clutch.any(axis=0).all()
    assert not find_problems(data)
