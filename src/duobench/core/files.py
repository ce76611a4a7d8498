"""Files of a run: whole or absent after a kill, and checked when they are read."""

from __future__ import annotations

import codecs
import errno
import fcntl
import hashlib
import io
import json
import math
import os
import re
import shutil
import stat
import time
import zipfile
from collections.abc import (
    Callable,
    Collection,
    Iterator,
    Mapping,
)
from contextlib import contextmanager, suppress
from dataclasses import fields
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Any,
    Protocol,
    Self,
    TypeVar,
)

import msgspec

from duobench.core.errors import (
    DuoBenchError,
    FileError,
    GoneError,
    LockedError,
    OtherRunError,
    OutputError,
)

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    class Described(DataclassInstance, Protocol):
        """Description of a folder's content, which can list its differences from another one."""

        def differences(self, other: Self) -> list[str]: ...  # noqa: D102


T = TypeVar("T", bound="DataclassInstance")


class Readable(Protocol):
    """A file, or what stands for one; its text names it."""

    def read_bytes(self) -> bytes: ...  # noqa: D102


CHECKSUM = "sha256"
TEMPORARY_SUFFIX = ".tmp"
"""Ending of a file that is being written; what still has it after a crash is rubbish."""

SCRATCH = ".duobench-"
"""Prefix of folders for temporary files, which may have to lie in an output."""

_ZIP_DATE, _ZIP_UNIX, _ZIP_MODE = (1980, 1, 1, 0, 0, 0), 3, stat.S_IFREG | 0o644
LOG_WAIT_S = 5.0
"""Seconds that a writer of a log waits for another one."""
_LOCK_TURN_S = 0.05
"""Seconds from one look at a lock that another process holds to the next."""
_GONE = (errno.ENOENT, errno.ENOTDIR, errno.ESTALE)
"""Errors where a folder is not there."""
_BROKEN = (errno.EIO, errno.ENODEV, errno.ENXIO)
"""Errors of a disk, which may have lost other files too."""
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP)
"""Error numbers of file systems without locks; work there goes on unprotected."""


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Say in a sentence why a file or folder cannot be written."""
    try:
        yield
    except OSError as error:
        if error.errno in _GONE:
            parents = reversed(path.absolute().parents)
            missing = next((each for each in parents if not each.is_dir()), path)
            text = f"Cannot write {path}: there is no folder {missing}."
            raise GoneError(text) from error
        kept = "" if error.errno in _BROKEN else " Nothing finished is lost."
        raise OutputError(
            f"Cannot write {path}: {error.strerror or error}.{kept}"
        ) from error


def check_there(folder: Path) -> None:
    """Reject a folder that was removed while it was written into."""
    if not folder.is_dir():
        raise GoneError(
            f"{folder} was removed while it was written into, with all that it held."
        )


def make_folder(path: Path) -> None:
    """Make a folder to write into, with its parents; one that is there is taken."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = (
            "it is a file" if isinstance(error, FileExistsError) else error.strerror
        )
    else:
        reason = (
            None
            if os.access(path, os.W_OK | os.X_OK)
            else "nothing may be written into it"
        )
    if reason:
        raise OutputError(f"{path} cannot be the folder of the output: {reason}.")


def files_in(folder: Path, pattern: str = "**/*") -> Iterator[Path]:
    """Files anywhere in a folder, but for those that lie there for a while."""
    for path in folder.glob(pattern):
        if not path.is_dir() and not path.relative_to(folder).parts[0].startswith(
            SCRATCH
        ):
            yield path


@contextmanager
def taken_back(
    folder: Path, *beginnings: str, is_begun: Callable[[], bool] = lambda: False
) -> Iterator[None]:
    """Remove a new folder again if the block fails before it has written results.

    Args:
        folder: The folder, which is new if it does not exist yet, or is empty.
        beginnings: Patterns of files that are no results, unless `is_begun`.
        is_begun: Whether files of these patterns are to be kept too.
    """
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    is_new = bool(missing) or (folder.is_dir() and not any(folder.iterdir()))
    try:
        yield
    except BaseException:
        files = [path for path in folder.rglob("*") if not path.is_dir()]
        if (
            is_new
            and all(any(map(path.match, beginnings)) for path in files)
            and not is_begun()
        ):
            for path in folder.glob("*"):
                if path.is_dir():
                    shutil.rmtree(path)
                else:
                    path.unlink()
            with suppress(OSError):  # another process has written there
                for each in missing:
                    each.rmdir()
        raise


