"""One policy for all tasks, out of a file for each.

    python eleven.py FOLDER
    CHECKPOINT=FOLDER duobench eval --policy eleven:Networks --out runs/networks

The folder holds files TASK.npz: networks, as `network.py` trains them, or demonstrations among
which the nearest state is looked up, as `keep` writes them. The first command lists their SHA-256
in `files.sha256`, whose own is the version of the policy. A published folder holds this module
beside its files, and is played from within it without the variable.
"""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from demonstrations import Demonstrations, Rows, checkpoint
from nearest import Nearest
from network import Network

from duobench.core.errors import PolicyError
from duobench.tasks import catalog
from duobench.world.robot.gripper import DEFAULT_GRIPPER

LIST = "files.sha256"


def keep(data: Demonstrations, path: Path) -> None:
    """Write what is played of demonstrations into one file."""
    names = [field.name for field in fields(data) if field.name != "recorded"]
    parts = {name: np.asarray(getattr(data, name)) for name in names}
    np.savez_compressed(path, **parts)


def listing(folder: Path) -> str:
    """The SHA-256 of each file of a task."""
    files = sorted(folder.glob("*.npz"))
    return "".join(
        f"{hashlib.sha256(one.read_bytes()).hexdigest()}  {one.name}\n" for one in files
    )


def read(path: Path) -> Network | Nearest:
    """The policy in a file."""
    parts = dict(np.load(path))
    if "about" in parts:
        return Network(path)
    parts["names"] = tuple(map(str, parts["names"]))
    parts["gripper"] = str(parts.get("gripper", DEFAULT_GRIPPER))
    return Nearest(Demonstrations(**parts))


class Eleven:
    """Knows its task by the instruction, and asks the policy of that task."""

    def __init__(self) -> None:
        """Read the files beside this one where they are listed, else those of CHECKPOINT."""
        here = Path(__file__).parent
        folder = here if (here / LIST).exists() else checkpoint()
        told = (
            (folder / LIST).read_text(encoding="utf-8")
            if (folder / LIST).exists()
            else ""
        )
        if not told or told != listing(folder):
            raise PolicyError(
                f"{folder / LIST} is not that of these files: python eleven.py writes it."
            )
        self._policies = {one.stem: read(one) for one in sorted(folder.glob("*.npz"))}
        self._now = next(iter(self._policies.values()))
        version = hashlib.sha256(told.encode()).hexdigest()[:16]
        name = f"{self._now.metadata.name}, one a task"
        self.metadata = replace(self._now.metadata, name=name, version=version)

    def reset(self, instruction: str, seed: int) -> None:
        """Begin an episode of the task with this instruction."""
        known = {
            catalog.get(name).instruction.partition("{")[0]: name
            for name in catalog.names()
        }
        task = next(
            (name for text, name in known.items() if instruction.startswith(text)),
            "none",
        )
        if task not in self._policies:
            raise PolicyError(
                f"There is no file for the task that is instructed: {instruction!r}."
            )
        self._now = self._policies[task]
        self._now.reset(instruction, seed)

    def act(self, observation: Mapping[str, Any]) -> Rows:
        """The next chunk (30, 16)."""
        return self._now.act(observation)


class Networks(Eleven):
    """Eleven under a name of its own, for a folder of networks."""


class NearestStates(Eleven):
    """The same for a folder of demonstrations."""


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args().folder
    (given / LIST).write_text(listing(given), encoding="utf-8")
