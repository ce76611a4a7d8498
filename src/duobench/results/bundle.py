"""A bundle: a run and its records in one file for publication, without videos and timing.

It is a ZIP archive. Its first part, the manifest, has the SHA-256 of every other one. Dates and
order are fixed: the same run gives the same bytes, with one version of zlib, which compresses them.
A bundle comes from strangers: nothing of it is unpacked to a disk, and everything has a bound.
"""

import hashlib
import io
import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from duobench.core.errors import EvaluationError, FileError, OutputError
from duobench.core.files import (
    check_outside,
    decode,
    encode,
    write,
    zipped,
)
from duobench.results.folder import (
    DESCRIPTION,
    RunFolder,
    RunReader,
    record_name,
)
from duobench.results.records import Record
from duobench.results.run import Run

BUNDLE_SUFFIX = ".duobench.zip"
BUNDLE_SCHEMA = 3
MAX_PARTS = 65_000
"""Most parts of a bundle: more than that is another kind of archive."""
MAX_PART_BYTES = 16 * 2**20
"""Largest part, unpacked; a record of a thousand steps has a few hundredths of it."""
MAX_BYTES = 512 * 2**20
"""Largest bundle, packed and unpacked; eleven tasks with a hundred episodes have a tenth of it."""

_MANIFEST = "manifest.json"
_NAMES = re.compile(
    rf"{_MANIFEST}|{DESCRIPTION}|records/\w[\w.-]*/[\w-][\w.-]*/[0-9]{{5,16}}\.json"
)
_ENTRY = b"PK\x01\x02"  # what each entry of an archive's list of contents begins with
_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    NotImplementedError,
    OSError,
    RuntimeError,
    ValueError,
)
"""Errors of the libraries about a file that is no archive."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Manifest:
    """Content of a bundle."""

    CHECKED_FROM: ClassVar[int] = BUNDLE_SCHEMA
    missing: int
    """Episodes of the run that have no record; 0 for a finished run."""
    commands: tuple[str, ...]
    """The commands that played it; none where that is not known."""
    attempts: dict[str, tuple[str, ...]]
    """Ends of the attempts at each episode, see `RunReader.attempts`."""
    parts: dict[str, str]
    """SHA-256 of each other part, by its name."""


def write_bundle(run: RunReader, path: Path) -> Manifest:
    """Write a run, finished or not, and its records into one file; an earlier one is replaced.

    Raises:
        EvaluationError: If there is no run, a record of another one, or too many of them.
        OutputError: If the file is something else than an archive.
    """
    check_outside(path, run.path)
    if path.exists() and not _is_bundle(path):
        raise OutputError(
            f"{path} is there and is no bundle; delete it, or give the bundle another name."
        )
    description = run.read_run()
    records = run.read_records(description)
    names = [DESCRIPTION, *(record_name(record.key) for record in records)]
    parts = {name: run.file(name).read_bytes() for name in names}
    if len(parts) >= MAX_PARTS or sum(map(len, parts.values())) > MAX_BYTES // 2:
        raise EvaluationError(
            f"{run.path} is too large for a bundle, which has at most {MAX_PARTS} parts of "
            f"{MAX_BYTES // 2} bytes altogether; evaluate fewer episodes in a run."
        )
    manifest = Manifest(
        missing=description.size - len(records),
        commands=tuple(run.commands()),
        attempts=dict(sorted(run.attempts().items())),
        parts={
            name: hashlib.sha256(content).hexdigest() for name, content in parts.items()
        },
    )
    parts = {_MANIFEST: encode(manifest, BUNDLE_SCHEMA).encode(), **parts}
    write(path, zipped(parts, zipfile.ZIP_DEFLATED))
    return manifest


def _is_bundle(path: Path) -> bool:
    """Whether a file is an archive with a bundle's first parts."""
    try:
        with zipfile.ZipFile(path) as archive:
            return {_MANIFEST, DESCRIPTION} <= set(archive.namelist())
    except _DAMAGE:
        return False


def open_source(path: Path) -> RunReader:
    """Reader of a run and its records: its folder, or a bundle, which is checked."""
    return Bundle(path) if path.is_file() else RunFolder(path)


def read_source(path: Path) -> tuple[Run, list[Record]]:
    """A run and its records, finished or not; see `open_source`."""
    source = open_source(path)
    run = source.read_run()
    return run, source.read_records(run)