def check_outside(out: Path, *sources: Path) -> None:
    """Reject an output in one of the folders that it is made from, symbolic links resolved."""
    for source in sources:
        if out.resolve().is_relative_to(source.resolve()):
            raise OutputError(
                f"{out} is in {source}, which is read; write to another place."
            )


@contextmanager
def locked(folder: Path, *, wait_s: float = 0.0) -> Iterator[None]:
    """Keep a second writer out of a folder, which is made; a killed one leaves nothing locked."""
    make_folder(folder)
    with held(folder, wait_s=wait_s):
        yield


@contextmanager
def held(path: Path, *, wait_s: float = 0.0) -> Iterator[None]:
    """Hold the lock of a file or a folder that is there while a block lasts; see `locked`."""
    handles = [os.open(path, os.O_RDONLY)]

    def release() -> None:
        while handles:
            os.close(handles.pop())

    # A child that a policy forks would keep the lock for as long as it lives.
    os.register_at_fork(after_in_child=release)
    try:
        lock(handles[0], path, wait_s=wait_s)
        yield
    finally:
        release()


def is_locked(path: Path) -> bool:
    """Whether a process holds the lock of a file or folder."""
    try:
        with held(path):
            return False
    except LockedError:
        return True


def lock(
    handle: int,
    path: Path,
    *,
    wait_s: float = 0.0,
) -> None:
    """Lock an open file or folder; the operating system drops the lock with the process."""
    until = time.monotonic() + wait_s
    while True:
        try:
            return fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            if time.monotonic() >= until:
                raise LockedError(
                    f"Another process is writing into {path}; wait until {_holder(handle)} is done."
                ) from error
            time.sleep(_LOCK_TURN_S)
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise
            return None


def _holder(handle: int) -> str:
    status = os.fstat(handle)
    device = f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}"
    with suppress(OSError):
        locks = Path("/proc/locks").read_text(encoding="utf-8")
        found = re.search(rf"FLOCK .* (\d+) {device}:{status.st_ino} ", locks)
        if found:
            return f"process {found[1]}"
    return "it"


def write(path: Path, content: str | bytes) -> None:
    """Write a file (text as UTF-8 with line feeds) in one atomic step; see `replacing`."""
    # A lone surrogate cannot be written; texts that may hold one are made printable before.
    data = content.encode(errors="replace") if isinstance(content, str) else content
    with replacing(path) as temporary:
        temporary.write_bytes(data)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Write a file in one atomic step, in a block that fills the one that it is given.

    That is flushed to the disk before it gets the name of the other one. Missing parent folders are
    made.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}{TEMPORARY_SUFFIX}")
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield temporary
            with temporary.open("rb") as file:
                os.fsync(file.fileno())
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


def append_line(
    path: Path,
    line: bytes,
    *,
    wait_s: float = LOG_WAIT_S,
) -> None:
    """Append a line to a log that other processes write too; it is on the disk when this returns.

    A missing log is made. Half a line that a killed process left stays a line of its own.

    Raises:
        OutputError: It cannot be written, or another process writes for longer than `wait_s`.
    """
    with writing(path), path.open("a+b", buffering=0) as file:
        lock(
            file.fileno(),
            path,
            wait_s=wait_s,
        )
        end = file.seek(0, os.SEEK_END)
        file.seek(max(0, end - 1))
        begin = b"" if file.read(1) in {b"", b"\n"} else b"\n"
        text = begin + line + b"\n"
        if file.write(text) != len(text):  # there is no room for the rest
            file.truncate(end)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.fsync(file.fileno())


def remove_temporary(folder: Path) -> None:
    """Remove what interrupted writers left anywhere under a folder."""
    remove(*folder.rglob(f".*{TEMPORARY_SUFFIX}"))


