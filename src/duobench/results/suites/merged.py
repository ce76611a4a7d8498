"""The shards of a run as one run: read together, and shown on one page."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from duobench.errors import EvaluationError, FileError
from duobench.files import Readable, encode
from duobench.results.folder import RunFolder
from duobench.results.reader import DESCRIPTION, RunReader
from duobench.results.run import RUN_SCHEMA, Run
from duobench.results.suites.shard import Shard

_NAMED = 6
"""Missing shards that a message names."""


class MergedRun(RunReader):
    """The shards of a run, as the run that they are parts of."""

    advice = RunFolder.advice

    def __init__(self, shards: Sequence[RunReader], path: Path) -> None:
        """Take all shards of a run, in any order.

        Args:
            shards: What reads each.
            path: Where they come from, for messages.

        Raises:
            EvaluationError: They are not the shards of one run, or not all of them.
            FileError: A description cannot be read.
        """
        super().__init__(path)
        runs = [(shard, shard.read_run()) for shard in shards]
        self.shards = tuple(shard for shard, _ in sorted(runs, key=lambda pair: _number(*pair)))
        """What reads each shard, in the order of their numbers."""
        self._run = _whole(runs)
        self._found: dict[str, dict[str, RunReader]] = {}

    def file(self, name: str) -> Readable:
        """A file of the shard that has it; the description is that of the whole run."""
        if name == DESCRIPTION:
            return _Text(f"{self.path}: {name}", encode(self._run, RUN_SCHEMA))
        folder, _, file = name.rpartition("/")
        return self._places(folder).get(file, self.shards[0]).file(name)

    def names(self, folder: str) -> Iterable[str]:
        """Names of the files that any shard has in a folder."""
        return list(self._places(folder))

    def _places(self, folder: str) -> dict[str, RunReader]:
        """Which shard has each file of a folder, as it was when first asked for.

        Raises:
            EvaluationError: Two have one.
        """
        if folder not in self._found:
            found: dict[str, RunReader] = {}
            for shard in self.shards:
                for name in shard.names(folder):
                    if other := found.get(name):
                        raise EvaluationError(
                            f"{folder}/{name} is in {other.path} and in {shard.path}; shards share "
                            "no episode."
                        )
                    found[name] = shard
            self._found[folder] = found
        return self._found[folder]


@dataclass(frozen=True, slots=True)
class _Text:
    """Text that is read as a file is."""

    place: str
    content: str

    def __str__(self) -> str:
        return self.place

    def read_bytes(self) -> bytes:
        return self.content.encode()


def _number(reader: RunReader, run: Run) -> int:
    if run.shard is None:
        raise EvaluationError(
            f"{reader.path} is a whole run, no shard of one; only shards are taken together."
        )
    return run.shard.number


def _whole(runs: Sequence[tuple[RunReader, Run]]) -> Run:
    """The run that shards are parts of.

    Raises:
        EvaluationError: They belong to different runs, two are the same, or some are missing.
    """
    wholes = [(reader, replace(run, shard=None)) for reader, run in runs]
    (first, whole), *others = wholes
    for reader, other in others:
        if differing := whole.differences(other) or other.differences(whole):
            raise EvaluationError(
                f"{first.path} and {reader.path} are shards of different runs: the first has "
                f"{'; '.join(differing)}."
            )
    shards = [(reader, run.shard) for reader, run in runs if run.shard is not None]
    count = shards[0][1].count
    by_number: dict[int, RunReader] = {}
    for reader, shard in shards:
        if shard.count != count:
            raise EvaluationError(
                f"{shards[0][0].path} is one of {count} shards, {reader.path} one of "
                f"{shard.count}: they overlap."
            )
        if other := by_number.get(shard.number):
            raise EvaluationError(f"{other.path} and {reader.path} are both shard {shard}.")
        by_number[shard.number] = reader
    if missing := [str(n) for n in range(1, count + 1) if n not in by_number]:
        more = ", ..." if len(missing) > _NAMED else ""
        raise EvaluationError(
            f"Of {count} shards {len(missing)} are missing: number {', '.join(missing[:_NAMED])}"
            f"{more}. Play them, or give their folders too."
        )
    commands = {_without_shard(run.command) for _, run in wholes}
    return replace(whole, command=commands.pop() if len(commands) == 1 else "")


def _without_shard(command: str) -> str:
    """A command without the option that names a shard."""
    words = shlex.split(command)
    with suppress(ValueError):
        place = words.index("--shard")
        del words[place : place + 2]
    return shlex.join(words)


class MergedFolder(RunFolder):
    """The folder that the shards of a run lie in, as what their common report is written into.

    Videos and replays are looked up in the shards; new ones lie beside the report.
    """

    def __init__(self, path: Path, merged: MergedRun) -> None:
        """Look into the folders of the shards."""
        super().__init__(path)
        shards = [shard for shard in merged.shards if isinstance(shard, RunFolder)]
        self._shards = [shard for shard in shards if shard.path.is_relative_to(self.path)]
        self.parts = tuple(shard.path for shard in self._shards)

    @property
    def timings(self) -> list[Path]:
        """Where it is noted how long episodes took."""
        return [shard.timing for shard in self._shards]

    def video(self, task_id: str, episode: int) -> Path:
        """Video of an episode, in the shard that has it."""
        places = [shard.video(task_id, episode) for shard in self._shards]
        own = super().video(task_id, episode)
        return next((path for path in places if path.exists()), own)


def shards_in(path: Path) -> list[Path]:
    """Folders of shards in a folder that is no run itself, by name; none if there are none."""
    if not path.is_dir() or (path / DESCRIPTION).exists():
        return []
    return sorted(each.parent for each in path.glob(f"shard-*-of-*/{DESCRIPTION}"))


def check_whole(reader: RunReader) -> None:
    """Reject one shard where only a whole run will do.

    Raises:
        EvaluationError: It is a part of a run.
    """
    if (shard := reader.read_run().shard) is not None and shard.count > 1:
        raise EvaluationError(
            f"{reader.path} is shard {shard} of a run alone; the other {shard.count - 1} belong to "
            "it. Give the folders of all, or the one that they lie in."
        )


def shard_folder(out: Path, shard: Shard) -> Path:
    """Where a shard of a run lies.

    Raises:
        FileError: The folder holds a run itself.
    """
    if (out / DESCRIPTION).exists():
        raise FileError(f"{out} holds a run, so that shards of another one cannot lie in it.")
    return out / shard.folder
