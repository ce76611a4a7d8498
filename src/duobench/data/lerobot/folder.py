"""Folder of an export: paths of its files, description of the export, and its features.

Features are named as LeRobot, Hugging Face and Arrow name them.
"""

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Self

import pyarrow as pa

from duobench.core.codecs import HEVC12
from duobench.core.errors import OtherRunError
from duobench.core.files import (
    begin_or_continue,
    differences,
    read,
    remove_temporary,
)
from duobench.core.lerobot_keys import (
    ACTION,
    DOMAIN,
    DOMAINS,
    IMAGE_PREFIX,
    OBJECT_STATE,
    RECORDING,
    RECORDING_ROW,
    STATE,
)
from duobench.data.lerobot import depth
from duobench.data.lerobot.options import ExportOptions, Format
from duobench.data.schema import Domain
from duobench.data.used_rows import Reason, UsedRows
from duobench.envs import state_labels
from duobench.envs.action_labels import LABELS
from duobench.world.robot.camera_geometry import named

SCHEMA = 5
"""Version of `Export` and `EpisodeFacts`."""
CHUNK_SIZE = 1000
"""Files in one folder; fixed by the format's default."""
POSE = "table_from_camera."
"""Prefix of the columns of poses of cameras that move, in the table frame: (4, 4), row by row."""
_CELLS = tuple(f"{row}{column}" for row in range(4) for column in range(4))
Vectors = Mapping[str, Sequence[str]]
"""Names of the numbers of each column that holds several in a row, by the name of the column."""
_SCALARS = {
    "next.reward": "float32",
    "next.done": "bool",
    "next.success": "bool",
    "stage": "int64",
    DOMAIN: "int64",
    RECORDING_ROW: "int64",
    # LeRobot's own, in its order:
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
"""Columns of one number a row. Only names that begin with `observation` or `action` reach a
policy, so that the others are free to add."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SourceEpisode:
    """An episode that is exported."""

    file: str
    """Its file, from the folder of its data set."""
    sha256: str
    length: int
    """Number of its rows in the export."""
    instruction: str
    rows: UsedRows
    """Rows of the recording that are exported."""
    data_set: int = 0
    """Number of its data set, in the order in which they were given."""
    domain: Domain = Domain.SIM
    split: str | None = None
    """Split that its layout was sampled for; None if that was given."""
    look: str | None = None
    """Its look, where each rendered episode has its own; else that of the options."""

    @property
    def origin(self) -> dict[str, str]:
        """Columns of the table of episodes that say which recording it is."""
        return {RECORDING: self.file, f"{RECORDING}_sha256": self.sha256}


@dataclass(frozen=True, kw_only=True, slots=True)
class Export:
    """Everything that determines the exported files."""

    options: ExportOptions
    suite_version: str
    versions: dict[str, str]
    """Versions of the packages that the images depend on."""
    episodes: tuple[SourceEpisode, ...]
    """Episodes in the order of the export."""
    failures: int = 0
    """Kept episodes that people led without success, which are left out."""
    object_state_names: tuple[str, ...] = ()
    """Names of the numbers of the object state; none where it is not exported."""
    cameras: dict[str, Any] = field(default_factory=dict)
    robot: str = ""
    """Gripper and mount that are not the paper's; empty where both are."""
    domains: tuple[str, ...] = DOMAINS
    """Meaning of the numbers 0, 1 of the column `domain`."""

    @property
    def vectors(self) -> dict[str, tuple[str, ...]]:
        """Names of the numbers of each column that holds several in a row."""
        vectors = {
            STATE: state_labels.names_of(self.options.state),
            ACTION: LABELS[self.options.action].names,
        }
        objects = (
            {OBJECT_STATE: self.object_state_names} if self.object_state_names else {}
        )
        seen = map(named, self.options.seen if self.options.geometry else ())
        poses = {
            f"{POSE}{camera.name}": _CELLS for camera in seen if camera.arm is not None
        }
        return vectors | objects | poses

    @property
    def tasks(self) -> list[str]:
        """Each instruction once, in order of appearance: what LeRobot calls a task."""
        return list(dict.fromkeys(episode.instruction for episode in self.episodes))

    @property
    def frames(self) -> int:
        """Rows of all episodes together."""
        return self.first_row(len(self.episodes))

    @property
    def recordings(self) -> int:
        """Recordings of which rows are exported."""
        return len({(episode.data_set, episode.file) for episode in self.episodes})

    @property
    def left_out(self) -> dict[Reason, int]:
        """How many rows of the recordings are left out, for each reason."""
        counts = Counter[Reason]()
        for episode in self.episodes:
            counts.update(episode.rows.left_out)
        return dict(counts)

    def first_row(self, index: int) -> int:
        """Rows of the export before those of an episode."""
        return sum(episode.length for episode in self.episodes[:index])

    def differences(self, other: Self) -> list[str]:
        """Differences from another export, one phrase each: `look dark instead of default`."""
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
class Residual:
    """Distance of the tools at solved joint targets from the given tool poses.

    Distances are in metres, angles in radians.
    """

    targets: int = 0
    """Number of solved poses, two a row."""
    sum_position: float = 0.0
    sum_rotation: float = 0.0
    max_position: float = 0.0
    max_rotation: float = 0.0

    def __add__(self, other: "Residual") -> "Residual":
        return Residual(
            targets=self.targets + other.targets,
            sum_position=self.sum_position + other.sum_position,
            sum_rotation=self.sum_rotation + other.sum_rotation,
            max_position=max(self.max_position, other.max_position),
            max_rotation=max(self.max_rotation, other.max_rotation),
        )

    def __str__(self) -> str:
        """Format as part of a sentence: means and largest values in millimetres and radians."""
        count = max(1, self.targets)
        return (
            f"mean {1000 * self.sum_position / count:.3f} mm and "
            f"{self.sum_rotation / count:.5f} rad, at most {1000 * self.max_position:.3f} mm and "
            f"{self.max_rotation:.5f} rad"
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeFacts:
    """Facts about a finished episode, beside its files."""

    counts: dict[str, list[list[int]]]
    """Histograms of the values of each channel (3, 256), by camera; of codes of depth (1, 4096)."""
    residual: Residual | None
    sizes: dict[str, int] = field(default_factory=dict[str, int])
    """Bytes of each of its files, by its name from the folder of the export."""
    cameras: dict[str, dict[str, Any]] = field(default_factory=dict)
    """The `matrix` of each camera, and `table_from_camera`: a pose, or the column of it."""


@dataclass(frozen=True, slots=True)
class ExportFolder:
    """Names in the folder of an export."""

    path: Path
    format: Format = Format.V30

    @property
    def meta(self) -> Path:
        """Folder of everything that describes the data set."""
        return self.path / "meta"

    def facts(self, index: int) -> Path:
        """Facts about a finished episode."""
        return self.meta / "duobench" / f"{index:06d}.json"

    def data(self, index: int) -> Path:
        """Numbers of an episode."""
        return self.path / self.format.paths[0].format(**_numbers(index))

    def video(self, name: str, index: int) -> Path:
        """Images of an episode by a camera, or their depth."""
        key = image_key(name)
        return self.path / self.format.paths[1].format(video_key=key, **_numbers(index))

    def sizes(self, index: int, videos: Iterable[str]) -> dict[str, int]:
        """Bytes of each file of an episode that is there, by its name."""
        paths = (self.data(index), *(self.video(name, index) for name in videos))
        return {
            path.relative_to(self.path).as_posix(): path.stat().st_size
            for path in paths
            if path.exists()
        }

    def is_finished(self, index: int, videos: Iterable[str]) -> bool:
        """Whether every file of an episode is there, and whole."""
        is_noted = self.facts(index).exists()
        return is_noted and self.read_facts(index).sizes == self.sizes(index, videos)

    def begin(self, export: Export) -> None:
        """Begin an export in this folder, or continue the one that is there."""
        ours = self.meta / "duobench.json"  # unknown to LeRobot
        advice = "Export into another folder."
        begin_or_continue(
            self.path,
            ours,
            export,
            SCHEMA,
            what="export",
            advice=advice,
        )
        remove_temporary(self.path)
        numbers = range(len(export.episodes))
        videos = export.options.videos
        known = {self.video(name, index) for name in videos for index in numbers}
        known |= {
            each for index in numbers for each in (self.data(index), self.facts(index))
        }
        there = {
            path
            for pattern in ("data/**/*", "videos/**/*", "meta/duobench/*")
            for path in self.path.glob(pattern)
            if path.is_file()
        }
        surplus = sorted(there - known)
        if surplus:
            raise OtherRunError(
                f"{surplus[0]} is of no episode of this export, which has {len(numbers)}, and "
                f"readers would take it for one; files too many: {len(surplus)}. Remove them."
            )

    def read_facts(self, index: int) -> EpisodeFacts:
        """Facts that were noted about a finished episode."""
        advice = "Delete the file and export again."
        return read(
            self.facts(index),
            EpisodeFacts,
            SCHEMA,
            advice=advice,
        )


def _numbers(index: int) -> dict[str, int]:
    """Numbers in the paths of an episode's files, in every format."""
    chunk, file = divmod(index, CHUNK_SIZE)
    named = {"chunk_index": chunk, "file_index": file}
    return named | {"episode_chunk": chunk, "episode_index": index}


def as_json(document: object) -> str:
    """The text of a file in `meta`, as LeRobot writes it."""
    return (
        json.dumps(
            document,
            indent=4,
            ensure_ascii=False,
            allow_nan=False,
        )
        + "\n"
    )


def columns(vectors: Vectors) -> tuple[str, ...]:
    """Names of all columns of the Parquet files, in order."""
    return *vectors, *_SCALARS


def image_key(name: str) -> str:
    """Name of a camera's images, or of their depth."""
    return f"{IMAGE_PREFIX}{name}"


def describe(
    export: Export, cameras: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """All features, as `meta/info.json` lists them; `cameras` are those of `EpisodeFacts`."""
    numbers = {
        column: {"dtype": "float32", "shape": [len(names)], "names": list(names)}
        for column, names in export.vectors.items()
    }
    images = {}
    for name, size in export.options.videos.items():
        camera = export.options.depth_of.get(name)
        about = _describe_video(size, export.options)
        about |= {} if camera is None else _DEPTH
        images[image_key(name)] = {
            "dtype": "video",
            "shape": [*size, about["video.channels"]],
            "names": ["height", "width", "channels"],
            "info": {**about, **cameras.get(camera or name, {})},
        }
    scalars = {
        name: {"dtype": dtype, "shape": [1], "names": None}
        for name, dtype in _SCALARS.items()
    }
    return numbers | images | scalars


def _describe_video(size: tuple[int, int], options: ExportOptions) -> dict[str, Any]:
    """Entry of `meta/info.json` about a video, under the keys that LeRobot's own writer uses."""
    encoding = options.codec.encoding
    preset = encoding.options["preset"]
    return {
        "video.height": size[0],
        "video.width": size[1],
        "video.codec": options.codec,
        "video.pix_fmt": encoding.pixel_format,
        "video.fps": options.fps,
        "video.channels": 3,
        "has_audio": False,
        "video.g": int(encoding.options["g"]),
        "video.crf": int(encoding.options["crf"]),
        "video.preset": int(preset) if preset.isdigit() else preset,
        "video.fast_decode": 0,
        "video.video_backend": "pyav",
        "video.extra_options": {},
        "is_depth_map": False,
    }


_DEPTH: dict[str, Any] = {
    "video.codec": "hevc",
    "video.pix_fmt": HEVC12.pixel_format,
    "video.channels": 1,
    "video.crf": None,
    "video.preset": HEVC12.options["preset"],
    "video.extra_options": {"x265-params": "lossless=1"},
    **depth.INFO,
}
"""What is other about a video of depth."""


def schema(vectors: Vectors, version: Format = Format.V30) -> pa.Schema:
    """The Arrow schema of the Parquet files, with the types that Hugging Face reads.

    Those who read v2.1 have `datasets` 3 or older, which know no type `List`.
    """
    row = "Sequence" if version is Format.V21 else "List"
    fields = [
        pa.field(name, pa.list_(pa.float32(), len(n))) for name, n in vectors.items()
    ]
    fields += [
        pa.field(name, pa.from_numpy_dtype(dtype)) for name, dtype in _SCALARS.items()
    ]
    number = {"dtype": "float32", "_type": "Value"}
    types: dict[str, Any] = {
        name: {"feature": number, "length": len(names), "_type": row}
        for name, names in vectors.items()
    }
    types |= {
        name: {"dtype": dtype, "_type": "Value"} for name, dtype in _SCALARS.items()
    }
    return pa.schema(
        fields, metadata={"huggingface": json.dumps({"info": {"features": types}})}
    )
