"""The replays in 3D on a report: the page holds them, so that it plays them from a file."""

from __future__ import annotations

from collections.abc import Mapping

from markupsafe import Markup

from duobench.results.folder import RunFolder
from duobench.results.metrics import Results
from duobench.results.records import EpisodeRecord
from duobench.types import CONTROL_HZ
from duobench.web.page import EpisodeReplay, replay_fragment


class PageReplays:
    """Finds replays for the page of a run."""

    def __init__(self, folder: RunFolder, results: Results) -> None:
        """Look into the folder of a run.

        Raises:
            DataError: A replay is damaged.
        """
        self._replays: dict[tuple[str, int], EpisodeReplay] = {}
        for one in results.tasks:
            for record in one.records:
                path = folder.replay(record.task, record.episode)
                if path is None:
                    continue
                self._replays[record.task, record.episode] = EpisodeReplay(
                    id=f"replay-{record.task}-{record.episode}",
                    title=f"{one.task.title}, episode {record.episode}",
                    scene=path.name.split(".")[1],
                    track=path.read_bytes(),
                    stage_changes=record.stage_changes,
                    stages=one.task.stages,
                    instruction=record.instruction,
                    rate_hz=CONTROL_HZ,
                )
        scenes = {replay.scene for replay in self._replays.values()}
        self._scenes: Mapping[str, bytes] = {
            name: folder.scene(name).read_bytes() for name in sorted(scenes)
        }

    def id(self, record: EpisodeRecord) -> str | None:
        """What opens the replay of an episode as `data-replay`; None if there is none."""
        replay = self._replays.get((record.task, record.episode))
        return replay and replay.id

    def fragment(self) -> str:
        """The part of the page that plays them; empty if there are none."""
        if not self._replays:
            return ""
        return Markup(replay_fragment(self._scenes, list(self._replays.values())))
