"""The folder of an export: where things lie in it, and what says what is exported."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from duobench.data.lerobot.actions import Residual
from duobench.data.lerobot.features import image_key
from duobench.data.lerobot.options import ExportOptions
from duobench.errors import DataError, FileError
from duobench.files import TEMPORARY_SUFFIX, encode, read, remove_temporary, write
from duobench.lerobot_keys import DOMAINS

SCHEMA = 1
"""Version of `Export` and `EpisodeFacts`."""
CHUNK_SIZE = 1000
"""Files in one folder; fixed by the format's default."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SourceEpisode:
    """An episode that is exported."""

    file: str
    """Its file, from the folder of the data set."""
    sha256: str
    """Hash of its file."""
    length: int
    """Number of its actions, and of its rows in the export."""
    instruction: str
    """Instruction of the policy."""


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
    domains: tuple[str, ...] = DOMAINS
    """What the numbers 0, 1 of the column `domain` stand for."""

    @property
    def tasks(self) -> list[str]:
        """Each instruction once, in order of appearance: what LeRobot calls a task."""
        return list(dict.fromkeys(episode.instruction for episode in self.episodes))

    def first_row(self, index: int) -> int:
        """Rows of the export before those of an episode."""
        return sum(episode.length for episode in self.episodes[:index])

    def differences(self, other: Export) -> list[str]:
        """In what another export differs, one phrase each: `size: [8, 8], was [4, 4]`."""
        ours, theirs = self._choices(), other._choices()
        differing = [
            f"{name}: {now}, was {theirs[name]}"
            for name, now in ours.items()
            if now != theirs[name]
        ]
        if self.episodes != other.episodes:
            now, then = ({e.file: e for e in export.episodes} for export in (self, other))
            counts = {
                "added": len(now.keys() - then.keys()),
                "removed": len(then.keys() - now.keys()),
                "changed": sum(now[file] != then[file] for file in now.keys() & then.keys()),
            }
            parts = [f"{count} {what}" for what, count in counts.items() if count]
            differing.append(f"episodes: {', '.join(parts)}")
        return differing

    def _choices(self) -> dict[str, Any]:
        """Everything but the episodes, as it stands in the file."""
        document = json.loads(encode(self, SCHEMA))
        return document["options"] | {
            name: document[name] for name in ("suite_version", "versions")
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
            DataError: The folder holds another export or something else.
        """
        if self.description.exists():
            before = read(self.description, Export, SCHEMA)
            if differences := export.differences(before):
                raise DataError(
                    f"{self.path} holds another export; this one differs in "
                    f"{'; '.join(differences)}. Export into another folder, or delete this one."
                )
            remove_temporary(self.path)
            return
        files = [path for path in self.path.rglob("*") if not path.is_dir()]
        if not all(path.match(f".*{TEMPORARY_SUFFIX}") for path in files):
            raise DataError(
                f"{self.path} is not empty and holds no export; export into another folder."
            )
        write(self.description, encode(export, SCHEMA))

    def read_facts(self, index: int) -> EpisodeFacts:
        """What was noted about a finished episode.

        Raises:
            DataError: It cannot be read.
        """
        try:
            return read(self.facts(index), EpisodeFacts, SCHEMA)
        except FileError as error:
            raise FileError(f"{error} Delete the file and export again.") from error


def location(index: int) -> tuple[int, int]:
    """Number of an episode's folder, and of its file in it."""
    return divmod(index, CHUNK_SIZE)


def _numbered(index: int) -> str:
    chunk, file = location(index)
    return f"chunk-{chunk:03d}/file-{file:03d}"
