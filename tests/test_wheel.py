"""The wheel as users get it: complete, and of use by itself, on a machine without a network."""

import json
import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

from duobench.world.robot.cameras import POLICY_CAMERAS
from tests.test_repository import ROOT, tracked

# Every process of the environment loads it, workers too. Processes on this machine may talk.
NO_NETWORK = """
import sys

def refuse(event, arguments):
    if event == "socket.connect":
        host = arguments[1][0] if isinstance(arguments[1], tuple) else "127.0.0.1"
    elif event in {"socket.getaddrinfo", "socket.gethostbyname"}:
        host = arguments[0]
    else:
        return
    if host not in {"127.0.0.1", "::1", "localhost"}:
        raise ConnectionError(f"there is no network: {event} {arguments}")

sys.addaudithook(refuse)
"""
USE = """
import json
import duobench

env = duobench.make("bin_sort", render_mode="rgb_array", image_size=32, render_size=(24, 32))
env.reset(seed=0)
observation, reward, *_ = env.step(env.action_space.sample())
image = env.render()
print(json.dumps({
    "package": duobench.__file__,
    "pixels": {name: list(pixels.shape) for name, pixels in observation["pixels"].items()},
    "dark": [name for name, pixels in observation["pixels"].items() if pixels.max() == 0],
    "image": list(image.shape),
    "stage": reward,
}))
env.close()
"""


class Installed:
    """An environment that holds the wheel and sees its dependencies, and a folder to work in."""

    def __init__(self, folder: Path, wheel: Path) -> None:
        self.work = folder / "work"
        self.home = folder / "home"
        self.work.mkdir()
        self.home.mkdir()
        self.site = folder / "venv"
        venv.create(self.site, with_pip=False, symlinks=True)
        pip = [sys.executable, "-m", "pip", "--python", str(self.bin / "python"), "--isolated"]
        install = ["install", "--no-deps", "--no-index", "--disable-pip-version-check"]
        subprocess.run([*pip, *install, str(wheel)], check=True, capture_output=True)
        (packages,) = self.site.glob("lib/python*/site-packages")
        # Files of this kind are not read in the folder that is named here, so that what is
        # installed there as editable, DuoBench itself, stays out of sight.
        (packages / "dependencies.pth").write_text(f"{sysconfig.get_path('purelib')}\n")
        (packages / "no_network.py").write_text(NO_NETWORK)
        (packages / "no_network.pth").write_text("import no_network")
        self.packages = packages

    @property
    def bin(self) -> Path:
        return self.site / "bin"

    def run(self, name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run a program of the environment, as a user with an empty home."""
        environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "XDG_"))}
        return subprocess.run(
            [self.bin / name, *arguments],
            cwd=self.work,
            env={**environment, "HOME": str(self.home)},
            check=False,
            capture_output=True,
            text=True,
        )

    def output(self, name: str, *arguments: str) -> str:
        result = self.run(name, *arguments)
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory, wheel: Path) -> Installed:
    return Installed(tmp_path_factory.mktemp("installed"), wheel)


def test_it_carries_everything_of_the_package(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        packed = set(archive.namelist())
    expected = {path.relative_to(ROOT / "src").as_posix() for path in tracked("src/duobench")}
    for meshes in ("robot_meshes.npz", "robot_meshes_fine.npz"):
        assert f"duobench/world/scene/{meshes}" in expected
    assert expected <= packed
    (information,) = {name.split("/")[0] for name in packed} - {"duobench", "duobench_command.py"}
    for notice in ("LICENSE", "THIRD_PARTY_NOTICES.md"):
        assert f"{information}/licenses/{notice}" in packed


@pytest.mark.slow
def test_an_environment_can_be_made_and_played(installed: Installed) -> None:
    connect = "import socket; socket.create_connection(('192.0.2.1', 9), timeout=1)"
    assert "there is no network" in installed.run("python", "-c", connect).stderr
    told = json.loads(installed.output("python", "-c", USE))
    assert Path(told["package"]).is_relative_to(installed.packages)
    assert told["pixels"] == {name: [32, 32, 3] for name in POLICY_CAMERAS}
    assert told["dark"] == []
    assert told["image"] == [24, 32, 3]
    assert told["stage"] == 0.0
