"""Hands that lead joints: what a page sends becomes the 16 numbers of two leader arms."""

from __future__ import annotations

import numpy as np

from duobench.core.errors import MessageError
from duobench.core.spatial import SE3
from duobench.core.types import ARM_JOINTS, SIDE_SIZE, SIDES, DuoCommand, DuoState
from duobench.teleop.hands import DISCARD, KEEP, RESTORE, ButtonPresses, HandDevice
from duobench.teleop.messages import (
    Discard,
    Hands,
    Inbox,
    Instruction,
    Keep,
    Message,
    Restore,
)
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.robot.frames import ROBOT, Robot

NO_RESTORING = "LeRobot records here, and what it has discarded cannot be restored."
NO_WORDING = "The instruction is said where the recording was started."


class HandArms:
    """Two arms of numbers that the operator's hands lead, as a session leads those of a task.

    Messages may come from any thread. Everything else belongs to one thread, which calls `advance`
    thirty times a second.
    """

    def __init__(self, *, lockstep: bool = False, robot: Robot = ROBOT) -> None:
        """Begin at home with both grippers open, waiting for the operator.

        Args:
            lockstep: Whether each message of hands is one step, and nothing moves between.
            robot: Description of the arms.
        """
        self.robot = robot
        self.device = HandDevice(lockstep=lockstep, robot=robot)
        """The hands."""
        self.note = ""
        """A sentence for the operator."""
        self._lockstep = lockstep
        self._kinematics = Kinematics(robot)
        self._presses = ButtonPresses()
        self._inbox = Inbox()
        self._decision: str | None = None
        self.place(robot.home_command)

    # --- from any thread ---------------------------------------------------------------------

    def receive(self, message: Message, now_s: float) -> None:
        """Take a message of the operator.

        Args:
            message: The message.
            now_s: When it arrived, on the clock of `advance`.

        Raises:
            MessageError: It is refused; everything goes on as if it had not come.
        """
        if isinstance(message, Instruction):
            raise MessageError(NO_WORDING)
        if isinstance(message, Restore):
            raise MessageError(NO_RESTORING)
        self._inbox.put(message, now_s)

    def leave(self, now_s: float) -> None:
        """The operator has gone, or the connection is lost: both hands let go."""
        self._inbox.put(None, now_s)

    # --- from one thread ---------------------------------------------------------------------

    def wait(self, timeout_s: float) -> None:
        """Wait for a message, or for so many seconds."""
        self._inbox.wait(timeout_s)

    def place(self, command: DuoCommand) -> None:
        """Say where the arms are; they stay there until the operator opens the hands and begins."""
        self.command = command
        """Where the arms are commanded to be."""
        self.is_led = False
        """Whether the operator has begun."""
        self.device.begin(command)

    def advance(self, now_s: float, measured: DuoState | None = None) -> DuoCommand:
        """One control step towards where the hands lead the tools.

        In lockstep that is one step for one message of hands, and none without.

        Args:
            now_s: The time in seconds, on the clock of `receive`.
            measured: Where the arms are, as far as anybody knows: a tool is never led far from
                there. Without it they are taken to be where they are commanded to be.

        Returns:
            The new command.
        """
        has_hands = self._handle()
        if self._lockstep and not has_hands:
            return self.command
        if not self.is_led:
            prompt = self.device.prompt(now_s)
            if prompt is not None:
                self.note = prompt
                return self.command
            self.is_led, self.note = True, ""
        state = self.where() if measured is None else measured
        intent = self.device.intend(now_s, state, self.command)
        rows = intent.action.reshape(len(SIDES), SIDE_SIZE)
        targets = {
            side: SE3.from_tquat(rows[side.index, :ARM_JOINTS]) for side in SIDES
        }
        joints = self._kinematics.step(self.command.joints, targets)
        self.command = DuoCommand(joints=joints, openings=rows[:, ARM_JOINTS])
        return self.command

    def where(self) -> DuoState:
        """The state of arms that are exactly where they are commanded to be."""
        poses = self._kinematics.forward(self.command.joints)
        return DuoState(
            joints=self.command.joints,
            openings=self.command.openings,
            tcp_poses=np.array([poses[side].tquat for side in SIDES]),
        )

    def take_decision(self) -> str | None:
        """`KEEP` or `DISCARD` if the operator said so since the last call; the last word counts."""
        decision, self._decision = self._decision, None
        return decision

    def _handle(self) -> bool:
        """Do what the messages say; in lockstep, those up to the first one of hands."""
        for message, arrival_s in self._inbox:
            if message is None:
                self.device.lose()
                continue
            self.device.take(message, arrival_s)
            match message:
                case Hands():
                    for name in self._presses.new(message):
                        self._decision = self._decision if name == RESTORE else name
                    if self._lockstep:
                        return True
                case Keep():
                    self._decision = KEEP
                case Discard():
                    self._decision = DISCARD
        return False
