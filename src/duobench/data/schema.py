"""Schema of a recording: its columns, and facts about the episode as a whole.

One Parquet file an episode. Row t holds what was seen before action t, the action, and what the
step gave back; one last row holds what was seen after the last action, its action being null. So
both pairings can be read: the causal one (o_t, a_t) and the delayed one (a_t, o_{t+1}).
"""

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from duobench.core.errors import OptionError
from duobench.core.types import CONTROL_HZ, SIDES
from duobench.envs import action_modes
from duobench.envs.action_modes import JOINT, ActionMode
from duobench.envs.config import EnvConfig
from duobench.envs.spaces import JOINT_NAMES
from duobench.world.robot.frames import Robot

SCHEMA = 6
"""Version of the columns and of `EpisodeInfo`; raised when one is removed or changes, or is added
without a default."""
INFO_KEY = b"duobench.episode"
"""Key of the file's metadata under which `EpisodeInfo` stands as JSON."""

VIDEO_SUFFIX = ".mp4"
"""Ending of the videos beside an episode's file, `NAME.CAMERA.mp4`."""
AFTER_SUCCESS_S = 1.0
"""Seconds that a demonstration goes on by default.

Success may come soon after the command that opens the hand. A data set that ends there has few
labels for letting go and none for the retreat, and a loss that masks what lies beyond the end of an
episode, as that of ACT, may never learn them.
"""


def video_path(episode: Path, camera: str) -> Path:
    """Path of a camera's video, of an episode whose file, finished or not, is given."""
    return episode.with_name(f"{episode.stem}.{camera}{VIDEO_SUFFIX}")


def steps_after_success(seconds: float) -> int:
    """The control steps of that many seconds, rounded."""
    if not (math.isfinite(seconds) and seconds >= 0.0):
        raise OptionError(
            f"after_success is a number of seconds from 0 (off) on, such as {AFTER_SUCCESS_S}; got "
            f"{seconds}."
        )
    return round(seconds * CONTROL_HZ)


@dataclass(frozen=True, kw_only=True, slots=True)
class Column:
    """One column of a recording."""

    name: str
    dtype: DTypeLike
    shape: tuple[int, ...]
    """Shape of one row: () for a number, (n,) for n of them, (0,) for as many as there are."""
    of_action: bool = False
    """Whether it belongs to the action of its row, so that the last row has none."""

    def is_in(self, info: "EpisodeInfo") -> bool:
        """Whether an episode has it.

        The rows of others hold no numbers, (T, 0) or (T + 1, 0), and all have the same leader.
        """
        if self.name == LEADER:
            return bool(info.leaders)
        return info.widths.get(self.name) != 0

    def row_shape(self, info: "EpisodeInfo", size: int) -> tuple[int, ...]:
        """Shape of one row in an episode; `size` numbers where nothing says how many."""
        width = info.widths.get(self.name)
        return tuple(n or size for n in self.shape) if width is None else (width,)


LEADER = "leader"
"""Column that says who led each row."""
COLUMNS = (
    Column(name="time", dtype=np.float64, shape=()),
    Column(name="agent_pos", dtype=np.float32, shape=(16,)),
    Column(name="tcp_pose", dtype=np.float32, shape=(14,)),
    Column(name="joint_velocity", dtype=np.float32, shape=(14,)),
    Column(name="stage", dtype=np.int64, shape=()),
    Column(name="success", dtype=np.bool_, shape=()),
    Column(name="success_at_end", dtype=np.bool_, shape=()),
    Column(name="state", dtype=np.float64, shape=(0,)),
    Column(
        name="action",
        dtype=np.float64,
        shape=(0,),
        of_action=True,
    ),
    Column(
        name="sent",
        dtype=np.float64,
        shape=(16,),
        of_action=True,
    ),
    Column(
        name="reward",
        dtype=np.float64,
        shape=(),
        of_action=True,
    ),
    Column(
        name="clutch",
        dtype=np.bool_,
        shape=(2,),
        of_action=True,
    ),
    Column(
        name=LEADER,
        dtype=np.int64,
        shape=(),
        of_action=True,
    ),
    *(
        Column(name=name, dtype=np.int64, shape=(0,))
        for name in ("frame", "frame_number")
    ),
    Column(name="frame_age", dtype=np.float64, shape=(0,)),
    *(
        Column(name=f"{side}_robot_state", dtype=np.float64, shape=(0,))
        for side in SIDES
    ),
)
"""Every column of a recording; `Recording` says what they hold."""