def remove(*paths: Path) -> None:
    """Remove files; missing ones are ignored."""
    for path in paths:
        with writing(path):
            path.unlink(missing_ok=True)


def remove_abandoned(folder: Path, suffix: str) -> None:
    """Remove what killed processes left of files with an ending, in the folders of a folder.

    Others may write into these at the same time, and all other files in them stay.
    """
    for path in folder.glob(f"*/.*{suffix}.*{TEMPORARY_SUFFIX}"):
        # A process of another user lives; a file without a process number is not ours.
        with suppress(PermissionError, OverflowError, ValueError):
            try:
                os.kill(int(path.suffixes[-2][1:]), 0)
            except ProcessLookupError:
                remove(path)


def zipped(parts: Mapping[str, bytes], method: int = zipfile.ZIP_STORED) -> bytes:
    """Parts by their names as a ZIP archive; the same parts always give the same bytes.

    What `zipfile.ZIP_DEFLATED` gives depends on the version of zlib as well.
    """
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in parts.items():
            entry = zipfile.ZipInfo(name, _ZIP_DATE)
            entry.create_system, entry.external_attr = _ZIP_UNIX, _ZIP_MODE << 16
            archive.writestr(
                entry,
                content,
                method,
                compresslevel=9,
            )
    return file.getvalue()


@contextmanager
def reading(what: object, error: type[DuoBenchError]) -> Iterator[None]:
    """Say in a sentence why a file that people write, or what it holds, cannot be read."""
    try:
        yield
    except (OSError, ValueError, RecursionError) as unread:
        is_deep = isinstance(unread, RecursionError)
        reason = (
            "it is nested too deeply" if is_deep else getattr(unread, "strerror", None)
        )
        reason = str(reason or unread).rstrip(".")
        raise error(f"Cannot read {what}: {reason}.") from unread


def read_text(path: Readable) -> str:
    """The text of a file that people write: UTF-8, with or without a byte order mark before it."""
    data = path.read_bytes()
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise ValueError("it is UTF-16, as its byte order mark says; save it as UTF-8")
    return data.decode("utf-8-sig")


def read_object(path: Path, error: type[DuoBenchError]) -> dict[str, Any] | None:
    """Read a JSON object from an untrusted file; None if the file is missing."""
    with reading(path, error):
        try:
            content = json.loads(path.read_bytes())
        except FileNotFoundError:
            return None
    if not isinstance(content, dict):
        raise error(
            f"Cannot read {path}: it holds a {type(content).__name__}, no object."
        )
    return content


