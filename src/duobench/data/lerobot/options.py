"""Options of an export."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from duobench.core.errors import DataError, OptionError, check_known
from duobench.core.types import as_several, as_size
from duobench.data.schema import Domain
from duobench.envs.action_labels import LABELS
from duobench.envs.action_modes import JOINT
from duobench.envs.config import IMAGE_SIZE
from duobench.envs.state_labels import StatePart
from duobench.world.looks import catalog as looks
from duobench.world.looks.catalog import DEFAULT, RANDOM, as_look
from duobench.world.robot.cameras import POLICY_CAMERAS, check_image_size

LEAST_SIZE = 4
"""Pixels along an edge of a video that its encoder takes at least."""
PER_EPISODE = "random_per_episode"
"""A random look for each episode, another one each; `:SEED` may follow."""


class Format(StrEnum):
    """LeRobot's data set format, by its version."""

    V30 = "v3.0"
    """Format that LeRobot reads since 0.4."""
    V21 = "v2.1"
    """Format that LeRobot 0.3, openpi and Isaac-GR00T read."""

    @property
    def paths(self) -> tuple[str, str]:
        """Paths of the numbers and the images of an episode, in the form of `meta/info.json`."""
        if self is Format.V30:
            place = "chunk-{chunk_index:03d}/file-{file_index:03d}"
            return f"data/{place}.parquet", f"videos/{{video_key}}/{place}.mp4"
        chunk, file = "chunk-{episode_chunk:03d}", "episode_{episode_index:06d}"
        return (
            f"data/{chunk}/{file}.parquet",
            f"videos/{chunk}/{{video_key}}/{file}.mp4",
        )


class Pairing(StrEnum):
    """Which observation stands in a row with action t."""

    CAUSAL = "causal"
    """Observation before the action, o_t: the one that a policy has when it decides."""
    DELAYED = "delayed"
    """Observation after it, o_{t+1} [paper, data sets]."""

    @property
    def offset(self) -> int:
        """How many rows after its action's an observation is."""
        return int(self is Pairing.DELAYED)


class ActionSource(StrEnum):
    """Which of the recorded numbers become `action`."""

    INTENDED = "intended"
    """Action of the actor, where it acted in joint targets or in the exported mode; else what was
    sent."""
    SENT = "sent"
    """Targets that were really sent to the arms: clipped to limits, and with noise that an actor
    added to its own actions."""
    GIVEN = "given"
    """Action of the actor as given; tool poses that are exported in another mode are brought to
    joint targets by inverse kinematics that starts at the observed joints of each row."""


_KINDS = {"format": Format, "pairing": Pairing, "action_source": ActionSource}
"""Options that are one of some words."""


_set = object.__setattr__  # of what is frozen


def _words(
    kind: str, given: str | Iterable[str], known: Iterable[str]
) -> tuple[str, ...]:
    """Words that are known, of one or several."""
    words = as_several(given)
    if words is None:
        raise DataError(f"One {kind} is taken, or a list of them; got {given!r}.")
    for word in words:
        check_known(kind, word, [*map(str, known)])
    return words


def _checked_size(given: object) -> tuple[int, int]:
    """Height and width in pixels that a camera gives and a video has."""
    size = as_size(given)
    if size is None:
        raise DataError(
            f"Images have a size (height, width) in pixels, or one number; got {given!r}."
        )
    check_image_size(*size)
    if any(pixels % 2 or pixels < LEAST_SIZE for pixels in size):
        raise DataError(
            f"Height and width of images in a video are even numbers from {LEAST_SIZE} on, got "
            f"{size[0]}x{size[1]}."
        )
    return size


@dataclass(frozen=True, kw_only=True)
class EpisodeChoice:
    """Which episodes are exported."""

    tasks: tuple[str, ...] = ()
    """Ids of the tasks to export; if empty, all tasks of the data set."""
    only_successes: bool = False
    """Leave out episodes that did not succeed."""
    domains: tuple[Domain, ...] = tuple(Domain)
    """Export episodes from there: the simulation, real arms, or both."""

    def __post_init__(self) -> None:
        _set(
            self,
            "tasks",
            (self.tasks,) if isinstance(self.tasks, str) else tuple(self.tasks),
        )
        _set(
            self, "domains", tuple(map(Domain, _words("domain", self.domains, Domain)))
        )


@dataclass(frozen=True, kw_only=True)
class ExportForm:
    """In what form they are exported."""

    cameras: tuple[str, ...] = POLICY_CAMERAS
    """Cameras whose images are rendered; without any, or with "none" alone, there are no images."""
    size: tuple[int, int] = IMAGE_SIZE
    """Height and width of the images in pixels, even numbers from 4 on."""
    look: str = DEFAULT
    """How rendered images look, such as wood_table or random:7; see the page looks. In
    random_per_episode each episode has a random look of its own; random_per_episode:SEED gives
    others."""
    format: Format = Format.V30
    """Version of LeRobot's format: v3.0, or v2.1 with what openpi and Isaac-GR00T want beside."""
    pairing: Pairing = Pairing.CAUSAL
    """Which observation stands with an action: the one before it (causal) or after it (delayed)."""
    action: str = JOINT.name
    """Mode of the actions: joint (targets), cartesian (tool poses) or cartesian_relative
    (changes of them), with rotations as six numbers; see the page lerobot."""
    action_source: ActionSource = ActionSource.INTENDED
    """Which recorded numbers they are made of: what the actor wanted (intended; where it acted in
    something else, what was sent), what was sent, or what was given, brought to joint targets."""
    state: tuple[StatePart, ...] = ()
    """Parts of the state behind joint positions and openings: tool poses (tcp_pose), joint
    velocities (joint_velocity), or both."""
    object_state: bool = False
    """Export where the objects are too, as numbers that no camera sees."""

    def __post_init__(self) -> None:
        for name, kind in _KINDS.items():
            check_known(name.replace("_", " "), getattr(self, name), [*map(str, kind)])
            _set(self, name, kind(getattr(self, name)))
        state = _words("part of a state", self.state, StatePart)
        _set(self, "state", tuple(part for part in StatePart if part in state))
        is_none = self.cameras in ("none", ("none",))
        cameras = () if is_none else _words("camera", self.cameras, POLICY_CAMERAS)
        _set(self, "cameras", tuple(dict.fromkeys(cameras)))
        check_known("action mode of an export", self.action, LABELS)
        _set(self, "size", _checked_size(self.size))
        name, colon, seed = self.look.partition(":")
        if f"{name}:" != RANDOM:
            check_known("look", name, (*looks.names(), f"{RANDOM}SEED", PER_EPISODE))
        try:
            as_look(
                f"{RANDOM}{seed if colon else 0}" if name == PER_EPISODE else self.look
            )
        except OptionError as error:
            raise DataError(
                f"Random looks are named {RANDOM}SEED, as {RANDOM}7, one for all episodes, or "
                f"{PER_EPISODE} or {PER_EPISODE}:SEED, one for each; got {self.look!r}."
            ) from error

    @property
    def look_numbers(self) -> int | None:
        """Seed of the looks where each episode has its own; None where all have one."""
        name, _, seed = self.look.partition(":")
        return int(seed or 0) if name == PER_EPISODE else None


@dataclass(frozen=True, kw_only=True)
class ExportOptions(ExportForm, EpisodeChoice):
    """Options of an export; the defaults suit the evaluation's environment."""

    def __post_init__(self) -> None:
        ExportForm.__post_init__(self)
        EpisodeChoice.__post_init__(self)