class Domain(StrEnum):
    """Domain in which an episode was played."""

    SIM = "sim"
    REAL = "real"
    """On a rig: real arms, or drivers in their place, which the rig names."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RigFacts:
    """The rig that an episode was played on."""

    name: str
    hash: str
    """SHA-256 of all that its file says."""
    drivers: tuple[str, ...] = ()
    """Drivers of its arms, grippers and cameras, each name once."""

    @property
    def is_rehearsal(self) -> bool:
        """Whether no part of it was hardware, but a rehearsal."""
        return self.drivers == ("rehearsal",)


@dataclass(frozen=True, kw_only=True, slots=True)
class VideoFacts:
    """Video of one camera of a rig, beside the episode's file."""

    frames: int | None = None
    """Frames in the video; None while it is being recorded."""
    sha256: str | None = None
    """Hash of its file; None while it is being recorded."""
    left_out: int = 0
    """Frames that came while the encoder was too far behind, and are missing in the video."""


class ActorKind(StrEnum):
    """Kind of the actor that decided the actions."""

    EXPERT = "expert"
    POLICY = "policy"
    PERSON = "person"
    PROGRAM = "program"
    SCRIPTED_OPERATOR = "scripted operator"
    """A program in the place of a person, which moves hands as an expert moves tools."""

    @property
    def is_policy(self) -> bool:
        """Whether it is what a person may take over from."""
        return self in (ActorKind.POLICY, ActorKind.EXPERT)


PEOPLE = (ActorKind.PERSON, ActorKind.SCRIPTED_OPERATOR)
"""Kinds of actors that lead: a person, or a program in the place of one."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Actor:
    """Actor of an episode."""

    kind: ActorKind = ActorKind.PROGRAM
    name: str = ""
    """Name of the policy, or a person's pseudonym."""
    version: str | None = None
    device: str | None = None
    """Device that a person used, or a scripted operator imitated; "mouse and gamepad" if
    several."""

    @property
    def words(self) -> str:
        """Kind and name in words; the name alone where it says the kind, as that of an expert."""
        says_kind = self.name.partition(":")[0] == self.kind
        return self.name if says_kind else f"{self.kind} {self.name}".strip()