def digest_of(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def checksum(document: Mapping[str, Any]) -> str:
    """SHA-256 of a JSON object but for its checksum; order of keys and spaces make no difference.

    It is that of the compact JSON text in ASCII with sorted keys.
    """
    content = {key: value for key, value in document.items() if key != CHECKSUM}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def encode(value: DataclassInstance, schema: int) -> str:
    """A data class as JSON text, one field a line; the same value always gives the same text.

    The text of a class with an attribute `CHECKED_FROM`, a number of a schema, holds a checksum
    from that schema on.
    """
    document = {"schema": schema, **msgspec.to_builtins(value)}
    if _is_checked(type(value), schema):
        document[CHECKSUM] = checksum(msgspec.json.decode(_text(document)))
    return _text(document)


def _text(document: Mapping[str, Any]) -> str:
    lines = [
        f'  "{key}": {json.dumps(part, ensure_ascii=False, allow_nan=False)}'
        for key, part in document.items()
    ]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _is_checked(kind: type, schema: int) -> bool:
    return schema >= getattr(kind, "CHECKED_FROM", math.inf)


def decode(
    text: bytes | str,
    kind: type[T],
    schema: int,
) -> T:
    """A data class from the text that `encode` gave.

    `schema` is the version of its fields, the one that is read.
    """
    try:
        return _decoded(text, kind, schema)
    except RecursionError as error:
        raise FileError("It is nested too deeply.") from error


def _decoded(
    text: bytes | str,
    kind: type[T],
    schema: int,
) -> T:
    try:
        document: Any = msgspec.json.decode(text)
    except (msgspec.MsgspecError, ValueError) as error:
        raise FileError(f"No JSON: {error}.") from error
    if not isinstance(document, dict):
        raise FileError(f"A JSON object is expected, not a {type(document).__name__}.")
    actual = document.pop("schema", None)
    if actual != schema or isinstance(actual, bool):
        raise FileError(f"Schema {actual!r}; this version reads {schema}.")
    is_checked = _is_checked(kind, schema)
    known = {field.name for field in fields(kind)} | (
        {CHECKSUM} if is_checked else set()
    )
    unknown = sorted(document.keys() - known)
    if unknown:
        raise FileError(f"Unknown fields: {', '.join(unknown)}.")
    try:
        value = msgspec.convert(
            document, kind
        )  # which leaves a key out that is no field
    except msgspec.ValidationError as error:
        raise FileError(f"{error}.".replace("`$.", "`")) from error
    except DuoBenchError as error:  # of a value that names what does not exist
        raise FileError(str(error)) from error
    if is_checked and document.get(CHECKSUM) != checksum(
        {"schema": schema, **document}
    ):
        raise FileError(
            "Its checksum does not fit: it was changed after it was written."
        )
    return value


def read(
    path: Readable,
    kind: type[T],
    schema: int,
    *,
    advice: str = "",
) -> T:
    """A data class from a file that `encode` filled."""
    try:
        return decode(path.read_bytes(), kind, schema)
    except (FileError, OSError) as error:
        reason = f"{error.strerror}." if isinstance(error, OSError) else error
        raise FileError(f"Cannot read {path}: {reason} {advice}".strip()) from error


def begin_or_continue(  # noqa: PLR0913 - most of them are words of the messages
    folder: Path,
    description: Path,
    value: Described,
    schema: int,
    *,
    what: str,
    advice: str = "",
    foreign: str = "**/*",
    kept: Collection[str] = (),
    is_final: bool = True,
) -> None:
    """Write what a folder is to hold, or check that it is what the folder holds already.

    Args:
        folder: The folder, which is made if it is missing.
        description: The file in it that says what it holds; one that is there is left as it is.
        value: What it is to hold.
        schema: Version of the value's class.
        what: What that is, for messages: "export".
        advice: A sentence that ends the message of an error.
        foreign: Pattern of files that may not be in the folder before it is described.
        kept: Names of files that may be in the folder all the same.
        is_final: Whether the folder must hold just that; if not, only the file has to be readable.
    """
    if not description.exists():
        make_folder(folder)
        ours = f".{description.name}.*{TEMPORARY_SUFFIX}"  # of one that was killed while it began
        others = files_in(folder, foreign)
        if all(path.match(ours) or path.name in kept for path in others):
            write(description, encode(value, schema))
            return
        if not description.exists():  # else another process has begun the same
            raise OtherRunError(
                f"{folder} is not empty and holds no {what}. {advice}".strip()
            )
    found = value.differences(read(description, type(value), schema))
    if found and is_final:
        raise OtherRunError(
            f"{folder} holds another {what}; this one has {'; '.join(found)}. {advice}".strip()
        )


def differences(now: Mapping[str, object], before: Mapping[str, object]) -> list[str]:
    """Differences from another description, one phrase each: `look dark instead of default`.

    Facts have their names in words; of mappings, such as files by name, only the numbers of entries
    that differ are said. What was not known before makes no difference.
    """
    return [
        f"{name} {_changes(fact, earlier)}"
        for name, fact in now.items()
        if fact != (earlier := before.get(name, fact))
    ]


def _changes(now: object, before: object) -> str:
    if not (isinstance(now, Mapping) and isinstance(before, Mapping)):
        return f"{_words(now)} instead of {_words(before)}"
    counts = {
        "added": len(now.keys() - before.keys()),
        "removed": len(before.keys() - now.keys()),
        "changed": sum(
            now[name] != before[name] for name in now.keys() & before.keys()
        ),
    }
    return ", ".join(f"{count} {what}" for what, count in counts.items() if count)


def _words(fact: object) -> object:
    """A fact as a user would write it: several words without brackets and quotes."""
    if isinstance(fact, (list, tuple)) and all(isinstance(word, str) for word in fact):
        return " ".join(fact) or "none"
    return fact
