"""Hands as the device: samples become tool poses, and buttons presses."""

from __future__ import annotations

from typing import cast

import numpy as np

from duobench.envs.action_modes import CARTESIAN
from duobench.kinematics.inverse import Kinematics
from duobench.spatial import SE3
from duobench.teleop.clutch import OPENS, Clutch
from duobench.teleop.freshness import MAX_AGE_S, Freshness
from duobench.teleop.intent import Intent
from duobench.teleop.messages import Hand, Hands, Message, Recentre
from duobench.teleop.shaping import Shaper
from duobench.types import SIDES, DuoCommand, DuoState, Side

OPEN_TRIGGER = 0.5
"""A trigger below this is open enough for an episode to begin."""
AWAY_S = 1.0
"""Seconds without a fresh sample after which the operator is taken to be away."""
MEANT = 0.05
"""Change of a trigger from which on its gripper follows it."""
KEEP, DISCARD = "keep", "discard"
"""Buttons that decide about an episode."""


class TriggeredGripper:
    """A gripper that follows a trigger.

    When a trigger comes into view, it first says nothing: a held object must not fall because a
    controller was picked up with its trigger released. From its first movement on it is followed.
    """

    def __init__(self, opening: float = 1.0) -> None:
        self.opening = opening
        """0 closed to 1 open."""
        self._seen: float | None = None
        self._is_followed = False

    def lose(self) -> None:
        """The trigger is out of view; the gripper stays as it is."""
        self._seen, self._is_followed = None, False

    def follow(self, trigger: float) -> None:
        """Take over what the trigger says, once it was moved."""
        if self._seen is None:
            self._seen = trigger
        self._is_followed = self._is_followed or abs(trigger - self._seen) > MEANT
        if self._is_followed:
            self.opening = 1.0 - trigger


class LedArm:
    """One hand and the arm that it leads."""

    def __init__(self, side: Side) -> None:
        self.clutch = Clutch()
        self.gripper = TriggeredGripper()
        self._shaper = Shaper(side)
        self._rest: SE3 | None = None

    def begin(self, opening: float) -> None:
        """A new episode waits, with the gripper at an opening."""
        self.clutch.open()
        self.gripper = TriggeredGripper(opening)
        self._rest = None

    def lead(self, hand: Hand | None, measured: SE3, commanded: SE3) -> tuple[SE3, bool]:
        """Where the tool is led, and whether it was kept from where the hand wants it.

        Args:
            hand: The hand; None where it is lost.
            measured: Where the tool is, in the table frame.
            commanded: Where it was commanded to be last.
        """
        if hand is None or not hand.sure:
            self.gripper.lose()
        else:
            self.gripper.follow(hand.trigger)
        was_closed = self.clutch.is_closed
        wanted = self.clutch.follow(hand, commanded)
        if wanted is None:
            if self._rest is None:
                self._rest = commanded  # the arm stops where it is, not where it was going
            return self._rest, False
        self._rest = None
        if not was_closed:
            self._shaper.reset()
        shaped = self._shaper(wanted, measured)
        return shaped.pose, shaped.is_limited


class HandDevice:
    """Both hands, from a mouse, keys, a gamepad or a headset: they all speak one message.

    Args:
        lockstep: Whether simulated time waits for every sample, so that none is ever late.
    """

    action_mode = CARTESIAN.name

    def __init__(self, *, lockstep: bool = False) -> None:
        self._lockstep = lockstep
        self._kinematics = Kinematics()
        self._arms = {side: LedArm(side) for side in SIDES}
        self._freshness = Freshness()
        self._dropped = 0
        self._hands: Hands | None = None
        self.sampled_s: float | None = None
        """When the newest sample arrived, in seconds."""
        self._has_seen_open = False

    @property
    def clutch(self) -> tuple[bool, bool]:
        """Whether the left and the right hand lead their arm."""
        left, right = (self._arms[side].clutch.is_closed for side in SIDES)
        return left, right

    @property
    def dropped(self) -> int:
        """Samples that arrived too late."""
        return self._dropped + self._freshness.dropped

    def begin(self, command: DuoCommand) -> None:
        """A new episode waits: both hands have to be open first."""
        for side, arm in self._arms.items():
            arm.begin(float(command.openings[side.index]))
        self._has_seen_open = False

    def take(self, message: Message, arrival_s: float) -> None:
        """Take over a fresh sample; `recentre` lets both hands go."""
        if isinstance(message, Recentre):
            self._let_go()
        elif isinstance(message, Hands) and self._is_fresh(message, arrival_s):
            hands = (message.left, message.right)
            is_moving = any(hand is not None and hand.buttons.recentre for hand in hands)
            if is_moving or self.is_lost(arrival_s):
                self._let_go()
            self._hands, self.sampled_s = message, arrival_s

    def lose(self) -> None:
        """The operator has gone; the next one has another clock."""
        self._dropped += self._freshness.dropped
        self._freshness = Freshness()
        self._hands = self.sampled_s = None
        self._let_go()

    def is_lost(self, now_s: float) -> bool:
        """Whether nothing fresh was heard for too long."""
        if self.sampled_s is None:
            return True
        return not self._lockstep and now_s - self.sampled_s > MAX_AGE_S

    def is_away(self, now_s: float) -> bool:
        """Whether the operator has gone, or nothing fresh was heard of one for `AWAY_S`."""
        if self.sampled_s is None:
            return True
        return not self._lockstep and now_s - self.sampled_s > AWAY_S

    def prompt(self, now_s: float) -> str | None:
        """What to do before the episode begins: open both hands, then squeeze one."""
        hands = self._now(now_s)
        present = [hand for hand in hands.values() if hand is not None and hand.sure]
        if not present:
            return "Waiting for the operator's hands."
        if all(hand.squeeze < OPENS and hand.trigger < OPEN_TRIGGER for hand in present):
            self._has_seen_open = True
        for side, hand in hands.items():
            if hand is not None and hand.sure:
                self._arms[side].gripper.follow(hand.trigger)
        if not self._has_seen_open:
            return "Open both hands: release the clutches and the grippers."
        squeezes = [self._arms[side].clutch.wants(hand) for side, hand in hands.items()]
        return None if any(squeezes) else "Squeeze a clutch to begin."

    def intend(self, now_s: float, state: DuoState, command: DuoCommand) -> Intent:
        """Where the hands lead the tools."""
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
        )

    def _is_fresh(self, message: Hands, arrival_s: float) -> bool:
        return self._lockstep or self._freshness.accepts(message.sent, arrival_s)

    def _let_go(self) -> None:
        for arm in self._arms.values():
            arm.clutch.open()

    def _now(self, now_s: float) -> dict[Side, Hand | None]:
        if self._hands is None or self.is_lost(now_s):
            return dict.fromkeys(SIDES)
        return {Side.LEFT: self._hands.left, Side.RIGHT: self._hands.right}


class ButtonPresses:
    """Tells a press from holding on. A button that is held at first counts after a release."""

    def __init__(self) -> None:
        self._was_pressed = {KEEP: True, DISCARD: True}

    def new(self, hands: Hands) -> list[str]:
        """The buttons that were not pressed in the message before, keep first."""
        present = [hand.buttons for hand in (hands.left, hands.right) if hand is not None]
        pressed = {
            name: any(getattr(buttons, name) for buttons in present) for name in self._was_pressed
        }
        found = [name for name, is_so in pressed.items() if is_so and not self._was_pressed[name]]
        self._was_pressed = pressed
        return found
