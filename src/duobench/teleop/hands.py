"""Hands as the device: samples become tool poses, and buttons presses."""

import math
from typing import cast, get_args

import numpy as np

from duobench.core.spatial import SE3, product
from duobench.core.types import (
    SIDES,
    DuoCommand,
    DuoState,
    Side,
)
from duobench.envs.action_modes import CARTESIAN
from duobench.teleop.intent import Intent
from duobench.teleop.messages import (
    Hand,
    Hands,
    Message,
    Operator,
    PageDevice,
    Recentre,
)
from duobench.teleop.shaping import Shaper
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.robot.frames import ROBOT, Robot

MAX_AGE_S = 0.250
"""Samples that were delayed by more than this, in seconds, are dropped; and a hand of which nothing
was heard for as long is lost."""
WINDOW_S = 30.0
"""The smallest delay is that of the last one to two windows, in seconds: two clocks drift apart by
some milliseconds a minute, and one may have stood still."""
CLOSES, OPENS = 0.5, 0.3
"""Squeeze from which the clutch closes, and below which it opens."""
OPEN_TRIGGER = 0.5
"""A trigger below this is open enough for an episode to begin."""
AWAY_S = 1.0
"""Seconds without a fresh sample after which the operator is taken to be away."""
MEANT = 0.05
"""Change of a trigger from which on its gripper follows it."""
KEEP, DISCARD, RESTORE = "keep", "discard", "restore"
"""Buttons that decide about an episode."""


class Freshness:
    """Judges the samples of one connection by the clock of who sends them.

    When a page or a network stalls, the samples of the stall arrive together afterwards. By their
    time of arrival all of them are fresh; by the sender's clock most are not. The two clocks begin
    anywhere, so the smallest delay of the last while stands for no delay at all.
    """

    def __init__(self) -> None:
        self.dropped = 0
        """Samples that were not fresh."""
        self._window_end = -math.inf
        self._least = self._least_before = math.inf
        self._newest = -math.inf

    def accepts(self, sent_ms: float, arrival_s: float) -> bool:
        """Whether a sample is fresh when it arrives, and newer than all before it.

        Args:
            sent_ms: When it was sent, in ms of the sender's clock.
            arrival_s: When it arrived, in seconds of our clock.
        """
        delay = arrival_s - sent_ms / 1000.0
        if arrival_s >= self._window_end:
            self._least_before = (
                self._least if math.isfinite(self._window_end) else math.inf
            )
            self._least, self._window_end = math.inf, arrival_s + WINDOW_S
        self._least = min(self._least, delay)
        is_late = delay - min(self._least, self._least_before) > MAX_AGE_S
        if is_late or sent_ms <= self._newest:
            self.dropped += 1
            return False
        self._newest = sent_ms
        return True


class Clutch:
    """One hand's hold on one tool, which is also the dead man's switch.

    It closes on a squeeze that follows a release, so a hand that comes into view squeezed, or comes
    back after it was lost, moves nothing. Where it closes, the poses of hand and tool are noted;
    from there the tool moves by the same displacement, along the axes of the room, and turns by the
    same rotation about them, however the hand was held.
    """

    def __init__(self) -> None:
        self._is_armed = False
        self._squeezed: SE3 | None = None  # the hand, where it was squeezed
        self._anchor: tuple[SE3, SE3] | None = None
        self.was_lost = False
        """Whether it opened by itself when it was closed last, and not by a release."""

    @property
    def is_closed(self) -> bool:
        """Whether the hand leads the tool."""
        return self._anchor is not None

    def open(self) -> None:
        """Let go; it takes a release and a new squeeze to close again."""
        self.was_lost |= self.is_closed
        self._is_armed, self._squeezed, self._anchor = False, None, None

    def notice(self, hand: Hand | None) -> None:
        """Notice a release or a squeeze, also one between two control steps."""
        if hand is None or not hand.sure:
            return
        if hand.squeeze < OPENS:
            self._is_armed, self._squeezed = True, None
        elif self._is_armed and self._squeezed is None and hand.squeeze >= CLOSES:
            self._squeezed = hand.world_from_hand

    def wants(self, hand: Hand | None) -> bool:
        """Whether a hand, None if lost, keeps the clutch closed or would close it.

        A release arms it.
        """
        if hand is None or not hand.sure:
            self.open()
            return False
        if hand.squeeze < OPENS:
            self._is_armed, self._anchor = True, None
        return self.is_closed or (self._is_armed and hand.squeeze >= CLOSES)

    def follow(self, hand: Hand | None, tool: SE3) -> SE3 | None:
        """Return the pose that a hand, None if lost, leads a tool to from its last command.

        Both poses are in the table frame; no target while the clutch is open.
        """
        if not self.wants(hand) or hand is None:
            return None
        now = hand.world_from_hand
        if self._anchor is None:
            self._anchor, self.was_lost = (self._squeezed or now, tool), False
        hand_then, tool_then = self._anchor
        shift = now.translation - hand_then.translation
        turn = product(now.rotation, hand_then.rotation.T)
        return SE3(product(turn, tool_then.rotation), tool_then.translation + shift)


