"""Tasks of two hands by one gamepad: programs push sticks and buttons. In lockstep; see `leading`.

`GamepadOperator` is privileged: it is told where tools and objects are, which a person has to see.
It moves each hand by a stick of its own, and shows that the sticks suffice.

`PadOperator` gets pictures of the page and its words, and of a task what a person is told: sizes of
board and cells, or of pot and stove, how high and how far apart they are to be grasped, that hands
lean at the start and how high they are, how a ball rolls, and where the view from above looks from.
With `--log-cli-level=INFO` it says what it sees.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from duobench.core.spatial import SE3, length, product, rotation_vector
from duobench.core.types import SIDES, Array, Side
from duobench.data import DataSet, find_problems
from duobench.envs.sim_env import sim_of
from duobench.tasks.experts.motion import down
from duobench.teleop.teleop_page import LEADING_VIEW
from duobench.teleop.teleoperation import TeleopState
from duobench.web.shading import as_camera
from duobench.world.objects.pot import HANDLE_OFFSET, HANDLE_Z, HEIGHT, PLATE
from tests.pages import pad_operator
from tests.pages.leading import Led, follower, led
from tests.pages.pad_operator import MazePlayer, PadOperator
from tests.pages.test_driving import PAD

LOG = logging.getLogger(__name__)
WINDOW = {"width": 900, "height": 600}
WIDE = {"width": 1240, "height": 780}
CLOCK = """{
  const clock = performance.now.bind(performance);
  let [before, shown] = [clock(), clock()];
  performance.now = () => {
    const next = clock();
    shown += Math.min(next - before, 16);
    before = next;
    return shown;
  };
}"""
"""A page's clock on a busy machine: its time stands still while the page does."""
DEAD = 0.15
"""What a stick at rest may show."""
SPEED, TURN = 0.25, 1.0
"""Metres and radians a second of a stick at its end, as the docs say."""
GAIN = 3.0
"""Speed by what is left to go, in 1/s."""
NEAR, NEAR_TURN = 0.002, 0.015
COARSE = 0.006
REACHED = 0.001
"""Metres or radians at which the sticks are let go."""
LOOK_MS = 20
"""Milliseconds from one look at what the sticks did to the next."""
SETTLED = 12
MOST_LOOKS = 2000
MOST_TRIES = 12
A, B = 0, 1
BUMPERS = {Side.LEFT: 4, Side.RIGHT: 5}
TRIGGERS = {Side.LEFT: 6, Side.RIGHT: 7}
OPENING = 0.45
"""Opening on the way down to a handle."""


def stick(speed: float, most: float) -> float:
    """How far a stick is pushed for a speed."""
    share = min(1.0, abs(speed) / most)
    return math.copysign(DEAD + (1.0 - DEAD) * share, speed) if share > 0.0 else 0.0


