"""Recorded state of a rig beside the environment's observation: its cameras and its arms."""

from collections.abc import Iterable, Mapping
from typing import Any, Protocol

import msgspec
import numpy as np

from duobench.core.types import SIDES, DuoState, Side
from duobench.data.schema import RigFacts, VideoFacts
from duobench.data.stream import EpisodeRows, EpisodeStream
from duobench.data.videos import FrameSource, Videos
from duobench.world.robot.frames import Robot
from duobench.world.sim.layout import Layout

_MEASURED = ("time_s", "joints", "velocities", "torques")
"""Measurements of every driver, beside its own robot state."""


class RigState(Protocol):
    """Two arms with cameras on a rig, as `duobench.real` makes them: what they say and see."""

    @property
    def rig(self) -> Any:
        """The rig, with `name`, `hash`, `arms`, `grippers` and `cameras`."""
        ...

    @property
    def robot(self) -> Robot:
        """Description of the arms."""
        ...

    @property
    def cameras(self) -> Mapping[str, FrameSource]:
        """The cameras by name."""
        ...

    @property
    def clock(self) -> Any:
        """The clock of the rig, whose `now` gives seconds."""
        ...

    def see(self, cameras: Iterable[str]) -> None:
        """Set the cameras in use: an episode waits for their images alone."""

    def frames(self) -> Mapping[str, Any]:
        """The latest frame of each camera that has one."""
        ...

    def readings(self) -> Mapping[Side, Any]:
        """Reading of each arm at this moment.

        That is `time_s`, `joints`, `velocities`, `torques`, and its driver's full robot `state` by
        the names of its library.
        """
        ...

    def gripper_readings(self) -> Mapping[Side, Any]:
        """Reading of each gripper at this moment, with its `opening`."""
        ...


class RigRecorder:
    """Adds to the episodes of a `Recorder` what a rig alone knows: videos and full states.

    Args:
        duo: Its arms and cameras.
        waits: Whether cameras wait for the encoder of their videos, as only those on a virtual
            clock may; otherwise frames are left out that come while it is too far behind.
    """

    def __init__(self, duo: RigState, *, waits: bool = False) -> None:
        self._duo, self._waits = duo, waits
        rig = duo.rig
        self._facts = RigFacts(name=rig.name, hash=rig.hash, drivers=drivers_of(rig))
        self._cameras = msgspec.to_builtins(dict(rig.cameras))

    def described(self) -> dict[str, Any]:
        """Fields of `EpisodeInfo`: what an episode says about it at its start."""
        readings = self._duo.readings()
        return {
            "rig": self._facts,
            "cameras": self._cameras,
            "videos": {name: VideoFacts() for name in self._duo.cameras},
            "robot_state_names": {
                str(side): _full_state(reading)[0] for side, reading in readings.items()
            },
        }

    def begin(self, episode: EpisodeStream) -> None:
        """Begin the videos that an episode says it has."""
        if episode.info.videos:
            self._duo.see(self._duo.cameras)
            cameras = {name: self._duo.cameras[name] for name in episode.info.videos}
            rates = {name: self._cameras[name]["fps"] for name in cameras}
            episode.videos = Videos(episode.path, cameras, rates, self._waits)

    def begin_step(self, episode: EpisodeRows) -> None:
        """Before the first step, and after a pause, see the last row again, and record every frame.

        A person may take long to begin, or to go on, after the environment has looked.
        """
        videos = episode.videos
        if videos is None or videos.is_listening:
            return
        readings, grippers = self._duo.readings(), self._duo.gripper_readings()
        joints = np.array([readings[side].joints for side in SIDES])
        openings = np.array([grippers[side].opening for side in SIDES])
        state = DuoState(
            joints=joints,
            openings=openings,
            tcp_poses=self._duo.robot.tcp_poses(joints),
        )
        now = self._duo.clock.now()
        row = {
            "agent_pos": state.flat.astype(np.float32),
            "tcp_pose": state.tcp_poses.astype(np.float32).ravel(),
            "joint_velocity": np.concatenate(
                [readings[side].velocities for side in SIDES]
            ),
            "time": now,
        }
        episode.complete(row | self.seen(episode, now))
        videos.listen()

    def pause(self, episode: EpisodeRows) -> None:
        """Record no frames until the next step."""
        if episode.videos is not None:
            episode.videos.pause()

    def seen(self, episode: EpisodeRows, time_s: float) -> dict[str, Any]:
        """Columns that a rig alone fills, of a row at a time on its clock: full states, and frames.

        An arm whose driver says something else than when the episode began, as after a fault, has
        NaN.
        """
        row: dict[str, Any] = {}
        readings = self._duo.readings()
        for side, wanted in episode.info.robot_state_names.items():
            names, numbers = _full_state(readings[Side(side)])
            row[f"{side}_robot_state"] = numbers if names == wanted else np.nan
        if episode.videos is not None:
            row |= episode.videos.see(self._duo.frames(), time_s)
        return row


def drivers_of(rig: Any) -> tuple[str, ...]:
    """Drivers of the arms, grippers and cameras of a rig, each kind once."""
    parts = (rig.arms, rig.grippers, rig.cameras)
    return tuple(
        dict.fromkeys(str(device.driver) for part in parts for device in part.values())
    )


def placement(layout: Layout) -> str:
    """Places of a layout's objects for people, one a line: mm in the table frame, degrees."""
    lines = []
    for name, pose in sorted(layout.poses.items()):
        x, y, z = 1000.0 * pose.translation
        yaw = np.degrees(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]))
        lines.append(
            f"  {name}: x {x:.0f} mm, y {y:.0f} mm, z {z:.0f} mm, turned by {yaw:.0f} deg"
        )
    lines += [f"  {name}: {value}" for name, value in sorted(layout.variants.items())]
    return "\n".join(lines) or "  as you like; this task says nothing."


def _full_state(reading: Any) -> tuple[tuple[str, ...], list[float]]:
    """Names and numbers of an arm's full state: what every driver measures, then its own.

    The numbers of `torques` are named `torques_0`, `torques_1`, ...
    """
    measured = [(name, getattr(reading, name)) for name in _MEASURED]
    names, numbers = [], []
    for name, value in measured + sorted(reading.state.items()):
        size = np.size(value)
        names += (
            [name]
            if np.ndim(value) == 0
            else [f"{name}_{place}" for place in range(size)]
        )
        numbers += np.ravel(value).tolist()
    return tuple(names), numbers
