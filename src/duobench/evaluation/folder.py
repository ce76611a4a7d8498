"""The folder of a run: where things lie in it, and how a run is begun, continued and read."""

from __future__ import annotations

import errno
import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from duobench.errors import EvaluationError
from duobench.evaluation.files import TEMPORARY_SUFFIX, make_folder, remove_temporary, write_text
from duobench.evaluation.records import EpisodeRecord, read_record
from duobench.evaluation.run import Run

_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP)
"""What file systems without locks answer; a run there goes on unprotected."""
VIDEO_SUFFIX = ".webm"
"""Ending of a video's name."""


@dataclass(frozen=True, slots=True)
class RunFolder:
    """Names in the folder of a run."""

    path: Path
    """The folder."""

    @property
    def description(self) -> Path:
        """What was run."""
        return self.path / "run.json"

    @property
    def timing(self) -> Path:
        """How long each episode took: one JSON object a line, read by nobody but people."""
        return self.path / "timing.jsonl"

    @property
    def summary(self) -> Path:
        """The results as JSON."""
        return self.path / "summary.json"

    @property
    def page(self) -> Path:
        """The report."""
        return self.path / "index.html"

    def figure(self, name: str) -> Path:
        """A figure by its name."""
        return self.path / "figures" / f"{name}.svg"

    def record(self, task_id: str, episode: int) -> Path:
        """Record of an episode."""
        return self.path / "records" / _file_name(task_id) / f"{episode:05d}.json"

    def video(self, task_id: str, episode: int) -> Path:
        """Video of an episode, if it was filmed."""
        return self.path / "videos" / _file_name(task_id) / f"{episode:05d}{VIDEO_SUFFIX}"

    def begin(self, run: Run) -> None:
        """Begin a run in this folder, or continue the one that is there.

        A run that has not finished a single episode holds nothing to keep, so that a command
        that was wrong in its policy or tasks can be corrected: its description is replaced.

        Raises:
            EvaluationError: If the folder holds another run, or files that belong to none.
        """
        if self.description.exists():
            differences = run.differences(self.read_run())
            if differences and not any(self.path.glob("records/*/*.json")):
                write_text(self.description, run.to_json())
            elif differences:
                raise EvaluationError(
                    f"{self.path} holds another evaluation. Asked for is {'; '.join(differences)}. "
                    "Give --out another folder, or delete this one; its own command is: "
                    f"{self.read_run().command}"
                )
        elif self.path.exists() and not all(map(self._is_unfinished, self.path.iterdir())):
            raise EvaluationError(
                f"{self.path} is not empty and holds no evaluation. Give --out another folder."
            )
        else:
            write_text(self.description, run.to_json())
        remove_temporary(self.path)

    def _is_unfinished(self, path: Path) -> bool:
        """Whether it is a description that a killed run was writing."""
        return path.match(f".{self.description.name}.*{TEMPORARY_SUFFIX}")

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep a second evaluation out of the folder; a killed one leaves nothing locked.

        Raises:
            EvaluationError: If the folder cannot be made, or another process is evaluating into it.
        """
        make_folder(self.path)
        handle = os.open(self.path, os.O_RDONLY)
        try:
            self._lock(handle)
            yield
        finally:
            os.close(handle)

    def _lock(self, handle: int) -> None:
        """Lock the open folder; the operating system drops the lock with the process."""
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise EvaluationError(
                f"Another process is evaluating into {self.path}. Wait for it, or give --out "
                "another folder."
            ) from error
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise

    def read_run(self) -> Run:
        """The description of the run.

        Raises:
            EvaluationError: If there is none, or it cannot be read.
        """
        try:
            text = self.description.read_text(encoding="utf-8")
        except OSError as error:
            raise EvaluationError(
                f"{self.path} holds no evaluation: {self.description.name} is missing. "
                "Make one with: duobench eval --out DIR"
            ) from error
        try:
            return Run.from_json(text)
        except EvaluationError as error:
            raise EvaluationError(f"Cannot read {self.description}: {error}") from error

    def read_records(self, run: Run) -> list[EpisodeRecord]:
        """The records of the episodes that are finished, in the order of the run.

        Raises:
            EvaluationError: If a record cannot be read, or is of another episode or run.
        """
        found = []
        for task in run.tasks:
            for episode in run.episode_indices:
                path = self.record(task.id, episode)
                if path.exists():
                    record = read_record(path)
                    expected = (task.id, episode, run.policy, run.suite_version, task.max_stage)
                    given = (
                        record.task,
                        record.episode,
                        record.policy,
                        record.suite_version,
                        record.max_stage,
                    )
                    if given != expected:
                        raise EvaluationError(
                            f"{path} does not belong to this run: it is of {given}, expected was "
                            f"{expected} (task, episode, policy, suite version, last stage)."
                        )
                    found.append(record)
        return found

    def discard(self, task_id: str, episode: int) -> None:
        """Remove record and video of an episode, which makes it one that is still to be played."""
        for path in (self.video(task_id, episode), self.record(task_id, episode)):
            path.unlink(missing_ok=True)

    def note_timing(self, note: dict[str, Any]) -> None:
        """Append one line to the timing notes."""
        with self.timing.open("a", encoding="utf-8") as file:
            file.write(json.dumps(note) + "\n")


def _file_name(task_id: str) -> str:
    """A task's id as a folder name; ids are identifiers, so that only a stranger's may change."""
    return "".join(letter if letter.isalnum() or letter in "-_." else "-" for letter in task_id)