@dataclass(frozen=True, kw_only=True, slots=True)
class Takeover:
    """Beginning of a stretch in which somebody else led than the policy."""

    step: int
    """Control steps before it: the row of its first action."""
    why: str = ""
    """Reason that was given; empty without."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Outcome:
    """End of an episode."""

    success: bool
    stage: int
    """Highest stage that was reached."""
    max_stage: int
    kept: bool = True
    """Whether it is meant to be used."""
    reason: str | None = None
    """Reason why it is not, what made it crash, or why the arms ended it."""
    cut: bool = False
    """Whether it ended before the environment ended it."""
    success_step: int | None = None
    """Control steps until the success that stands at the end, also its first row; or None."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeInfo:
    """Facts about an episode as a whole."""

    task: str
    """Its id."""
    reference: str = ""
    """Id or import path by which it is loaded; empty if unknown."""
    instruction: str
    """Instruction of the policy, or what an operator typed."""
    subinstructions: tuple[str, ...]
    """Instructions at stages 0, 1, ... that lead to the next one."""
    layout: dict[str, Any]
    """Layout at the start in the JSON form of `Layout`; empty on real arms."""
    seed: int | None
    """Seed that sampled the layout; None if it was given."""
    split: str | None
    """Split that the layout was sampled for, "train" or "eval"; None if it was given."""
    config: EnvConfig | None
    """Configuration of the environment; None where wrappers were put together by hand."""
    suite_version: str
    versions: dict[str, str]
    """Versions of the packages that the episode depends on."""
    actor: Actor
    outcome: Outcome | None = None
    """Outcome; None while it is being recorded."""
    first_hash: str | None = None
    """Hash of the `EpisodeState` of the first row; None on real arms."""
    last_hash: str | None = None
    """Hash of the `EpisodeState` of the last row; None on real arms."""
    observation_names: tuple[str, ...] = JOINT_NAMES
    """Names of the numbers of `agent_pos` and `sent`."""
    action_names: tuple[str, ...] = JOINT_NAMES
    """Names of the numbers of `action`."""
    action_mode: str = JOINT.name
    after_success: float = 0.0
    """Seconds that it was to go on after success, a whole number of control steps."""
    cameras: dict[str, Any] = field(default_factory=dict)
    """Lenses and mounts of the cameras, as `robot.cameras.describe_cameras` gives them; on a rig
    what its file says about them. A look that moves cameras is in `config`."""
    task_instruction: str = ""
    """The task's own instruction in this layout, which `instruction` may paraphrase."""
    has_clutch: bool = False
    """Whether rows say which hands led their arms."""
    domain: Domain = Domain.SIM
    rig: RigFacts | None = None
    videos: dict[str, VideoFacts] = field(default_factory=dict)
    """Videos beside the file, `NAME.CAMERA.mp4`, by camera, in the order of the numbers in the
    columns of frames; none in simulation, where images follow from states."""
    robot_state_names: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Names of the numbers of `left_robot_state` and `right_robot_state`, by side."""
    leaders: tuple[Actor, ...] = ()
    """Those who led, `actor` first, where several did; the column `leader` counts in them."""
    takeovers: tuple[Takeover, ...] = ()
    """Beginnings of what was led in the place of a policy, by step."""

    @property
    def robot(self) -> Robot:
        """Description of its arms."""
        return (self.config or EnvConfig()).robot

    @property
    def other_robot(self) -> str:
        """Gripper and mount that are not the paper's, in a word; empty where both are."""
        return (self.config or EnvConfig()).other_robot

    @property
    def is_real(self) -> bool:
        """Whether it was played on real arms, whose state is not known as a whole."""
        return self.domain is Domain.REAL

    @property
    def actors(self) -> tuple[Actor, ...]:
        """All who led, in the order in which they did first: `leader` is a place in these."""
        return self.leaders or (self.actor,)

    @property
    def operator(self) -> str:
        """Name of the first one who led and is no policy; empty without."""
        return next((each.name for each in self.actors if not each.kind.is_policy), "")

    @property
    def is_led(self) -> bool:
        """Whether a person led in it, or a program in the place of one."""
        return any(actor.kind in PEOPLE for actor in self.actors)

    @property
    def is_led_failure(self) -> bool:
        """Whether people led it without success, so that exports leave it out by default."""
        outcome = self.outcome
        return self.is_led and outcome is not None and not outcome.success

    @property
    def widths(self) -> dict[str, int]:
        """Numbers in a row of the columns that not every episode has; 0 of those that it lacks."""
        of_videos = dict.fromkeys(
            ("frame", "frame_number", "frame_age"), len(self.videos)
        )
        of_arms = {
            f"{side}_robot_state": len(self.robot_state_names.get(side, ()))
            for side in SIDES
        }
        no_state = {"state": 0} if self.is_real else {}
        return {"clutch": 2 * self.has_clutch} | of_videos | of_arms | no_state

    @property
    def mode(self) -> ActionMode:
        """Mode of its actions.

        Raises:
            UnknownNameError: There is no such action mode here.
        """
        return action_modes.get(self.action_mode)

    @property
    def begun(self) -> "EpisodeInfo":
        """Facts that were known when it began; the device and further leaders are known later."""
        actor = replace(self.actor, device=None)
        videos = dict.fromkeys(self.videos, VideoFacts())
        return replace(
            self,
            outcome=None,
            last_hash=None,
            videos=videos,
            actor=actor,
            leaders=(),
            takeovers=(),
        )
