"""What is recorded of a rig beside the environment's observation: its cameras and its arms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import msgspec
import numpy as np

from duobench.backend import Image
from duobench.data.schema import RigFacts, VideoFacts
from duobench.robot.frames import tcp_poses
from duobench.types import SIDES, Array, DuoState, Side

_MEASURED = ("time_s", "joints", "velocities", "torques")
"""What every driver measures, beside its own robot state."""


class Frame(Protocol):
    """One image of a camera, as it came from it."""

    @property
    def index(self) -> int:
        """Number that the camera gave it; a gap is a lost frame."""
        ...

    @property
    def time_s(self) -> float:
        """When it was taken, on the clock of the arms."""
        ...

    @property
    def image(self) -> Image:
        """Red, green, blue (height, width, 3), both even; nobody changes it any more."""
        ...


class Camera(Protocol):
    """A camera that takes images all the time."""

    def listen(self, call: Callable[[Any], None] | None) -> None:
        """Have every frame from now on given to a call, in any thread; None ends it."""
        ...


class Reading(Protocol):
    """One arm at one moment, with attributes `time_s`, `joints`, `velocities` and `torques`."""

    @property
    def state(self) -> Mapping[str, Array]:
        """The driver's full robot state, by the names of its library."""
        ...


class Duo(Protocol):
    """Two arms with cameras on a rig, as `duobench.hardware` makes them."""

    @property
    def rig(self) -> Any:
        """The rig, with `name`, `hash`, `arms`, `grippers` and `cameras`."""
        ...

    @property
    def cameras(self) -> Mapping[str, Camera]:
        """The cameras by name."""
        ...

    def frames(self) -> Mapping[str, Any]:
        """The latest frame of each camera that has one."""
        ...

    def readings(self) -> Mapping[Side, Any]:
        """What each arm says at this moment."""
        ...

    def gripper_readings(self) -> Mapping[Side, Any]:
        """What each gripper says at this moment, with its `opening`."""
        ...

    @property
    def clock(self) -> Any:
        """The clock of the rig, whose `now` gives seconds."""
        ...


@dataclass(frozen=True, kw_only=True, slots=True)
class Robot:
    """A rig as far as it is recorded."""

    duo: Duo
    """Its arms and cameras."""
    facts: RigFacts
    """What every episode says about it."""
    cameras: dict[str, Any]
    """What its file says about its cameras, by name: lenses, mounts, rates."""
    waits: bool = False
    """Whether cameras wait for the encoder of their videos, as only those on a virtual clock may;
    otherwise frames are left out that come while it is too far behind."""

    @staticmethod
    def of(duo: Duo, *, waits: bool = False) -> Robot:
        """What is recorded of a rig.

        Args:
            duo: Its arms and cameras.
            waits: Whether cameras wait for the encoder of their videos.
        """
        rig = duo.rig
        facts = RigFacts(name=rig.name, hash=rig.hash, drivers=drivers_of(rig))
        return Robot(
            duo=duo, facts=facts, cameras=msgspec.to_builtins(dict(rig.cameras)), waits=waits
        )

    def described(self) -> dict[str, Any]:
        """What an episode says about it at its start: fields of `EpisodeInfo`."""
        return {
            "rig": self.facts,
            "cameras": self.cameras,
            "videos": {name: VideoFacts() for name in self.duo.cameras},
            "robot_state_names": self.state_names(),
        }

    def observe(self) -> dict[str, Any]:
        """What is seen of the arms at this moment, by the names of a recording's columns.

        For whoever begins long after the last command, when the environment last looked.
        """
        readings, grippers = self.duo.readings(), self.duo.gripper_readings()
        joints = np.array([readings[side].joints for side in SIDES])
        openings = np.array([grippers[side].opening for side in SIDES])
        state = DuoState(joints=joints, openings=openings, tcp_poses=tcp_poses(joints))
        return {
            "agent_pos": state.flat.astype(np.float32),
            "tcp_pose": state.tcp_poses.astype(np.float32).ravel(),
            "joint_velocity": np.concatenate([readings[side].velocities for side in SIDES]),
            "time": self.duo.clock.now(),
        }

    def state_names(self) -> dict[str, tuple[str, ...]]:
        """What the numbers of each arm's full state are, by side: `torques_0`, `torques_1`, ..."""
        readings = self.duo.readings()
        return {side.value: tuple(_names(readings[side])) for side in SIDES if side in readings}

    def states(self, names: Mapping[str, tuple[str, ...]]) -> dict[str, Array]:
        """The full states (n,) of the arms, by the name of their column.

        Args:
            names: What `state_names` said when the episode began; an arm whose driver says
                something else now, as after a fault, has NaN.
        """
        found = {}
        readings = self.duo.readings()
        for side in map(Side, names):
            wanted = names[side]
            values = np.full(len(wanted), np.nan)
            if side in readings and tuple(_names(readings[side])) == wanted:
                values = np.concatenate(
                    [np.ravel(part).astype(np.float64) for _, part in _parts(readings[side])]
                )
            found[f"{side}_robot_state"] = values
        return found


def drivers_of(rig: Any) -> tuple[str, ...]:
    """What talks to the arms, grippers and cameras of a rig, each kind once."""
    parts = (rig.arms, rig.grippers, rig.cameras)
    return tuple(dict.fromkeys(str(device.driver) for part in parts for device in part.values()))


def _parts(reading: Reading) -> list[tuple[str, Any]]:
    measured = [(name, getattr(reading, name)) for name in _MEASURED]
    return measured + sorted(reading.state.items())


def _names(reading: Reading) -> list[str]:
    names = []
    for name, value in _parts(reading):
        size = np.size(value)
        names += [name] if np.ndim(value) == 0 else [f"{name}_{place}" for place in range(size)]
    return names
