"""Leader arms as the device: their joints are those of the robot."""

import math
from typing import Protocol

import numpy as np

from duobench.core.errors import LeaderError
from duobench.core.types import (
    CONTROL_HZ,
    OPENING_SLOTS,
    SIDES,
    Array,
    DuoCommand,
    DuoState,
)
from duobench.envs.action_modes import JOINT
from duobench.envs.spaces import JOINT_NAMES
from duobench.teleop.intent import Intent
from duobench.teleop.messages import Message
from duobench.teleop.pace import Movement
from duobench.world.robot.frames import ROBOT, Robot

ALIGNED = 0.35
"""Largest distance in radians of a leader's joint from the robot's for an episode to begin."""
BEGUN = 0.05
"""Movement of any joint, in radians, that begins the episode."""
OPEN = 0.5
"""Opening from which on a gripper is open enough for an episode to begin."""
FADE_STEPS = round(CONTROL_HZ)
"""Control steps in which what is left between leader and robot is closed."""
_JOINTS = np.delete(np.arange(len(JOINT_NAMES)), OPENING_SLOTS)
TURNED, MOVED = 0.01, 0.001
"""Change of a joint in radians, or of a tool's place in metres, from which on leaders lead."""
_NOISE = [TURNED] * len(_JOINTS) + [MOVED] * 3 * len(SIDES)


class JointSource(Protocol):
    """Two leader arms."""

    device: str
    """Name in recordings."""

    def connect(self) -> None:
        """Begin to read them.

        Raises:
            LeaderError: They cannot be reached, or do not give what two arms of ours need.
        """

    def read(self) -> Array | None:
        """Read joints in radians and openings (16,), in the order of a command.

        None where there are no numbers that are younger than a quarter of a second.
        """

    def close(self) -> None:
        """Let go of them; closing twice is harmless."""


class LeaderDevice:
    """Leader arms that the robot follows joint by joint.

    An episode begins where the leaders are brought near to the robot with open grippers, and then
    moved. What is left between them is closed within a second; the same is done when leaders that
    did not answer come back, or that rested move again.
    """

    action_mode = JOINT.name

    def __init__(self, source: JointSource, robot: Robot = ROBOT) -> None:
        self._source, self._robot = source, robot
        self._where = np.zeros(len(JOINT_NAMES))
        self._armed: Array | None = None
        self._offset = np.zeros(len(JOINT_NAMES))
        self._fade = 0
        self._is_following = self._is_leading = False
        self._movement = Movement(_NOISE)
        self.was_lost = False
        """Never: leaders are not let go of."""
        self.dropped = 0
        """Control steps in which the leaders gave nothing new."""
        self.sampled_s: float | None = None
        """Time at which they were read last, in seconds."""
        self.led_by = source.device
        self.executed_ms = math.nan
        """Never known: no page has sent what they do."""

    @property
    def clutch(self) -> tuple[bool, bool]:
        """Whether both arms follow; they do so together."""
        return self._is_following, self._is_following

    def begin(self, command: DuoCommand) -> None:
        """A new episode waits until the leaders are where the robot is."""
        self._where = command.flat
        self._armed = None
        self._is_following = self._is_leading = False

    def follow(self, command: DuoCommand) -> None:  # noqa: ARG002
        """Reject that something else leads: leaders lead as long as they answer."""
        raise LeaderError(
            "Leader arms cannot be let go of, so that a policy never gets to lead; correct it with "
            "the hands of a page."
        )

    def let_go(self) -> None:
        """Leaders lead as long as they answer; what is between them and the arms fades again."""
        self._is_following = False

    def take(self, message: Message, arrival_s: float) -> None:
        """Hands on a page move nothing while leader arms lead."""

    def lose(self) -> None:
        """The page has gone; leader arms go on without it."""

    def is_away(self, now_s: float) -> bool:  # noqa: ARG002
        """Never: where leaders do not answer, the robot stays where it is."""
        return False

    def is_squeezed_anew(self, now_s: float) -> bool:  # noqa: ARG002
        """Never: leader arms have no clutch to let go of."""
        return False

    def prompt(self, now_s: float) -> str | None:
        """Return what to do before the episode: bring the leaders to the robot, and move them."""
        sample = self._read(now_s)
        if sample is None:
            return "The leader arms do not answer."
        if (sample[list(OPENING_SLOTS)] < OPEN).any():
            self._armed = None
            return "Open both grippers."
        away = np.abs(sample - self._where)[_JOINTS]
        worst = int(away.argmax())
        if self._armed is None:
            if away[worst] > ALIGNED:
                name = JOINT_NAMES[_JOINTS[worst]]
                return f"Bring the leaders to the robot: {name} is {away[worst]:.2f} rad away."
            self._armed = sample
        if np.abs(sample - self._armed)[_JOINTS].max() < BEGUN:
            return "Move a leader to begin."
        return None

    def intend(
        self,
        now_s: float,
        state: DuoState,  # noqa: ARG002 - the protocol's signature
        command: DuoCommand,
    ) -> Intent:
        """The leaders' joints; where they do not answer, the robot stays."""
        sample = self._read(now_s)
        if sample is None:
            self._is_following = self._is_leading = False
            return Intent(
                action=command.flat,
                clutch=(False, False),
                leads=False,
            )
        joints = sample[_JOINTS]
        places = self._robot.tcp_poses(joints)[:, :3].ravel()
        has_moved = self._movement.sees(np.concatenate([joints, places]))
        leads = has_moved or not self._is_following or self._fade > 0
        if leads and not self._is_leading:
            self._fade = FADE_STEPS
            self._offset = command.flat - sample
        self._is_following, self._is_leading = True, leads
        self._fade = max(0, self._fade - 1)
        action = sample + (self._fade / FADE_STEPS) * self._offset
        action[list(OPENING_SLOTS)] = np.clip(action[list(OPENING_SLOTS)], 0.0, 1.0)
        return Intent(
            action=action,
            clutch=(True, True),
            leads=leads,
        )

    def _read(self, now_s: float) -> Array | None:
        sample = self._source.read()
        if sample is None:
            self.dropped += 1
        else:
            self.sampled_s = now_s
        return sample
