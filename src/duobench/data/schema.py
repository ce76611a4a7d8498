"""What a recording holds: its columns, and what is said about the episode as a whole.

One Parquet file an episode. Row t holds what was seen before action t, the action, and what the
step gave back; one last row holds what was seen after the last action, its action being null. So
both pairings can be read: the causal one (o_t, a_t) and the delayed one (a_t, o_{t+1}).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from duobench.envs import action_modes
from duobench.envs.action_modes import ActionMode
from duobench.envs.config import EnvConfig
from duobench.envs.spaces import JOINT_NAMES
from duobench.errors import DataError
from duobench.types import CONTROL_HZ

SCHEMA = 4
"""Version of the columns and of `EpisodeInfo`; raised when one is added, removed or changes."""
OLDEST_SCHEMA = 1
"""First version that is read too: schema 1 did not say the action mode, 1 and 2 neither the step of
success nor the cameras, and ended with success, and 1 to 3 neither the task's own instruction nor a
clutch."""
INFO_KEY = b"duobench.episode"
"""Key of the file's metadata under which `EpisodeInfo` stands as JSON."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Column:
    """One column of a recording."""

    name: str
    """Its name in the file."""
    dtype: DTypeLike
    """Type of its numbers."""
    shape: tuple[int, ...]
    """Shape of one row: () for a number, (n,) for n of them, (0,) for as many as there are."""
    of_action: bool = False
    """Whether it belongs to the action of its row, so that the last row has none."""
    of_simulation: bool = False
    """Whether only simulated episodes have it; the rows of others hold no numbers (T + 1, 0)."""
    of_clutch: bool = False
    """Whether only episodes that were led with a clutch have it; those of others hold no numbers
    (T, 0)."""

    def is_in(self, info: EpisodeInfo) -> bool:
        """Whether an episode has it."""
        is_missing = self.of_simulation and info.is_real
        return not (is_missing or (self.of_clutch and not info.has_clutch))


COLUMNS = (
    Column(name="time", dtype=np.float64, shape=()),
    Column(name="agent_pos", dtype=np.float32, shape=(16,)),
    Column(name="tcp_pose", dtype=np.float32, shape=(14,)),
    Column(name="joint_velocity", dtype=np.float32, shape=(14,)),
    Column(name="stage", dtype=np.int64, shape=()),
    Column(name="success", dtype=np.bool_, shape=()),
    Column(name="success_at_end", dtype=np.bool_, shape=()),
    Column(name="state", dtype=np.float64, shape=(0,), of_simulation=True),
    Column(name="action", dtype=np.float64, shape=(0,), of_action=True),
    Column(name="sent", dtype=np.float64, shape=(16,), of_action=True),
    Column(name="reward", dtype=np.float64, shape=(), of_action=True),
    Column(name="clutch", dtype=np.bool_, shape=(2,), of_action=True, of_clutch=True),
)
"""Every column of a recording; `Recording` says what they hold."""


class ActorKind(StrEnum):
    """Who or what decided the actions."""

    EXPERT = "expert"
    POLICY = "policy"
    PERSON = "person"
    PROGRAM = "program"
    SCRIPTED_OPERATOR = "scripted operator"
    """A program in the place of a person, which moves hands as an expert moves tools."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Actor:
    """Who or what acted."""

    kind: ActorKind = ActorKind.PROGRAM
    """What sort of actor it is."""
    name: str = ""
    """Name of the policy, or a person's pseudonym."""
    version: str | None = None
    """Version of the policy, if it has one."""
    device: str | None = None
    """What a person used, or a scripted operator imitated."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Outcome:
    """How an episode ended."""

    success: bool
    """Whether the last stage was reached."""
    stage: int
    """Highest stage that was reached."""
    max_stage: int
    """Number of the task's last stage."""
    kept: bool = True
    """Whether it is meant to be used."""
    reason: str | None = None
    """Why it is not, what made it crash, or why the arms ended it."""
    cut: bool = False
    """Whether it ended before the environment ended it."""
    success_step: int | None = None
    """Control steps until success, which is also the first row that has it; None without success,
    and in schemas 1 and 2, where it is the last row."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeInfo:
    """What is said about an episode as a whole."""

    task: str
    """Id of the task."""
    instruction: str
    """Instruction of the policy, or what an operator typed."""
    subinstructions: tuple[str, ...]
    """What to do at stage 0, 1, ... to reach the next one."""
    layout: dict[str, Any]
    """How the episode began: the JSON form of a `Layout`; empty on real arms."""
    seed: int | None
    """Seed that sampled the layout; None if it was given."""
    split: str | None
    """What the layout was sampled for, "train" or "eval"; None if it was given."""
    config: EnvConfig | None
    """Configuration of the environment; None where wrappers were put together by hand."""
    suite_version: str
    """Version of the benchmark's episodes."""
    versions: dict[str, str]
    """Versions of the packages that the episode depends on."""
    actor: Actor
    """Who or what acted."""
    outcome: Outcome | None = None
    """How it ended; None while it is being recorded."""
    first_hash: str | None = None
    """Hash of the `EpisodeState` of the first row; None on real arms."""
    last_hash: str | None = None
    """Hash of the `EpisodeState` of the last row; None on real arms."""
    control_rate_hz: float = CONTROL_HZ
    """Rows a second."""
    observation_names: tuple[str, ...] = JOINT_NAMES
    """What the numbers of `agent_pos` and `sent` are."""
    action_names: tuple[str, ...] = JOINT_NAMES
    """What the numbers of `action` are."""
    action_mode: str | None = None
    """Name of what they mean; None in schema 1, where `action_names` say it."""
    after_success: float = 0.0
    """Seconds that it was to go on after success, a whole number of control steps."""
    cameras: dict[str, Any] = field(default_factory=dict)
    """Lenses and mounts of the cameras, as `robot.cameras.describe_cameras` gives them; empty on
    real arms, and in schemas 1 and 2. A look that moves cameras is in `config`."""
    task_instruction: str | None = None
    """The task's own instruction in this layout, whatever `instruction` is; None before schema
    4."""
    has_clutch: bool = False
    """Whether rows say which hands led their arms."""

    @property
    def is_real(self) -> bool:
        """Whether it was played on real arms, whose state is not known as a whole."""
        return self.first_hash is None


def action_mode(info: EpisodeInfo) -> ActionMode:
    """What the numbers of an episode's actions mean.

    Raises:
        UnknownNameError: There is no such action mode here.
        DataError: The recording names none, and its numbers have other names than those of any.
    """
    if info.action_mode is not None:
        return action_modes.get(info.action_mode)
    for mode in action_modes.ACTION_MODES.values():
        if info.action_names == mode.names:
            return mode
    raise DataError(f"Actions of numbers {', '.join(info.action_names)} are not known.")
