"""The folder of a run: where things lie in it, and how a run is begun, continued and read."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from duobench.errors import EvaluationError
from duobench.files import begin_or_continue, encode, remove_temporary, write, writing
from duobench.results.reader import DESCRIPTION, RunReader, record_name
from duobench.results.records import RECORD_SCHEMA, EpisodeRecord
from duobench.results.reporting.times import EpisodeTimes, TimeNote
from duobench.results.run import OLDEST_RUN_SCHEMA, RUN_SCHEMA, Run

VIDEO_SUFFIX = ".webm"
"""Ending of a video's name."""
TRACK_SUFFIX, SCENE_SUFFIX = ".track", ".scene"
"""Endings of the names of what replays are made of."""
POSTER_SUFFIX = ".jpg"


class RunFolder(RunReader):
    """Names in the folder of a run."""

    advice = "Delete the file and run the evaluation again: it plays only the missing episodes."

    def __init__(self, path: Path) -> None:
        """Find the folder now: a policy may change the working folder."""
        super().__init__(path)
        self.description = self.file(DESCRIPTION)
        """What was run."""
        self.timing = self.path / "timing.jsonl"
        """How long each episode took: one JSON object a line, see `TimeNote`."""
        self.parts: tuple[Path, ...] = ()
        """Folders in it that runs lie in."""
        self.summary = self.path / "summary.json"
        """The results as JSON."""
        self.page = self.path / "index.html"
        """The report."""

    @property
    def timings(self) -> list[Path]:
        """Where it is noted how long episodes took."""
        return [self.timing]

    def file(self, name: str) -> Path:
        """A file by its name, whether or not there is one."""
        return self.path / name

    def names(self, folder: str) -> Iterable[str]:
        """Names of the JSON files in a folder."""
        return [path.name for path in (self.path / folder).glob("*.json")]

    def figure(self, name: str) -> Path:
        """A figure by its name."""
        return self.path / "figures" / f"{name}.svg"

    def record(self, task_id: str, episode: int) -> Path:
        """Record of an episode."""
        return self.file(record_name(task_id, episode))

    def video(self, task_id: str, episode: int) -> Path:
        """Video of an episode, if it has one."""
        return self.path / "videos" / task_id / f"{episode:05d}{VIDEO_SUFFIX}"

    def poster(self, task_id: str, episode: int) -> Path:
        """Image that stands for a video where none is played, if there is one."""
        return self.video(task_id, episode).with_suffix(POSTER_SUFFIX)

    def replay(self, task_id: str, episode: int) -> Path | None:
        """Track of an episode for its replay in 3D, if there is one."""
        # Its name ends with that of the scene: "00003.0123456789ab.track".
        found = sorted((self.path / "replays" / task_id).glob(f"{episode:05d}.*{TRACK_SUFFIX}"))
        return found[0] if found else None

    def new_replay(self, task_id: str, episode: int, scene: str) -> Path:
        """Where the track of an episode is to be, which plays in a scene."""
        return self.path / "replays" / task_id / f"{episode:05d}.{scene}{TRACK_SUFFIX}"

    def scene(self, name: str) -> Path:
        """What a browser needs to show the scene of replays."""
        return self.path / "replays" / "scenes" / f"{name}{SCENE_SUFFIX}"

    @property
    def has_records(self) -> bool:
        """Whether an episode is finished."""
        return any(self.path.glob("records/*/*.json"))

    def has_only_errors_of_another(self, run: Run) -> bool:
        """Whether it holds another run, of which every finished episode failed with an error.

        Raises:
            FileError: If a record cannot be read.
            EvaluationError: If a record is of yet another run.
        """
        if not (self.has_records and self.description.exists()):
            return False
        other = self.read_run()
        records = self.read_records(other) if run.differences(other) else []
        return bool(records) and all(record.error is not None for record in records)

    def clear(self) -> None:
        """Remove what the run that is there has finished, and nothing else; another may begin.

        Raises:
            OutputError: If it cannot be removed.
        """
        if not self.description.exists():
            return
        for folder in ("records", "videos", "replays", "figures"):
            with writing(self.path / folder), suppress(FileNotFoundError):
                shutil.rmtree(self.path / folder)
        for path in (self.summary, self.page, self.timing):
            with writing(path):
                path.unlink(missing_ok=True)

    def begin(self, run: Run) -> None:
        """Begin a run in this folder, or continue the one that is there.

        A run may grow: with more episodes than before, those that are there stay. A run that has
        not finished a single episode holds nothing to keep, so that whatever was wrong with it can
        be corrected: its description is replaced.

        Raises:
            OtherRunError: If the folder holds another run, or files that belong to none.
        """
        begin_or_continue(
            self.path,
            self.description,
            run,
            RUN_SCHEMA,
            oldest=OLDEST_RUN_SCHEMA,
            what="evaluation",
            is_final=self.has_records,
        )
        write(self.description, encode(run, RUN_SCHEMA))
        remove_temporary(self.path)

    def read_run(self) -> Run:
        """The description of the run; see `RunReader.read_run`."""
        if not self.description.exists():
            raise EvaluationError(
                f"{self.path} holds no evaluation: {self.description.name} is missing."
            )
        return super().read_run()

    def write(self, record: EpisodeRecord, video: bytes | None) -> None:
        """Write what an episode has left: its video first, so that a record means all of it.

        Raises:
            OutputError: It cannot be written.
        """
        if video is not None:
            write(self.video(record.task, record.episode), video)
        write(self.record(record.task, record.episode), encode(record, RECORD_SCHEMA))

    def discard(self, record: EpisodeRecord) -> None:
        """Remove what an episode has left, which makes it one that is still to be played."""
        for name in (self.poster, self.video, self.replay, self.record):
            if path := name(record.task, record.episode):
                with writing(path):
                    path.unlink(missing_ok=True)

    def note_timing(self, record: EpisodeRecord, times: EpisodeTimes | None, workers: int) -> None:
        """Append one line to the timing notes.

        Args:
            record: The episode.
            times: How long it took; None if its policy had to be stopped.
            workers: How many processes play side by side.
        """
        note = asdict(TimeNote.of(record, times, workers))
        with writing(self.timing), self.timing.open("a", encoding="utf-8") as file:
            file.write(json.dumps(note) + "\n")
