"""Following a run while others write it: what its records add up to so far, and its report."""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from duobench.errors import DuoBenchError
from duobench.looks.catalog import DEFAULT, as_look
from duobench.looks.look import Look
from duobench.replay.sources import ERROR, FAILURE, Item, RunSource
from duobench.replay.trajectory import Trajectory
from duobench.results.folder import RunFolder
from duobench.results.scores import group_by_condition

if TYPE_CHECKING:
    from duobench.web.server import PageServer

FAILURES = 5
"""Failures that are listed, the latest first."""
_LATEST = 20
"""Finished episodes from whose times the remaining time is estimated."""
_BREAK_S = 3600.0
"""Seconds without a finished episode that are a break of the run, which counts nowhere."""
_LEAVING_S, _LOADING_S, _LOOK_S = 10.0, 2.0, 0.1
"""Seconds that visitors have to open the report and then to load it, and between two looks."""


class FollowedRun:
    """A run as a source of a viewer, whose episodes come as they are finished.

    It reads the records that are there, each once, and knows nothing of what plays. There may be
    none yet, nor a run.

    Args:
        folder: The folder of the run.
        server: The page, which gives the report out.
        look: How it looks.
        tasks: Only the episodes of these tasks; of all if none is named.
        import_tasks: See `RunSource`.
    """

    def __init__(
        self,
        folder: RunFolder,
        server: PageServer,
        look: str | Look = DEFAULT,
        tasks: Sequence[str] = (),
        *,
        import_tasks: bool = False,
    ) -> None:
        self.title = folder.path.name
        self._folder, self._server = folder, server
        self._look, self._tasks, self._import_tasks = as_look(look), tasks, import_tasks
        self._source: RunSource | None = None
        self._finished_at: dict[str, float] = {}

    @property
    def items(self) -> Sequence[Item]:
        """The finished episodes."""
        return [] if self._source is None else self._source.items

    def load(self, item: str) -> Trajectory:
        """Play the targets of a record, and collect the poses."""
        if self._source is None:
            raise AssertionError("Nothing is finished.")
        return self._source.load(item)

    def close(self) -> None:
        """Free the environment."""
        if self._source is not None:
            self._source.close()

    def refresh(self, is_last: bool = False) -> dict[str, Any]:
        """What a page shows of the run now; its report at the end, of the run or of this."""
        try:
            shown: dict[str, Any] = {"run": self._read()}
        except (DuoBenchError, OSError) as error:  # it is begun anew, or something is broken
            shown = {"run": {"note": f"The run cannot be read now: {error}"}}
        if self._folder.page.exists() and (is_last or self._is_over()):
            base = self._server.publish_folder(self._folder.path)
            shown["report"] = base + self._folder.page.name
        elif is_last:
            shown |= {"ended": True, "run": {"note": "This page has ended. There is no report."}}
        return shown

    def wait_for_visitors(self) -> None:
        """Wait until all have loaded the report, a moment at most."""
        deadline = time.monotonic() + _LEAVING_S
        while self._server.has_viewers and time.monotonic() < deadline:
            time.sleep(_LOOK_S)
        time.sleep(_LOADING_S if self._folder.page.exists() else 0.0)

    def _read(self) -> dict[str, Any]:
        if not self._folder.description.exists():
            return {"note": "Nothing is written yet."}
        if self._source is None:
            self._source = RunSource(
                self._folder, self._look, self._tasks, import_tasks=self._import_tasks
            )
            self.title = self._source.title
        source = self._source
        source.refresh()
        for name, record in source.records.items():
            if name not in self._finished_at:
                self._finished_at[name] = self._folder.record(record.key).stat().st_mtime
        times = sorted(self._finished_at[name] for name in source.records)
        began, is_whole = self._folder.description.stat().st_mtime, len(times) == source.run.size
        parts = group_by_condition(source.run, source.records.values())
        rows = [
            {
                "condition": part.condition.name if len(parts) > 1 else "",
                "task": one.task.id,
                "of": source.run.suite.episodes,
                **one.score.numbers(),
            }
            for part in parts
            for one in part.results.tasks
        ]
        latest = sorted(source.items, key=lambda item: -self._finished_at[item.id])
        failed = [item for item in latest if item.state in {FAILURE, ERROR}][:FAILURES]
        return {
            "finished": len(times),
            "of": source.run.size,
            "elapsed_s": sum(_gaps([began, *times, *([] if is_whole else [time.time()])])),
            "left_s": _left_s(times, source.run.size),
            "rows": rows,
            "failures": [{"id": each.id, "title": each.title} for each in failed],
        }

    def _is_over(self) -> bool:
        """Whether every episode has a record, and the report is newer than the last of them."""
        source = self._source
        if source is None or len(source.records) < source.run.size:
            return False
        return self._folder.page.stat().st_mtime >= max(self._finished_at.values(), default=0.0)


def _gaps(moments: Sequence[float]) -> list[float]:
    """Seconds between moments, one after the other, without breaks."""
    return [gap for a, b in pairwise(moments) if 0.0 <= (gap := b - a) <= _BREAK_S]


def _left_s(times: Sequence[float], size: int) -> float | None:
    """Seconds until the rest is finished at the pace of the latest episodes; None if unknown."""
    gaps = _gaps(times[-_LATEST:])
    if not gaps:
        return 0.0 if len(times) == size else None
    return (size - len(times)) * sum(gaps) / len(gaps)