class GamepadOperator:
    """Leads tools by sticks, from the page of a session."""

    def __init__(self, one: Led) -> None:
        self._led = one
        env = sim_of(one.session.env)
        self.simulation = env.simulation
        self._backend = env.backend
        camera = as_camera(LEADING_VIEW)
        eye, target = (np.array(camera[name]) for name in ("eye", "target"))
        self._forward = (target - eye) / length(target - eye)
        across = np.cross(self._forward, (0.0, 0.0, 1.0))
        self._right = across / length(across)
        self._up = np.cross(self._right, self._forward)
        self._across = self._right[:2]
        away = (self._forward + self._up)[:2]
        self._away = away / length(away)

    def tool(self, side: Side) -> SE3:
        """Where a tool is."""
        return SE3.from_tquat(self._backend.read().tcp_poses[side.index])

    def choose(self, *sides: Side) -> None:
        """Press the bumpers of one arm, or those of both at once."""
        for pressed in (1, 0):
            for side in sides:
                self._push(BUMPERS[side], pressed)
                self._led.follow()

    def grip(self, opening: float, *sides: Side) -> None:
        """Press triggers."""
        for side in sides:
            self._push(TRIGGERS[side], 1.0 - opening)
        self._led.follow(30)

    def lead(self, side: Side, goal: SE3, near: float = NEAR) -> None:
        """Bring one tool to a pose with both sticks: turn it with A held, then move it."""

        def turn() -> dict[Side, Array]:
            left = rotation_vector(product(goal.rotation, self.tool(side).rotation.T))
            return {side: left} if length(left) > NEAR_TURN else {}

        def move() -> dict[Side, Array]:
            left = goal.translation - self.tool(side).translation
            return {side: left} if length(left) > near else {}

        self.choose(side)
        self._push_until(turn, self._turning, A, turns=True)
        self._push_until(move, self._moving)

    def lead_both(self, goals: Mapping[Side, SE3], near: float = NEAR) -> None:
        """Bring both tools to places, each by its stick: along the table, then up or down."""

        def left(parts: Array) -> dict[Side, Array]:
            shifts = {
                side: parts * (goals[side].translation - self.tool(side).translation)
                for side in SIDES
            }
            return shifts if max(map(length, shifts.values())) > near else {}

        def slide(shifts: dict[Side, Array]) -> list[float]:
            return [value for side in SIDES for value in self._moving({side: shifts[side]})[:2]]

        def lift(shifts: dict[Side, Array]) -> list[float]:
            ups = [self._moving({side: shifts[side]})[3] for side in SIDES]
            return [0.0, ups[0], 0.0, ups[1]]

        self.choose(*SIDES)
        self._push_until(lambda: left(np.array([1.0, 1.0, 0.0])), slide)
        self._push_until(lambda: left(np.array([0.0, 0.0, 1.0])), lift, A)

    def carry(self, left: Callable[[], Array], near: float = NEAR) -> None:
        """Move both tools as one thing, with B held, until nothing is left to go."""

        def shifts() -> dict[Side, Array]:
            shift = left()
            return dict.fromkeys(SIDES, shift) if length(shift) > near else {}

        self.choose(*SIDES)
        self._push_until(shifts, self._moving, B)

    def _push_until(
        self,
        left: Callable[[], dict[Side, Array]],
        axes: Callable[[dict[Side, Array]], list[float]],
        button: int | None = None,
        *,
        turns: bool = False,
    ) -> None:
        """Push the sticks until nothing is left to go for the tools, with a button held.

        What the sticks did so far is seen in what the page sent; the arms follow later.
        """
        for _ in range(MOST_TRIES):
            wanted = left()
            if not wanted:
                return
            if button is not None:
                self._push(button, 1)
            start = self._hands()
            for _ in range(MOST_LOOKS):
                self._led.page.wait_for_timeout(LOOK_MS)
                to_go = {
                    side: self._to_go(side, start[side], shift, turns=turns)
                    for side, shift in wanted.items()
                }
                if max(map(length, to_go.values())) < REACHED:
                    break
                self._tilt(axes(to_go))
            self._tilt([0.0] * 4)
            if button is not None:
                self._push(button, 0)
            self._led.follow(SETTLED)
        raise AssertionError(f"The sticks do not bring {wanted} there.")

    def _hands(self) -> dict[Side, SE3]:
        sample = self._led.samples[-1]
        poses = {side: sample[str(side)]["pose"] for side in SIDES}
        return {side: SE3.from_wxyz(pose[3:], pose[:3]) for side, pose in poses.items()}

    def _to_go(self, side: Side, start: SE3, wanted: Array, *, turns: bool) -> Array:
        now = self._hands()[side]
        if not turns:
            return wanted - (now.translation - start.translation)
        done = product(now.rotation, start.rotation.T)
        return rotation_vector(product(SE3.about(wanted, length(wanted)).rotation, done.T))

    def _moving(self, shifts: dict[Side, Array]) -> list[float]:
        shift = next(iter(shifts.values()))
        across, away = (float(shift[:2] @ axis) for axis in (self._across, self._away))
        return [stick(GAIN * value, SPEED) for value in (across, -away, 0.0, -float(shift[2]))]

    def _turning(self, turns: dict[Side, Array]) -> list[float]:
        (left,) = turns.values()
        speeds = [GAIN * float(left @ axis) for axis in (self._up, self._right, self._forward)]
        slower = min(1.0, TURN / max(map(abs, speeds)))  # by the shortest way
        speeds = [slower * speed for speed in speeds]
        return [*(stick(value, TURN) for value in speeds), 0.0]

    def _tilt(self, axes: list[float]) -> None:
        self._led.page.evaluate(f"pad.axes = {axes}")

    def _push(self, button: int, value: float) -> None:
        self._led.page.evaluate(f"push({button}, {value})")


