"""A backend without any simulation, whose images and health tests can spoil."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from duobench.core.backend import CameraGeometry, DuoLimits, Image, Sizes, Wanted
from duobench.core.types import DuoCommand, DuoState
from duobench.world.robot.camera_geometry import geometries
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.mounts import HOME_JOINTS


class NumberArms:
    """Arms that are at once where they are sent, but never lower their left joint 2."""

    robot = ROBOT

    limits = DuoLimits(
        low=np.tile([*[-3.0] * 7, 0.0], 2),
        high=np.tile([*[4.0] * 7, 1.0], 2),
        max_change=np.tile([*[0.1] * 7, np.inf], 2),
        lead=np.full(16, np.inf),
    )
    time = 0.0

    def __init__(self) -> None:
        self.last_command = DuoCommand(joints=HOME_JOINTS + 0.2, openings=np.zeros(2))
        self.held: str | None = None
        self.calls: list[str] = []
        self.images_taken: list[tuple[Sequence[str], tuple[int, int]]] = []
        self.ages: dict[str, float] = {}
        self.fault: str | None = None

    def start(self) -> None:
        self.calls.append("start")

    def stop(self) -> None:
        self.calls.append("stop")

    def close(self) -> None:
        self.calls.append("close")

    def home(self) -> None:
        self.last_command = DuoCommand(joints=HOME_JOINTS, openings=np.ones(2))
        self.held = None

    def hold(self, reason: str) -> None:
        self.held = self.held or reason

    def health(self) -> str | None:
        return self.fault

    def image_ages(self) -> Mapping[str, float]:
        return self.ages

    def joint_velocities(self) -> np.ndarray:
        return np.zeros((2, 7))

    def read(self) -> DuoState:
        return DuoState(
            joints=self.last_command.joints,
            openings=self.last_command.openings,
            tcp_poses=ROBOT.tcp_poses(self.last_command.joints),
        )

    def command(self, command: DuoCommand) -> DuoCommand:
        if self.held is None:
            joints = command.joints.copy()
            joints[0, 1] = max(joints[0, 1], self.last_command.joints[0, 1])
            self.last_command = DuoCommand(joints=joints, openings=command.openings)
        return self.last_command

    def images(self, cameras: Sequence[str], shape: tuple[int, int]) -> Mapping[str, Image]:
        self.images_taken.append((cameras, shape))
        return {name: np.full((*shape, 3), 7, np.uint8) for name in cameras}

    def images_by_kind(self, wanted: Wanted) -> dict[str, dict[str, Any]]:
        ((kind, sizes),) = wanted.items()
        return {kind: {name: self.images((name,), size)[name] for name, size in sizes.items()}}

    def camera_geometry(self, sizes: Sizes) -> dict[str, CameraGeometry]:
        return geometries(sizes, self.read().tcp_poses, ROBOT.gripper)
