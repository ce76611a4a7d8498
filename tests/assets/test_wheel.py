"""The data wheel, fetched by a real pip from a real index on this machine."""

import functools
import os
import subprocess
import sys
import threading
import venv
import zipfile
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path, PurePosixPath

import pytest

from duobench.assets import wheel
from duobench.assets.manifest import Wheel
from duobench.assets.progress import silent
from duobench.errors import AssetError

TINY = Wheel(name="tiny-meshes", version="1.2", size=1000)
MEMBERS = [PurePosixPath("tiny/one.obj"), PurePosixPath("tiny/missing.obj")]


class Quiet(SimpleHTTPRequestHandler):
    """A file server that writes no log."""

    def log_message(self, *_args: object) -> None:
        """Write nothing."""


@pytest.fixture
def index(sealed, tmp_path, monkeypatch):
    """A package index that holds one small wheel; yields the folder that is served."""
    del sealed
    served = tmp_path / "served"
    page = served / "simple" / TINY.name
    page.mkdir(parents=True)
    name = f"tiny_meshes-{TINY.version}-py3-none-any.whl"
    with zipfile.ZipFile(page / name, "w") as archive:
        info = f"tiny_meshes-{TINY.version}.dist-info"
        archive.writestr("tiny/one.obj", b"mesh")
        archive.writestr("tiny/other.obj", b"not wanted")
        needs = "Requires-Dist: a-package-that-is-nowhere"
        archive.writestr(
            f"{info}/METADATA",
            f"Metadata-Version: 2.1\nName: {TINY.name}\nVersion: {TINY.version}\n{needs}\n",
        )
        tags = "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        archive.writestr(f"{info}/WHEEL", tags)
        archive.writestr(f"{info}/RECORD", "")
    (page / "index.html").write_text(f'<a href="{name}">{name}</a>')
    handler = functools.partial(Quiet, directory=str(served))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        monkeypatch.setenv("PIP_INDEX_URL", f"http://127.0.0.1:{server.server_port}/simple")
        monkeypatch.setenv("PIP_NO_CACHE_DIR", "1")
        yield page
        server.shutdown()
        thread.join()


@pytest.mark.usefixtures("index")
def test_the_wanted_files_are_unpacked_without_dependencies():
    reports = []
    with wheel.unpacked(TINY, MEMBERS, lambda *report: reports.append(report)) as root:
        files = [path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file()]
        assert files == ["tiny/one.obj"]
        assert (root / "tiny/one.obj").read_bytes() == b"mesh"
    assert not root.exists()
    assert reports[0] == ("tiny-meshes==1.2", 0, TINY.size)
    assert reports[-1] == ("tiny-meshes==1.2", TINY.size, TINY.size)


@pytest.mark.usefixtures("index")
def test_a_python_without_pip_borrows_one(tmp_path, monkeypatch):
    venv.create(tmp_path / "bare", with_pip=False)
    folder = tmp_path / "bare" / ("Scripts" if os.name == "nt" else "bin")
    bare = str(folder / Path(sys.executable).name)
    assert subprocess.run([bare, "-m", "pip"], capture_output=True, check=False).returncode
    monkeypatch.setattr(wheel.sys, "executable", bare)
    with wheel.unpacked(TINY, MEMBERS, silent) as root:
        assert (root / "tiny/one.obj").read_bytes() == b"mesh"


@pytest.mark.usefixtures("index")
def test_another_version_is_an_error_with_the_words_of_pip():
    missing = Wheel(name=TINY.name, version="9.9", size=1)
    with (
        pytest.raises(AssetError, match=r"pip failed: .*tiny-meshes==9\.9"),
        wheel.unpacked(missing, MEMBERS, silent),
    ):
        pass


def test_a_broken_archive_is_an_error(index):
    (archive,) = index.glob("*.whl")
    # The directory at the end stays readable, so pip takes the wheel; a file inside is damaged.
    archive.write_bytes(archive.read_bytes().replace(b"mesh", b"mush", 1))
    with (
        pytest.raises(AssetError, match="cannot be unpacked"),
        wheel.unpacked(TINY, MEMBERS, silent),
    ):
        pass
