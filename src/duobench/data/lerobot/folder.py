"""The folder of an export: where things lie in it, and what says what is exported."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from duobench.data.lerobot.actions import Residual
from duobench.data.lerobot.features import image_key
from duobench.data.lerobot.options import ExportOptions
from duobench.data.schema import Domain
from duobench.envs.action_labels import LABELS
from duobench.envs.spaces import JOINT_NAMES
from duobench.files import begin_or_continue, differences, read, remove_temporary
from duobench.lerobot_keys import ACTION, DOMAINS, OBJECT_STATE, STATE

SCHEMA = 3
"""Version of `Export` and `EpisodeFacts`."""
CHUNK_SIZE = 1000
"""Files in one folder; fixed by the format's default."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SourceEpisode:
    """An episode that is exported."""

    file: str
    """Its file, from the folder of its data set."""
    sha256: str
    """Hash of its file."""
    length: int
    """Number of its actions, and of its rows in the export."""
    instruction: str
    """Instruction of the policy."""
    data_set: int = 0
    """Which of the data sets it is from, in the order in which they were given."""
    domain: Domain = Domain.SIM
    """Where it was played."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Export:
    """Everything that the exported files follow from."""

    options: ExportOptions
    """What was chosen."""
    suite_version: str
    """Version of the benchmark's episodes."""
    versions: dict[str, str]
    """Versions of the packages that the images depend on."""
    episodes: tuple[SourceEpisode, ...]
    """What is exported, in the order of the export."""
    object_state_names: tuple[str, ...] = ()
    """What the numbers of the object state are; none where it is not exported."""
    cameras: dict[str, Any] = field(default_factory=dict)
    """Intrinsics and mounts of the cameras, by name."""
    domains: tuple[str, ...] = DOMAINS
    """What the numbers 0, 1 of the column `domain` stand for."""

    @property
    def vectors(self) -> dict[str, tuple[str, ...]]:
        """What the numbers are of each column that holds several in a row."""
        vectors = {STATE: JOINT_NAMES, ACTION: LABELS[self.options.action].names}
        objects = {OBJECT_STATE: self.object_state_names} if self.object_state_names else {}
        return vectors | objects

    @property
    def tasks(self) -> list[str]:
        """Each instruction once, in order of appearance: what LeRobot calls a task."""
        return list(dict.fromkeys(episode.instruction for episode in self.episodes))

    @property
    def frames(self) -> int:
        """Rows of all episodes together."""
        return self.first_row(len(self.episodes))

    def first_row(self, index: int) -> int:
        """Rows of the export before those of an episode."""
        return sum(episode.length for episode in self.episodes[:index])

    def differences(self, other: Export) -> list[str]:
        """In what another export differs, one phrase each: `look dark instead of default`."""
        return differences(self._facts(), other._facts())

    def _facts(self) -> dict[str, Any]:
        """Everything that is compared, by its name in words."""
        return {
            **asdict(self.options),
            "suite version": self.suite_version,
            **{f"version of {name}": value for name, value in self.versions.items()},
            "episodes": {f"{one.data_set}/{one.file}": one for one in self.episodes},
        }


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeFacts:
    """What the export notes about a finished episode, beside its files."""

    counts: dict[str, list[list[int]]]
    """How often each value occurs in each channel (3, 256), by camera."""
    residual: Residual | None
    """What inverse kinematics left, if it was used."""


@dataclass(frozen=True, slots=True)
class ExportFolder:
    """Names in the folder of an export."""

    path: Path
    """The folder, absolute."""

    @property
    def meta(self) -> Path:
        """Folder of everything that describes the data set."""
        return self.path / "meta"

    @property
    def description(self) -> Path:
        """What is exported: our own file, unknown to LeRobot."""
        return self.meta / "duobench.json"

    @property
    def info(self) -> Path:
        """LeRobot's description; written last, so that it says that the export is whole."""
        return self.meta / "info.json"

    def facts(self, index: int) -> Path:
        """What was noted about a finished episode."""
        return self.meta / "duobench" / f"{index:06d}.json"

    def data(self, index: int) -> Path:
        """Numbers of an episode."""
        return self.path / "data" / f"{_numbered(index)}.parquet"

    def video(self, camera: str, index: int) -> Path:
        """Images of an episode."""
        return self.path / "videos" / image_key(camera) / f"{_numbered(index)}.mp4"

    def is_finished(self, index: int, cameras: Iterable[str]) -> bool:
        """Whether every file of an episode is there."""
        videos = [self.video(camera, index) for camera in cameras]
        return all(path.exists() for path in (self.facts(index), self.data(index), *videos))

    def begin(self, export: Export) -> None:
        """Begin an export in this folder, or continue the one that is there.

        Raises:
            OtherRunError: The folder holds another export or something else.
        """
        begin_or_continue(
            self.path,
            self.description,
            export,
            SCHEMA,
            what="export",
            advice="Export into another folder.",
        )
        remove_temporary(self.path)

    def read_facts(self, index: int) -> EpisodeFacts:
        """What was noted about a finished episode.

        Raises:
            FileError: It cannot be read.
        """
        advice = "Delete the file and export again."
        return read(self.facts(index), EpisodeFacts, SCHEMA, advice=advice)


def location(index: int) -> tuple[int, int]:
    """Number of an episode's folder, and of its file in it."""
    return divmod(index, CHUNK_SIZE)


def _numbered(index: int) -> str:
    chunk, file = location(index)
    return f"chunk-{chunk:03d}/file-{file:03d}"
