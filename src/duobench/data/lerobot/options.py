"""Options of an export."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from duobench.core.backend import DEPTH, RGB, Wanted
from duobench.core.codecs import AV1, DATA_H264, Codec
from duobench.core.errors import DataError, OptionError, check_known
from duobench.core.lerobot_keys import DEPTH_SUFFIX
from duobench.core.types import CONTROL_HZ, as_several, as_size
from duobench.data.schema import Domain
from duobench.data.used_rows import RowChoice
from duobench.envs.action_labels import LABELS
from duobench.envs.action_modes import CARTESIAN_RELATIVE, JOINT
from duobench.envs.camera_options import name_of
from duobench.envs.config import IMAGE_SIZE, EnvConfig
from duobench.envs.rewards import DENSE, PROGRESS, REWARDS
from duobench.envs.state_labels import StatePart
from duobench.world.looks import catalog as looks
from duobench.world.looks.catalog import DEFAULT, RANDOM, as_look
from duobench.world.robot.cameras import POLICY_CAMERAS, Camera, check_image_size

LEAST_SIZE, LEAST_DEPTH_SIZE = 4, 16
"""Pixels along an edge of a video that the encoder of images, and that of depth, takes at least."""
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


class VideoCodec(StrEnum):
    """Encoding of the images of an export."""

    AV1 = "av1"
    """To publish: half the size, and LeRobot's own choice."""
    H264 = "h264"
    """To train here: encoded in a fifth of the time, decoded faster."""

    @property
    def encoding(self) -> Codec:
        """How the frames are encoded."""
        return AV1 if self is VideoCodec.AV1 else DATA_H264


_KINDS = {"format": Format, "pairing": Pairing, "action_source": ActionSource}
"""Options that are one of some words."""


_set = object.__setattr__  # of what is frozen


def _several(kind: str, given: Any) -> tuple[Any, ...]:
    """One or several things of a kind."""
    several = (given,) if isinstance(given, Camera) else as_several(given)
    if several is None:
        raise DataError(f"One {kind} is taken, or a list of them; got {given!r}.")
    return several


def _words(
    kind: str, given: str | Iterable[str], known: Iterable[str]
) -> tuple[str, ...]:
    """Words that are known, of one or several."""
    words = _several(kind, given)
    for word in words:
        check_known(kind, word, [*map(str, known)])
    return words


def _checked_size(given: object, least: int = LEAST_SIZE) -> tuple[int, int]:
    """Height and width in pixels that a camera gives and a video has."""
    size = as_size(given)
    if size is None:
        raise DataError(
            f"Images have a size (height, width) in pixels, or one number; got {given!r}."
        )
    check_image_size(*size)
    if any(pixels % 2 or pixels < least for pixels in size):
        raise DataError(
            f"Height and width of images in a video are even numbers from {least} on, got "
            f"{size[0]}x{size[1]}."
        )
    return size


@dataclass(frozen=True, kw_only=True)
class EpisodeChoice(RowChoice):
    """Which episodes are exported, and which of their rows."""

    tasks: tuple[str, ...] = ()
    """Ids of the tasks to export; if empty, all tasks of the data set."""
    only_successes: bool = False
    """Leave out episodes that did not succeed."""
    keep_failures: bool = False
    """Export kept episodes without success too where a person led, and not only where nobody
    did."""
    domains: tuple[Domain, ...] = tuple(Domain)
    """Export episodes from there: the simulation, real arms, or both."""

    def __post_init__(self) -> None:
        RowChoice.__post_init__(self)
        if self.only_successes and self.keep_failures:
            raise DataError(
                "Failures are left out by one option and exported by the other; give one of "
                "only_successes and keep_failures."
            )
        _set(
            self,
            "tasks",
            (self.tasks,) if isinstance(self.tasks, str) else tuple(self.tasks),
        )
        _set(
            self, "domains", tuple(map(Domain, _words("domain", self.domains, Domain)))
        )


