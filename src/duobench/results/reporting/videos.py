"""The videos on a report, and the images that stand for them where none is played."""

from __future__ import annotations

import io
from contextlib import suppress
from pathlib import Path
from urllib.parse import quote

from PIL import Image

from duobench.errors import VideoError
from duobench.files import write
from duobench.results.folder import RunFolder
from duobench.results.metrics import TaskResult
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.tasks import catalog
from duobench.video import last_frame

JPEG_QUALITY = 80
_COMMAND = "duobench report DIR --{} {}"
"""Makes videos or replays in a run's folder; see `PageVideos.command`."""
_IMPORTING = " --import-tasks"
"""What it takes for tasks that are not of the benchmark."""


class PageVideos:
    """Finds videos for the page of a run; its links lead from the run's folder."""

    def __init__(self, folder: RunFolder, run: Run) -> None:
        """Look into the folder of a run."""
        self._folder = folder
        self._run = run

    def video(self, record: EpisodeRecord) -> str | None:
        """Link to the video of an episode; None if there is none."""
        path = self._folder.video(record.task, record.episode)
        return self._link(path) if path.exists() else None

    def poster(self, record: EpisodeRecord) -> str | None:
        """Link to the last frame of a video; None if there is none.

        Raises:
            OutputError: It cannot be written.
        """
        path = self._folder.poster(record.task, record.episode)
        if not path.exists():
            with suppress(VideoError):
                image = last_frame(self._folder.video(record.task, record.episode))
                buffer = io.BytesIO()
                Image.fromarray(image).save(buffer, "JPEG", quality=JPEG_QUALITY)
                write(path, buffer.getvalue())
        return self._link(path) if path.exists() else None

    def featured(self, result: TaskResult) -> list[EpisodeRecord]:
        """Episodes of a task whose videos are shown: the first one for each last stage.

        They come in the order of their last stages; all other videos are linked.
        """
        first: dict[int, EpisodeRecord] = {}
        for record in result.records:
            if record.final_stage not in first and self.video(record):
                first[record.final_stage] = record
        return [first[stage] for stage in sorted(first)]

    def command(self, choice: str, what: str = "videos") -> str:
        """The command that makes videos, with DIR for the folder, as in the run's own command.

        Args:
            choice: Of which episodes, as `duobench.replay.render.choose` takes it.
            what: "videos" or "replays".

        Returns:
            The command; empty if the run was not started by one.
        """
        if not self._run.command:
            return ""
        is_known = {task.id for task in self._run.suite.tasks} <= set(catalog.names())
        return _COMMAND.format(what, choice) + ("" if is_known else _IMPORTING)

    def _link(self, path: Path) -> str:
        return quote(path.relative_to(self._folder.path).as_posix())