class TriggeredGripper:
    """A gripper that follows a trigger.

    When a trigger comes into view, it first says nothing: a held object must not fall because a
    controller was picked up with its trigger released. From its first movement on it is followed.

    Args:
        opening: Opening at first, 0 closed to 1 open.
        meets: Whether a trigger is followed only from where it says what the opening is, or passes
            that: so a gripper that another has led does not jump.
    """

    def __init__(
        self,
        opening: float = 1.0,
        *,
        meets: bool = False,
    ) -> None:
        self.opening = opening
        """0 closed to 1 open."""
        self._meets = meets
        self._seen: float | None = None
        self._is_followed = False

    def lose(self) -> None:
        """The trigger is out of view; the gripper does not move."""
        self._seen, self._is_followed = None, False

    def follow(self, trigger: float) -> None:
        """Take over what the trigger says, once it was moved."""
        if self._seen is None:
            self._seen = trigger
        is_moved = abs(trigger - self._seen) > MEANT
        if self._meets:
            low, high = sorted((self._seen, trigger))
            is_moved = low - MEANT <= 1.0 - self.opening <= high + MEANT
        self._is_followed = self._is_followed or is_moved
        if self._is_followed:
            self.opening = 1.0 - trigger


class LedArm:
    """One hand and the arm that it leads."""

    def __init__(self, side: Side, robot: Robot) -> None:
        self.clutch = Clutch()
        self.gripper = TriggeredGripper()
        self._shaper = Shaper(side, robot)
        self._rest: SE3 | None = None

    def begin(self, opening: float) -> None:
        """A new episode waits, with the gripper at an opening."""
        self.clutch.open()
        self.gripper = TriggeredGripper(opening)
        self._rest = None

    def follow(self, opening: float) -> None:
        """Something else leads the arm, and has its gripper at an opening."""
        self.gripper = TriggeredGripper(opening, meets=True)
        self.clutch.was_lost = False
        self._rest = None

    def lead(
        self, hand: Hand | None, measured: SE3, commanded: SE3
    ) -> tuple[SE3, bool]:
        """Return the pose that the tool is led to, and whether that is not where the hand wants it.

        A hand that is lost is None; the tool is measured and commanded in the table frame.
        """
        if hand is None or not hand.sure:
            self.gripper.lose()
        else:
            self.gripper.follow(hand.trigger)
        was_closed = self.clutch.is_closed
        wanted = self.clutch.follow(hand, commanded)
        if wanted is None:
            if self._rest is None:
                self._rest = (
                    commanded  # the arm stops where it is, not where it was going
                )
            return self._rest, False
        self._rest = None
        if not was_closed:
            self._shaper.reset()
            self._shaper(commanded, measured)  # what the hand did since is no jump
        shaped = self._shaper(wanted, measured)
        return shaped.pose, shaped.is_limited