@dataclass(frozen=True, kw_only=True)
class ExportImages:
    """What cameras show of them."""

    cameras: tuple[str | Camera, ...] = POLICY_CAMERAS
    """Cameras whose images are rendered; without any, or with "none" alone, there are no images.
    One of your own is a `Camera`, on the command line as JSON or module:NAME."""
    size: tuple[int, int] = IMAGE_SIZE
    """Height and width of the images in pixels, even numbers from 4 on."""
    depth: bool | tuple[str, ...] = ()
    """Cameras whose depth is exported too, as LeRobot's depth maps; without a name that of all of
    `cameras`."""
    geometry: bool = False
    """Export where cameras are: matrices and poses in meta/info.json, and poses of those that move
    in each row; done with depth, unless each episode has a look of its own."""
    look: str = DEFAULT
    """How rendered images look, such as wood_table or random:7; see the page looks. In
    random_per_episode each episode has a random look of its own; random_per_episode:SEED gives
    others."""
    codec: VideoCodec = VideoCodec.AV1
    """Encoding of images: av1, to publish, or h264, in a fifth of the time and twice the size."""

    def __post_init__(self) -> None:
        check_known("codec", self.codec, [*map(str, VideoCodec)])
        _set(self, "codec", VideoCodec(self.codec))
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
        self._set_cameras()

    def _set_cameras(self) -> None:
        is_none = self.cameras in ("none", ("none",))
        given = () if is_none else _several("camera", self.cameras)
        seen = EnvConfig.from_options({"cameras": given, "depth": self.depth})
        _set(self, "cameras", tuple(dict.fromkeys(seen.cameras)))
        _set(self, "depth", tuple(dict.fromkeys(seen.depth)))
        has_looks = self.look_numbers is not None
        _set(self, "geometry", self.geometry or bool(self.depth and not has_looks))
        if self.geometry and has_looks:
            raise DataError(
                "Where cameras are is exported in one look for all episodes; in "
                f"{self.look!r} each has others."
            )
        for name in map(name_of, self.cameras):
            if name in self.depth_of:
                raise DataError(
                    f"Depth of another camera is called {name!r} here; give this one another "
                    f"name, such as 'my_{name}'."
                )
        for name, size in self.videos.items():
            _checked_size(
                size, LEAST_DEPTH_SIZE if name in self.depth_of else LEAST_SIZE
            )

    @property
    def wanted(self) -> Wanted:
        """Images that are rendered, by kind and camera, with their sizes."""
        options = {
            "cameras": self.cameras,
            "depth": self.depth,
            "image_size": self.size,
        }
        return EnvConfig.from_options(options).wanted

    @property
    def seen(self) -> tuple[str | Camera, ...]:
        """Cameras of which there are images or depth: of one's own as they are, others by name."""
        every: Any = (camera for sizes in self.wanted.values() for camera in sizes)
        return tuple(dict.fromkeys(every))

    @property
    def depth_of(self) -> dict[str, str]:
        """The camera of each video of depth, by the video's name."""
        names = map(name_of, self.wanted.get(DEPTH, ()))
        return {f"{name}{DEPTH_SUFFIX}": name for name in names}

    @property
    def videos(self) -> dict[str, tuple[int, int]]:
        """Height and width of each video by its name: images of cameras, then depth."""
        images = self.wanted.get(RGB, {}).items()
        depths = self.wanted.get(DEPTH, {}).values()
        return {
            **{name_of(camera): size for camera, size in images},
            **dict(zip(self.depth_of, depths, strict=True)),
        }

    @property
    def look_numbers(self) -> int | None:
        """Seed of the looks where each episode has its own; None where all have one."""
        name, _, seed = self.look.partition(":")
        return int(seed or 0) if name == PER_EPISODE else None


@dataclass(frozen=True, kw_only=True)
class ExportForm:
    """In what form they are exported."""

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
    reward: str = PROGRESS
    """What a row pays, as the option of the environment: stage, progress, or dense, for which the
    recorded states of the simulation are judged again."""
    after_success: bool = False
    """Export what was recorded after success too, as hands open and retreat: for policies that
    imitate chunks of actions. Rewards are zero there."""
    every: int = 1
    """Export each so many rows, from the first one on: a divisor of 30. Rewards are those of all
    rows, added up."""

    def __post_init__(self) -> None:
        for name, kind in _KINDS.items():
            check_known(name.replace("_", " "), getattr(self, name), [*map(str, kind)])
            _set(self, name, kind(getattr(self, name)))
        state = _words("part of a state", self.state, StatePart)
        _set(self, "state", tuple(part for part in StatePart if part in state))
        check_known("action mode of an export", self.action, LABELS)
        check_known("reward", self.reward, REWARDS)
        self._check_every()

    def _check_every(self) -> None:
        rate = int(CONTROL_HZ)
        rates = [every for every in range(1, rate + 1) if rate % every == 0]
        if self.every not in rates:
            raise DataError(
                f"Each so many rows are exported, one of {', '.join(map(str, rates))}, so that "
                f"there are whole ones a second; got {self.every!r}."
            )
        if self.every > 1 and self.action == CARTESIAN_RELATIVE.name:
            raise DataError(
                f"Actions of mode {self.action!r} lead through every row; with each of "
                f"{self.every} alone they lead elsewhere. Export targets, or every row."
            )

    @property
    def fps(self) -> int:
        """Rows a second."""
        return int(CONTROL_HZ) // self.every


@dataclass(frozen=True, kw_only=True)
class ExportOptions(ExportForm, ExportImages, EpisodeChoice):
    """Options of an export; the defaults suit the evaluation's environment."""

    def __post_init__(self) -> None:
        EpisodeChoice.__post_init__(self)
        ExportImages.__post_init__(self)
        ExportForm.__post_init__(self)
        if self.depth and self.format is Format.V21:
            raise DataError(
                f"Depth maps need format {Format.V30}; {Format.V21} has none."
            )

    @property
    def shows_states(self) -> bool:
        """Whether recorded states are shown in the simulation, for what follows from them."""
        return bool(self.seen) or self.object_state or self.reward == DENSE
