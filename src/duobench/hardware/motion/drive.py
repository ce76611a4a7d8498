"""Both arms and grippers as one thing that is engaged, led and held."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from duobench.errors import BackendError
from duobench.hardware.clock import Clock
from duobench.hardware.devices import Arm, Gripper
from duobench.hardware.motion.follower import Follower, MotionLimits
from duobench.hardware.motion.leader import Leader
from duobench.hardware.rig import ArmConfig
from duobench.robot.joints import HOME_JOINTS
from duobench.types import SIDES, Array, DuoCommand, Side


class Drive:
    """Leads both arms and tells both grippers; holds both at once."""

    def __init__(
        self,
        arms: Mapping[Side, Arm],
        grippers: Mapping[Side, Gripper],
        configs: Mapping[Side, ArmConfig],
        clock: Clock,
    ) -> None:
        """Begin with arms that track nothing."""
        self._arms, self._grippers, self._configs = arms, grippers, configs
        self.leaders = {
            side: Leader(
                arms[side],
                Follower(HOME_JOINTS[side.index], MotionLimits.of(configs[side])),
                clock,
            )
            for side in SIDES
        }
        """Who tells each arm where to be."""
        self.is_engaged = False
        """Whether the arms track what they are told."""

    def engage(self) -> None:
        """Have both arms track their followers, which begin at the measured joints.

        Raises:
            BackendError: One cannot; then none does.
        """
        started: list[Arm] = []
        try:
            for side, arm in self._arms.items():
                started.append(arm)
                arm.start()
                self.leaders[side].start(arm.read().joints)
        except BackendError:
            for leader in self.leaders.values():
                leader.stop()
            for arm in started:
                arm.stop()
            raise
        self.is_engaged = True

    def disengage(self) -> None:
        """Have both arms stop, damped; twice is harmless."""
        was, self.is_engaged = self.is_engaged, False
        if was:
            for leader in self.leaders.values():
                leader.stop()
            for arm in self._arms.values():
                arm.stop()

    def limit(self, *, is_home: bool) -> None:
        """Bound both arms by the speed of the way home, or of everything else."""
        for side, leader in self.leaders.items():
            config = self._configs[side]
            limits = MotionLimits.of(config)
            if is_home:
                limits = replace(
                    limits, speed_fraction=min(config.home_fraction, limits.speed_fraction)
                )
            leader.limit(limits)

    def aim(self, joints: Array) -> None:
        """Lead both arms towards joint positions (2, 7) in radians."""
        for side, leader in self.leaders.items():
            leader.aim(joints[side.index])

    def send(self, command: DuoCommand) -> None:
        """Lead both arms towards a command, and tell the grippers."""
        self.aim(command.joints)
        for side, gripper in self._grippers.items():
            gripper.command(float(command.openings[side.index]))

    def hold(self) -> None:
        """Bring both arms and both grippers to rest."""
        for leader in self.leaders.values():
            leader.hold()
        for gripper in self._grippers.values():
            gripper.hold()

    @property
    def is_at_rest(self) -> bool:
        """Whether both arms are told to stand still."""
        return all(leader.is_at_rest for leader in self.leaders.values())
