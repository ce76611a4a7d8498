"""Make the folder of what would be published: data, checkpoints, results, and what it all weighs.

    python -m dev.publication --out publication [--quick] [--workers N] [--networks FOLDER]

In full: fifty demonstrations of every task, a network for each, and a hundred episodes a task of
every policy, for hours. `--quick` takes two demonstrations and one episode, and trains nothing: its
numbers mean nothing, and its pages say so. Each step runs the command that a reader would run; what
a step has finished is not done again, so the same command goes on where it was stopped. Nothing is
uploaded.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from dev.release.stage import ROOT
from duobench.core.randomness import SUITE_VERSION
from duobench.tasks import catalog

EXAMPLES = ROOT / "examples/object_states"
DATA, LEROBOT, STATES = "data/recordings", "data/lerobot", "work/states"
SCRIPTED = ("expert", "blind", "hold", "random")
QUICKLY = ("expert", "hold")
"""Of these in a quick publication: it is part of every run of the checks."""
DEMONSTRATOR = "expert:human"
"""Who demonstrates: that of the page of baselines, whose networks are trained on the same."""
NEAREST, NETWORKS = "nearest", "networks"
LEARNED = {NEAREST: "eleven:NearestStates", NETWORKS: "eleven:Networks"}
"""Checkpoints that are made, and what plays them."""
QUICK = (
    "**Made to try the machinery**: two demonstrations and one episode of each task. Its numbers "
    "say nothing about any policy, and nothing in it is ranked."
)


@dataclass(frozen=True, kw_only=True)
class Publication:
    """What is made, and how much of it."""

    out: Path
    episodes: int
    workers: int
    networks: Path | None
    """Folder with TASK/0.npz, networks that were trained before, as `table.py` leaves them."""
    owner: str

    @property
    def is_quick(self) -> bool:
        """Whether it is of two demonstrations a task."""
        return self.episodes < 10  # noqa: PLR2004 - what a network holds out of its demonstrations

    def make(self) -> None:
        """Do what is left, step by step."""
        kept = {"demonstrations": self.episodes, "suite": SUITE_VERSION}
        note = self.out / "publication.json"
        if note.exists() and json.loads(note.read_text()) != kept:
            sys.exit(
                f"{self.out} holds a publication of another size or suite: name another folder."
            )
        self.out.mkdir(parents=True, exist_ok=True)
        note.write_text(json.dumps(kept) + "\n")
        self.record()
        scripted = QUICKLY if self.is_quick else SCRIPTED
        learned = [self.keep_nearest(), *([] if self.is_quick else [self.train()])]
        for policy in (*scripted, *learned):
            self.evaluate(policy)
        board = self.out / "leaderboard"
        self.duobench("leaderboard", "bundles", "--out", board.name, *self.side_by_side())
        self.cards(learned)
        (self.out / "README.md").write_text(self.page(), encoding="utf-8")

    def record(self) -> None:
        """Record, and export with images and with object states."""
        count = str(self.episodes)
        told = ("--policy", DEMONSTRATOR, "--episodes", count, "--out", DATA)
        self.duobench("record", *told, *self.side_by_side())
        small = ("--cameras", "head", "--size", "64", "64") if self.is_quick else ()
        self.duobench("export", "lerobot", DATA, "--out", LEROBOT, *small, *self.side_by_side())
        states = ("--per-task", "--cameras", "none", "--object-state", "--action", "cartesian")
        self.duobench("export", "lerobot", DATA, "--out", STATES, *states, *self.side_by_side())

    def keep_nearest(self) -> str:
        """A checkpoint of the demonstrations themselves, among which the nearest is looked up."""
        code = (
            "import sys, eleven; from pathlib import Path; from demonstrations import "
            "Demonstrations; eleven.keep(Demonstrations.load(Path(sys.argv[1])), Path(sys.argv[2]))"
        )
        for task in catalog.names():
            file = self.checkpoint(NEAREST) / f"{task}.npz"
            if not file.exists():
                part = file.with_suffix(".part.npz")
                self.python("-c", code, str(self.out / STATES / task), str(part))
                part.replace(file)
        return self.listed(NEAREST, {"kind": "nearest demonstrated state", "trained": "nothing"})

    def train(self) -> str:
        """A checkpoint with a network for each task, trained here or taken from where they are."""
        for task in catalog.names():
            file = self.checkpoint(NETWORKS) / f"{task}.npz"
            if file.exists():
                continue
            part = file.with_suffix(".part.npz")
            if self.networks is not None:
                shutil.copyfile(self.networks / task / "0.npz", part)
            else:
                self.python("network.py", str(self.out / STATES / task), str(part), "--seed", "0")
            part.replace(file)
        recipe = {"kind": "network on object states", "code": "examples/object_states/network.py"}
        return self.listed(NETWORKS, {**recipe, "seed": 0})

    def listed(self, name: str, how: dict[str, object]) -> str:
        """Write beside a checkpoint what it is made of; its policy."""
        folder = self.checkpoint(name)
        self.python("eleven.py", str(folder))
        facts = {**how, "demonstrations of each task": self.episodes, "suite": SUITE_VERSION}
        (folder / "training.json").write_text(json.dumps(facts, indent=1) + "\n")
        return name

    def evaluate(self, policy: str) -> None:
        """Play a policy, and bundle the run; a bundle that is there was finished."""
        bundle = self.out / "bundles" / f"{policy}.duobench.zip"
        if bundle.exists():
            return
        bundle.parent.mkdir(exist_ok=True)
        is_scripted = policy in SCRIPTED
        told = {} if is_scripted else {"CHECKPOINT": str(self.checkpoint(policy))}
        name = LEARNED.get(policy, policy)
        run = f"work/runs/{policy}"
        count = ("--episodes", str(1 if self.is_quick else 100), "--videos", "0")
        words = ("eval", "--policy", name, *count, "--out", run, *self.side_by_side())
        self.duobench(*words, **told)
        self.duobench("bundle", run, "--out", f"work/{bundle.name}")
        (self.out / "work" / bundle.name).replace(bundle)

    def cards(self, policies: list[str]) -> None:
        """Write the cards, and say on each of a quick publication that it is one."""
        self.duobench("data", "card", DATA, "--name", f"{self.owner}/duobench-fr3-recordings")
        shutil.copytree(
            self.out / DATA / "pictures", self.out / LEROBOT / "pictures", dirs_exist_ok=True
        )
        self.duobench("data", "card", LEROBOT, "--name", f"{self.owner}/duobench-fr3")
        folders = [self.out / DATA, self.out / LEROBOT]
        for policy in policies:
            folders.append(self.checkpoint(policy))
            name = f"{self.owner}/duobench-fr3-{policy}"
            bundle = f"bundles/{policy}.duobench.zip"
            self.duobench("checkpoint", "card", str(folders[-1]), "--run", bundle, "--name", name)
            for module in ("demonstrations", "frames", "nearest", "network", "eleven"):
                shutil.copy(EXAMPLES / f"{module}.py", folders[-1])
        if self.is_quick:
            for folder in folders:
                card = folder / "README.md"
                front, title, rest = card.read_text(encoding="utf-8").partition("\n# ")
                line, _, rest = rest.partition("\n")
                card.write_text(f"{front}{title}{line}\n\n{QUICK}\n{rest}", encoding="utf-8")

    def page(self) -> str:
        """The first page: what is there, its size, and how it would be uploaded."""
        board = json.loads((self.out / "leaderboard/leaderboard.json").read_text())
        groups = ("ranked", "ranked_privileged", "not_ranked")
        entries = [one for group in groups for one in board[group]]
        lines = ["# What would be published", "", *([QUICK, ""] if self.is_quick else [])]
        lines += [f"DuoBench, suite {SUITE_VERSION}. Nothing here was uploaded.", ""]
        lines += ["| what | files | MB |", "| --- | ---: | ---: |"]
        parts = [self.out / name for name in (DATA, LEROBOT, "bundles", "leaderboard")]
        parts[2:2] = sorted((self.out / "checkpoints").iterdir())
        for part in parts:
            files = [path for path in part.rglob("*") if path.is_file()]
            size = sum(path.stat().st_size for path in files) / 1e6
            lines.append(f"| `{part.relative_to(self.out)}` | {len(files)} | {size:.1f} |")
        lines += [
            "",
            "| entry | privileged | episodes | success % |",
            "| --- | --- | ---: | ---: |",
        ]
        for one in entries:
            overall = one["overall"]
            rate = f"{100 * overall['success_rate']:.1f}"
            told = "yes" if one["privileged"] else "no"
            lines.append(f"| {one['policy']} | {told} | {overall['episodes']} | {rate} |")
        lines += ["", *(f"Refused: {one['file']}: {one['reason']}" for one in board["refused"])]
        return "\n".join([*lines, "", "```sh", *self.uploads(), "```", ""])

    def uploads(self) -> Iterator[str]:
        """The commands that would upload it, of the Hub's own tool."""
        for folder, name in ((DATA, "duobench-fr3-recordings"), (LEROBOT, "duobench-fr3")):
            yield f"hf upload {self.owner}/{name} {folder} --repo-type dataset"
        for folder in sorted((self.out / "checkpoints").iterdir()):
            yield f"hf upload {self.owner}/duobench-fr3-{folder.name} checkpoints/{folder.name}"

    def checkpoint(self, name: str) -> Path:
        """The folder of a checkpoint, which is made."""
        folder = (self.out / "checkpoints" / name).absolute()
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def side_by_side(self) -> tuple[str, str]:
        """How many processes may work."""
        return "--workers", str(self.workers)

    def duobench(self, *words: str, **variables: str) -> None:
        """Run a command of DuoBench in the folder."""
        print(f"$ {shlex.join(['duobench', *words])}", flush=True)
        search = os.pathsep.join(filter(None, (str(EXAMPLES), os.environ.get("PYTHONPATH"))))
        environment = {**os.environ, **variables, "PYTHONPATH": search}
        command = [sys.executable, "-P", "-m", "duobench", *words]
        subprocess.run(command, cwd=self.out, env=environment, check=True)

    @staticmethod
    def python(*words: str) -> None:
        """Run a program of the examples."""
        subprocess.run([sys.executable, *words], cwd=EXAMPLES, check=True)


def main() -> None:
    """Make it as far as asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("publication"))
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--networks", type=Path, help="networks that are trained: TASK/0.npz")
    parser.add_argument("--owner", default="USER", help="who would publish it on the Hub")
    asked = parser.parse_args()
    Publication(
        out=asked.out.absolute(),
        episodes=2 if asked.quick else 50,
        workers=asked.workers,
        networks=asked.networks and asked.networks.absolute(),
        owner=asked.owner,
    ).make()


if __name__ == "__main__":
    main()