class Bundle(RunReader):
    """A bundle that was found to be whole."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        try:
            self._parts = _unpacked(path)
            self.manifest = _manifest(self._parts)
            self._check_run()
        except FileError as error:
            raise FileError(f"{path} is no whole bundle: {error}") from error

    def file(self, name: str) -> "_BundleFile":
        """A part by its name, whether or not there is one."""
        return _BundleFile(f"{self.path}: {name}", self._parts.get(name))

    def names(self) -> Iterable[str]:
        """Names of all records."""
        return [name for name in self._parts if name != DESCRIPTION]

    def commands(self) -> list[str]:
        """The commands that its manifest names."""
        return list(self.manifest.commands)

    def attempts(self) -> dict[str, tuple[str, ...]]:
        """Ends of the attempts at each episode, from its manifest."""
        return self.manifest.attempts

    def _check_run(self) -> None:
        """Check that it holds the records of its run, and none beside them."""
        run = self.read_run()
        try:
            records = self.finished(run)
        except EvaluationError as error:
            raise FileError(str(error)) from error
        if self.manifest.missing != run.size - len(records):
            raise FileError(
                f"Its manifest says that {self.manifest.missing} records are missing, not "
                f"{run.size - len(records)}."
            )


@dataclass(frozen=True, slots=True)
class _BundleFile:
    """A part that is read as a file is."""

    place: str
    content: bytes | None

    def __str__(self) -> str:
        return self.place

    def read_bytes(self) -> bytes:
        if self.content is None:
            raise FileError("It is missing.")
        return self.content


def _manifest(parts: dict[str, bytes]) -> Manifest:
    """Take the manifest out of the parts, and compare these with it."""
    if not {_MANIFEST, DESCRIPTION} <= parts.keys():
        raise FileError(f"It has no {_MANIFEST} or no {DESCRIPTION}.")
    manifest = decode(parts.pop(_MANIFEST), Manifest, BUNDLE_SCHEMA)
    different = parts.keys() ^ manifest.parts.keys()
    if different:
        raise FileError(f"{min(different)} is in its manifest or in it, not in both.")
    for name, content in parts.items():
        if hashlib.sha256(content).hexdigest() != manifest.parts[name]:
            raise FileError(f"The SHA-256 of {name} is not that of its manifest.")
    return manifest


def _unpacked(path: Path) -> dict[str, bytes]:
    """The parts of an archive by their names, within the bounds of this module."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise FileError(f"It is larger than {MAX_BYTES} bytes.")
        data = path.read_bytes()
        if (
            data.count(_ENTRY) > MAX_PARTS
        ):  # before they are listed, which takes memory for each
            raise FileError(f"It has more than {MAX_PARTS} parts.")
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            # Folders, which other tools put in when they pack it again, hold nothing.
            entries = [
                each
                for each in archive.infolist()
                if each.file_size or not each.is_dir()
            ]
            _check_entries(entries)
            return {entry.filename: _content(archive, entry) for entry in entries}
    except _DAMAGE as error:
        raise FileError(f"It is damaged, or no ZIP archive: {error}.") from error


def _check_entries(entries: Iterable[zipfile.ZipInfo]) -> None:
    names: set[str] = set()
    size = 0
    for entry in entries:
        name, mode = entry.orig_filename, entry.external_attr >> 16
        size += entry.file_size
        problems = {
            f"No bundle has a part {name[:100]!r}.": not _NAMES.fullmatch(name),
            f"It has {name} twice.": name in names,
            f"{name} is a link, or something else that is no file.": stat.S_IFMT(mode)
            not in {0, stat.S_IFREG},
            f"{name} has more than {MAX_PART_BYTES} bytes.": entry.file_size
            > MAX_PART_BYTES,
            f"Its parts have more than {MAX_BYTES} bytes.": size > MAX_BYTES,
            f"{name} is compressed in another way than a bundle's parts are.": entry.compress_type
            not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED),
        }
        for problem, is_there in problems.items():
            if is_there:
                raise FileError(problem)
        names.add(name)


def _content(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> bytes:
    """The bytes of a part, which may unpack to more than its entry says."""
    with archive.open(entry) as file:
        content = file.read(entry.file_size + 1)
    if len(content) != entry.file_size:
        raise FileError(f"{entry.filename} does not have as many bytes as it says.")
    return content