def carry_pot(operator: GamepadOperator) -> None:
    """Take both handles, lift, carry and put down, as its expert does."""
    sim = operator.simulation

    def grasps() -> dict[Side, SE3]:
        pot = sim.pose("pot")
        places = {side: pot.apply((0.0, side.sign * HANDLE_OFFSET, HANDLE_Z)) for side in SIDES}
        return {side: down(*place, yaw=pot.yaw) for side, place in places.items()}

    def left_to(x: float, y: float, z: float) -> Callable[[], Array]:
        return lambda: np.array([x, y, z]) - sim.pose("pot").translation

    operator.grip(OPENING, *SIDES)
    for side in SIDES:
        operator.lead(side, grasps()[side].moved(z=0.10), COARSE)
    operator.lead_both(grasps(), NEAR)
    operator.grip(0.0, *SIDES)
    x, y, z = sim.pose("pot").translation
    operator.carry(left_to(x, y, z + 0.08), COARSE)
    x, y, _ = sim.position("stove")
    operator.carry(left_to(x, y, z + 0.08), COARSE)
    operator.carry(left_to(x, y, PLATE[2] + HEIGHT / 2))
    operator.grip(OPENING, *SIDES)


@pytest.mark.long
def test_a_pot_is_carried_by_a_gamepad(tmp_path: Path) -> None:
    """Privileged: who leads is told where tools, pot and stove are."""
    with led(tmp_path, "carry_pot", follower("gamepad"), WINDOW, CLOCK, PAD) as one:
        carry_pot(GamepadOperator(one))
        while one.session.state is not TeleopState.DECIDE:
            one.turn()
        one.page.evaluate("push(9, 1)")
        while one.session.state is not TeleopState.OVER:
            one.turn()
    check(tmp_path)


def check(folder: Path) -> None:
    """An episode was led by both hands at a time, to the last stage."""
    data = DataSet.open(folder)
    (recording,) = data.recordings()
    outcome = recording.info.outcome
    assert outcome is not None
    assert outcome.success
    assert "gamepad" in recording.info.actor.device
    assert recording.clutch.all(axis=1).any()  # both hands at a time
    assert not find_problems(data)


def led_by_sight(folder: Path, task: str, play: Callable[[PadOperator], None]) -> None:
    """Lead an episode by what the page shows, keep it, and check it."""
    with led(folder, task, follower("gamepad"), WIDE, pad_operator.CLOCK, PAD) as one:
        operator = PadOperator(one)
        operator.log = LOG.info
        play(operator)
        LOG.info("%d s led", operator.led_s)
        assert operator.keep(), operator.next
    check(folder)


@pytest.mark.long
def test_a_pot_is_carried_by_what_the_page_shows(tmp_path: Path) -> None:
    led_by_sight(tmp_path, "carry_pot", pad_operator.carry_pot)


@pytest.mark.long
def test_a_ball_is_led_through_its_maze_by_what_the_page_shows(tmp_path: Path) -> None:
    led_by_sight(tmp_path, "ball_maze", lambda operator: MazePlayer(operator).play())
