"""The recipe of the page hosting: a policy in a namespace of its own, which finds no way out."""

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import duobench
from duobench.policy import HoldPolicy
from duobench.results.bundle import read_source
from duobench.results.salt import make_salt, read_salt
from tests.docs.markdown import blocks, page_of

HERE, ABROAD = "DUOBENCH_TEST_HERE", ("1.1.1.1", 53)
PROBE = f"dt{os.getpid()}"
"""Part of the names of namespaces, so that two runs of this do not meet."""


def may_make_namespaces() -> bool:
    if os.geteuid() != 0 or not all(map(shutil.which, ("ip", "setpriv", "bash"))):
        return False
    made = subprocess.run(["ip", "netns", "add", PROBE], check=False, capture_output=True)
    subprocess.run(["ip", "netns", "del", PROBE], check=False, capture_output=True)
    readable = ["setpriv", "--reuid=nobody", "--regid=nogroup", "--clear-groups", sys.executable]
    started = subprocess.run(
        [*readable, "-c", "import duobench.policy, tests"],
        check=False,
        capture_output=True,
        env={"PYTHONPATH": os.pathsep.join(paths())},
    )
    return made.returncode == started.returncode == 0


def paths() -> list[str]:
    return [str(Path(duobench.__file__).parents[1]), str(Path(__file__).parents[2])]


def can_connect(address: tuple[str, int]) -> bool:
    try:
        socket.create_connection(address, timeout=2).close()
    except OSError:
        return False
    return True


class Escapes(HoldPolicy):
    """Holds, and fails if it finds anything that it should not."""

    def reset(self, instruction: str, seed: int) -> None:
        super().reset(instruction, seed)
        host, port, folder = os.environ[HERE].split(",")
        ways = {(host, int(port)), ("127.0.0.1", int(port)), ("10.99.0.1", int(port)), ABROAD}
        found = [str(way) for way in ways if can_connect(way)]
        for name in ("round.salt", "runs"):
            path = Path(folder, name)
            if os.access(path, os.R_OK):
                found.append(name)
        if found or os.geteuid() == 0:
            raise RuntimeError(f"user {os.geteuid()} reached {found}")


@pytest.fixture
def listener() -> Iterator[tuple[str, int]]:
    """A service of this machine, at an address that others reach."""
    with socket.create_server(("0.0.0.0", 0)) as server:
        threading.Thread(target=accept, args=(server,), daemon=True).start()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as route:
            try:
                route.connect(ABROAD)
                host = route.getsockname()[0]
            except OSError:  # a machine without a network
                host = "127.0.0.1"
        yield host, server.getsockname()[1]


def accept(server: socket.socket) -> None:
    try:
        while True:
            server.accept()[0].close()
    except OSError:
        return


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder into which another user may come, unlike those of pytest."""
    made = Path(tempfile.mkdtemp(prefix="duobench-"))
    made.chmod(0o755)
    yield made
    shutil.rmtree(made)


@pytest.mark.slow
def test_policy_in_a_namespace_finds_no_way_out(folder, listener):
    if not may_make_namespaces():
        pytest.skip("This needs root, iproute2, setpriv, and a checkout that everybody may read.")
    assert can_connect(listener)  # from here
    make_salt(folder / "round.salt")
    (program,) = blocks(page_of("hosting"), "bash")
    for written, here in (
        ("duo-", f"{PROBE}-"),
        ("their_policy:Policy", f"{__name__}:Escapes"),
        ("duobench serve", f"{sys.executable} -m duobench serve"),
        ("duobench eval", f"{sys.executable} -m duobench eval"),
        ("--suite paper", "--tasks bin_sort --episodes 2 --videos 0"),
    ):
        assert written in program
        program = program.replace(written, here)
    told = {HERE: ",".join(map(str, (*listener, folder)))}
    result = subprocess.run(
        ["bash", "-c", program],
        cwd=folder,
        env={**os.environ, **told, "PYTHONPATH": os.pathsep.join(paths())},
        check=False,
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    run, records = read_source(folder / "runs" / "theirs")
    assert run.suite.salt == read_salt(folder / "round.salt").sha256
    assert [record.error for record in records] == [None, None]
    left = subprocess.run(["ip", "netns", "list"], check=True, capture_output=True, text=True)
    assert PROBE not in left.stdout
