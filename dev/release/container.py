"""Play the steps of the Dockerfile in a bare Debian, in namespaces of its own; no daemon is needed.

    python -m dev.release.container [--keep]

Needs root and debootstrap on Debian. What is not tried by this: the layers, the base image itself
(debootstrap's smallest variant stands for it), `docker build` and `docker run`. The processes see
the machine's network while they install, and none when the command is played.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dev.release.stage import ROOT

Step = tuple[str, str]
FIRST = "eval --policy expert --tasks bin_sort --episodes 1 --out first"
SETTINGS = (
    "etc/apt/sources.list",
    "etc/apt/sources.list.d",
    "etc/resolv.conf",
    "etc/pip.conf",
)
"""Where this machine says from where packages come, and whom it trusts."""


def steps(text: str) -> Iterator[Step]:
    """Instructions and what stands behind them, continued lines put together."""
    lines = "\n".join(
        line for line in text.splitlines() if not line.lstrip().startswith("#")
    )
    for line in re.sub(r"\\\n\s*", "", lines).splitlines():
        if line.strip():
            word, _, rest = line.strip().partition(" ")
            yield word, rest.strip()


class Root:
    """A Debian in a folder, in which the steps are played one after the other."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environment = {"PATH": "/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin"}
        self.user, self.place, self.entry, self.command = (
            "root",
            "/",
            list[str](),
            list[str](),
        )

    @property
    def home(self) -> str:
        """Home of its user."""
        return "/root" if self.user == "root" else f"/home/{self.user}"

    def bootstrap(self, suite: str) -> None:
        """Install the smallest Debian, and this machine's settings of where packages are."""
        mirror = next(iter(_mirrors()), None)
        wanted = [
            "--variant=minbase",
            "--include=ca-certificates",
            suite,
            str(self.folder),
        ]
        # What it mounts in the folder, such as /proc, ends with it, however it ends.
        own = ["unshare", "--mount", "--propagation", "private", "debootstrap"]
        subprocess.run([*own, *wanted, *([mirror] if mirror else [])], check=True)
        for name in SETTINGS:
            there = Path("/") / name
            if there.is_dir():
                shutil.copytree(there, self.folder / name, dirs_exist_ok=True)
            elif there.exists():
                shutil.copy(there, self.folder / name)
        hosts = (
            self.folder / "etc" / "hosts"
        )  # which an engine of containers writes too
        hosts.write_text("127.0.0.1 localhost\n", encoding="utf-8")
        authorities = "etc/ssl/certs/ca-certificates.crt"
        shutil.copy(Path("/") / authorities, self.folder / authorities)

    def run(self, words: list[str], *, network: bool = True) -> None:
        """Run a program in it, as its user and in its place."""
        subprocess.run(self._program(words, network=network), check=True)

    def hear(self, words: list[str], *, network: bool = True) -> tuple[int, str]:
        """Run a program in it, which may fail: its exit code, and all that it says."""
        done = subprocess.run(
            self._program(words, network=network),
            check=False,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        return done.returncode, done.stdout

    def _program(self, words: list[str], *, network: bool) -> list[str]:
        own = ["unshare", "--mount", "--pid", "--ipc", "--uts", "--fork"]
        own += [] if network else ["--net"]
        # As an engine of containers gives them: processes, terminals, and a name of its own.
        dev = self.folder / "dev"
        prepared = (
            f"mount -t proc proc {self.folder}/proc",
            f"mount -t devpts -o newinstance,ptmxmode=0666 devpts {dev}/pts",
            f"mount --bind {dev}/pts/ptmx {dev}/ptmx",
            "hostname localhost",
        )
        mounts = f"{' && '.join(prepared)} && exec chroot --userspec={self.user} "
        told = {**self.environment, "HOME": self.home}
        variables = [f"{name}={value}" for name, value in told.items()]
        command = shlex.join(["env", "-i", *variables, *words])
        inside = f"cd {shlex.quote(self.place)} && exec {command}"
        program = f"{mounts} {self.folder} sh -c {shlex.quote(inside)}"
        return [*own, "sh", "-c", program]

    def play(self, step: Step, context: Path) -> None:
        """Play an instruction.

        Raises:
            ValueError: It is none that this knows.
        """
        match step:
            case "RUN", text:
                self.run(["sh", "-c", text])
            case "COPY", text:
                *sources, target = text.split()
                self._copy([context / name for name in sources], target)
            case "ENV", text:
                self.environment |= dict(
                    word.split("=", 1) for word in shlex.split(text)
                )
            case "USER", text:
                self.user = text
            case "WORKDIR", text:
                self.place = text
            case "ENTRYPOINT", text:
                self.entry = json.loads(text)
            case "CMD", text:
                self.command = json.loads(text)
            case word, _:
                raise ValueError(f"No instruction that is played here: {word}")

    def _copy(self, sources: list[Path], target: str) -> None:
        into = self.folder / target.lstrip("/")
        for source in sources:
            if source.is_dir():
                shutil.copytree(source, into, dirs_exist_ok=True)
            elif target.endswith("/"):
                into.mkdir(parents=True, exist_ok=True)
                shutil.copy(source, into)
            else:
                shutil.copy(source, into)


def _mirrors() -> Iterator[str]:
    """Where this machine has Debian's packages from."""
    lists = Path("/") / "etc/apt"
    for path in (
        lists / "sources.list",
        *sorted(lists.glob("sources.list.d/*.sources")),
    ):
        if path.exists():
            yield from re.findall(
                r"^(?:URIs:|deb) *(?:\[.*\] *)?(\S+)", path.read_text(), re.M
            )


def _mounts() -> list[str]:
    """What is mounted where, as this process sees it: nothing is deleted through a mount."""
    return Path("/proc/mounts").read_text(encoding="utf-8").splitlines()


@contextmanager
def debian(suite: str, *, keep: bool) -> Iterator[Root]:
    """The smallest Debian of a suite in a folder of its own, which is removed unless it is kept."""
    if os.geteuid() or not shutil.which("debootstrap") or not shutil.which("unshare"):
        sys.exit(
            "This needs root, debootstrap and unshare. On Debian: apt-get install debootstrap"
        )
    folder = Path(tempfile.mkdtemp(prefix="debian-"))
    folder.chmod(0o755)
    root = Root(folder)
    root.bootstrap(suite)
    index = {
        name: value for name, value in os.environ.items() if name.startswith("PIP_")
    }
    root.environment |= {k: v for k, v in index.items() if k != "PIP_FIND_LINKS"}
    try:
        yield root
    finally:
        if not keep and not any(str(folder) in one for one in _mounts()):
            shutil.rmtree(folder)


def main() -> None:
    """Play all of it, then the command as the image would run it, without a network."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--keep", action="store_true", help="keep the folder of the Debian"
    )
    asked = parser.parse_args()
    (_, image), *rest = steps((ROOT / "Dockerfile").read_text(encoding="utf-8"))
    with debian(image.partition(":")[2].partition("-")[0], keep=asked.keep) as root:
        for number, step in enumerate(rest, start=1):
            print(f"Step {number} of {len(rest)}: {' '.join(step)}", flush=True)
            root.play(step, ROOT)
        for words in (root.command, shlex.split(FIRST)):
            print(f"Without a network: {shlex.join([*root.entry, *words])}", flush=True)
            root.run([*root.entry, *words], network=False)
    print("All steps were played, and both commands ended well.")


if __name__ == "__main__":
    main()