class HandDevice:
    """Both hands, from a mouse, keys, a gamepad or a headset: they all speak one message.

    In lockstep simulated time waits for every sample, so that none is ever late.
    """

    action_mode = CARTESIAN.name

    def __init__(self, *, lockstep: bool = False, robot: Robot = ROBOT) -> None:
        self._lockstep = lockstep
        self._kinematics = Kinematics(robot)
        self._arms = {side: LedArm(side, robot) for side in SIDES}
        self._freshness = Freshness()
        self._dropped = 0
        self._hands: Hands | None = None
        self.sampled_s: float | None = None
        """Time at which the newest sample arrived, in seconds."""
        self._has_seen_open = False
        self._acting = set[str]()
        """Devices that have led since the last step."""
        self._led = set[str]()
        """Devices that have led since the first one."""
        self.led_by = ""
        self.executed_ms = math.nan

    @property
    def clutch(self) -> tuple[bool, bool]:
        """Whether the left and the right hand lead their arm."""
        left, right = (self._arms[side].clutch.is_closed for side in SIDES)
        return left, right

    @property
    def was_lost(self) -> bool:
        """Whether a hand was lost, rather than opened, when it last let go."""
        return any(arm.clutch.was_lost for arm in self._arms.values())

    @property
    def dropped(self) -> int:
        """Samples that arrived too late."""
        return self._dropped + self._freshness.dropped

    def begin(self, command: DuoCommand) -> None:
        """A new episode waits: both hands have to be open first."""
        for side, arm in self._arms.items():
            arm.begin(float(command.openings[side.index]))
        self._has_seen_open, self._led = False, set()
        self.led_by, self.executed_ms = "", math.nan

    def follow(self, command: DuoCommand) -> None:
        """Something else leads: hands that take over begin where the arms are commanded to be."""
        for side, arm in self._arms.items():
            arm.follow(float(command.openings[side.index]))

    def let_go(self) -> None:
        """Both hands let go: it takes a release and a new squeeze to lead."""
        for arm in self._arms.values():
            arm.clutch.open()

    def take(self, message: Message, arrival_s: float) -> None:
        """Take over a fresh sample; `recentre` lets both hands go.

        Devices of another operator have not led yet.
        """
        if isinstance(message, Operator):
            self._led = set()
        elif isinstance(message, Recentre):
            self.let_go()
        elif isinstance(message, Hands) and (
            self._lockstep or self._freshness.accepts(message.sent, arrival_s)
        ):
            hands = (message.left, message.right)
            is_moving = any(
                hand is not None and hand.buttons.recentre for hand in hands
            )
            if is_moving or self.is_lost(arrival_s):
                self.let_go()
            self._hands, self.sampled_s = message, arrival_s
            for side, hand in self._now(arrival_s).items():
                self._arms[side].clutch.notice(hand)
            if self._has_seen_open:
                self._acting.update(message.devices)

    def lose(self) -> None:
        """The operator has gone; the next one has another clock."""
        self._dropped += self._freshness.dropped
        self._freshness = Freshness()
        self._hands = self.sampled_s = None
        self.executed_ms = math.nan
        self._acting.clear()
        for arm in self._arms.values():
            arm.gripper.lose()
        self.let_go()

    def is_lost(self, now_s: float, for_s: float = MAX_AGE_S) -> bool:
        """Whether nothing fresh was heard for `MAX_AGE_S`, or another time."""
        if self.sampled_s is None:
            return True
        return not self._lockstep and now_s - self.sampled_s > for_s

    def is_away(self, now_s: float) -> bool:
        """Whether the operator has gone, or nothing fresh was heard of one for `AWAY_S`."""
        return self.is_lost(now_s, AWAY_S)

    def is_squeezed_anew(self, now_s: float) -> bool:
        """Whether a hand that was open since both let go is squeezed."""
        hands = self._now(now_s)
        left, right = (self._arms[side].clutch.wants(hands[side]) for side in SIDES)
        return left or right

    def prompt(self, now_s: float) -> str | None:
        """Return what to do before the episode begins: open both hands, then squeeze one."""
        hands = self._now(now_s)
        present = [hand for hand in hands.values() if hand is not None and hand.sure]
        if not present:
            return "Waiting for the operator's hands."
        if all(
            hand.squeeze < OPENS and hand.trigger < OPEN_TRIGGER for hand in present
        ):
            self._has_seen_open = True
        for side, hand in hands.items():
            if hand is not None and hand.sure:
                self._arms[side].gripper.follow(hand.trigger)
        if not self._has_seen_open:
            return "Open both hands: let go of the tools, and open the grippers."
        squeezes = [self._arms[side].clutch.wants(hand) for side, hand in hands.items()]
        if any(squeezes):
            return None
        self._acting.clear()
        return "Lead a tool to begin."

    def intend(
        self,
        now_s: float,
        state: DuoState,
        command: DuoCommand,
    ) -> Intent:
        """Return the poses that the hands lead the tools to."""
        self._led |= self._acting
        self._acting.clear()
        self.led_by = " and ".join(
            name for name in get_args(PageDevice) if name in self._led
        )
        if self._hands is not None:
            self.executed_ms = self._hands.sent
        hands, commanded = self._now(now_s), self._kinematics.forward(command.joints)
        rows, limited = [], []
        for side, arm in self._arms.items():
            measured = SE3.from_tquat(state.tcp_poses[side.index])
            pose, is_limited = arm.lead(hands[side], measured, commanded[side])
            rows.append(np.append(pose.tquat, arm.gripper.opening))
            limited.append(is_limited)
        return Intent(
            action=np.concatenate(rows),
            clutch=self.clutch,
            limited=cast("tuple[bool, bool]", tuple(limited)),
            leads=any(self.clutch),
        )

    def _now(self, now_s: float) -> dict[Side, Hand | None]:
        if self._hands is None or self.is_lost(now_s):
            return dict.fromkeys(SIDES)
        return {Side.LEFT: self._hands.left, Side.RIGHT: self._hands.right}


class ButtonPresses:
    """Tells a press from holding on. A button that is held at first counts after a release."""

    def __init__(self) -> None:
        self._was_pressed = {KEEP: True, DISCARD: True, RESTORE: True}

    def new(self, hands: Hands) -> list[str]:
        """The buttons that were not pressed in the message before, keep first."""
        present = [
            hand.buttons for hand in (hands.left, hands.right) if hand is not None
        ]
        pressed = {
            name: any(getattr(buttons, name) for buttons in present)
            for name in self._was_pressed
        }
        found = [
            name
            for name, is_so in pressed.items()
            if is_so and not self._was_pressed[name]
        ]
        self._was_pressed = pressed
        return found
