"""What pages of results are made of: facts about a run, its videos and replays, their writer."""

from __future__ import annotations

import io
import os
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from urllib.parse import quote

from markupsafe import Markup
from PIL import Image

from duobench.errors import OtherRunError, VideoError
from duobench.files import make_folder, write
from duobench.results.folder import RunFolder
from duobench.results.records import EpisodeRecord, Key
from duobench.results.run import Candidate, Run
from duobench.results.scores import Results, RunPart, TaskResult
from duobench.results.suite import Suite
from duobench.results.suites import execute_text, latency_text, suite_text
from duobench.tasks import catalog
from duobench.types import CONTROL_HZ
from duobench.video import last_frame
from duobench.web.page import EpisodeReplay, replay_fragment

PAGE = "index.html"
"""The first page of every folder for people."""
Facts = Mapping[str, str]
"""Values in words by name, in the order in which they are shown."""
UNKNOWN = "not known"
JPEG_QUALITY = 80
_MACHINE = ("platform", "processor", "renderer")
"""What a record's versions say of the machine."""
_TOLD_BY_RUN = ("inference",)
"""What they say that the run says too."""
_COMMAND = "duobench report DIR --{} {}"
"""Makes videos or replays in a run's folder; see `PageVideos.command`."""
_IMPORTING = " --import-tasks"
"""What it takes for tasks that are not of the benchmark."""


def check_free(out: Path, sign: str, what: str, ours: Iterable[Path] = ()) -> None:
    """Make a folder to write into, or find that it holds what it is to hold.

    Args:
        out: The folder.
        sign: The file that tells what it holds.
        what: What that is, for the message: "comparison".
        ours: What may lie in it all the same.
    """
    there = set(out.iterdir()) if out.is_dir() else set()
    if there - set(ours) and not (out / sign).exists():
        raise OtherRunError(f"{out} is not empty and holds no {what}.")
    make_folder(out)


def write_files(out: Path, contents: Mapping[str, str]) -> Path:
    """Write files by their names, and return the page among them."""
    for name, content in contents.items():
        write(out / name, content)
    return out / PAGE


def identity(part: RunPart) -> Facts:
    """What was run, as far as every episode has it in common."""
    run, suite, candidate = part.run, part.suite, part.candidate
    policy, config = candidate.metadata, candidate.config
    height, width = config.image_size
    images = f"{', '.join(config.cameras)}, {width} × {height} pixels" if config.cameras else "none"
    objects = "positions of the objects (privileged)" if config.object_state else None
    inference = [policy.dtype, policy.device, _batching(candidate)]
    return {
        "Policy": candidate.policy
        if policy.name == candidate.policy
        else f"{candidate.policy} ({policy.name})",
        "Its version": policy.version or UNKNOWN,
        **({"Trained on": candidate.trained_on} if candidate.trained_on else {}),
        **({"Rig": run.rig[:12]} if run.rig else {}),
        "Suite": _suite(suite, config.split),
        "Tasks": ", ".join(task.id for task in suite.tasks),
        "Episodes": f"{_indices(suite)}, {suite.episodes} of each task",
        **({} if run.is_real else {"Look": suite.look}),
        **({} if run.is_real else {"Shift": str(part.condition.shift)}),
        "Cameras": images,
        "Other observations": ", ".join(filter(None, ("joints, openings, tool poses", objects))),
        "Action mode": config.action_mode,
        "Chunk": "of varying or unknown length"
        if policy.horizon is None
        else f"{policy.horizon} action{'s' if policy.horizon > 1 else ''}",
        "Executed": f"{execute_text(suite)}, {latency_text(suite)}",
        **({"Overtime": f"up to {suite.overtime:g} horizons"} if suite.overtime > 1 else {}),
        "Instructions": config.instructions,
        "Inference": ", ".join(filter(None, inference)) or UNKNOWN,
        "Time limits": f"{run.limits.act_timeout:g} s an answer, "
        f"{run.limits.episode_timeout:g} s an episode",
    }


def stacks(records: Iterable[EpisodeRecord]) -> list[Facts]:
    """Machines and software that records come from, each combination once."""
    found = dict.fromkeys(tuple(record.versions.items()) for record in records)
    return [_stack(dict(versions)) for versions in found]


def trials(records: Iterable[EpisodeRecord]) -> Facts:
    """What became of trials on real arms; nothing in simulation."""
    judged = [record.judged for record in records if record.judged is not None]
    if not judged:
        return {}
    invalid = Counter(reason for each in judged for reason in each.repeated)
    reasons = "; ".join(f"{reason} ({count})" for reason, count in sorted(invalid.items()))
    return {
        "Judged by": ", ".join(sorted({each.rater for each in judged})),
        "Presses": f"{sum(len(each.presses) for each in judged)}, of which "
        f"{sum(press.stage is None for each in judged for press in each.presses)} take one back",
        "Invalid trials, played again": f"{invalid.total()}: {reasons}" if invalid else "none",
        "Stopped by a reflex": str(sum(each.reflex for each in judged)),
    }


def _stack(versions: Mapping[str, str | None]) -> Facts:
    machine = {name.capitalize(): versions.get(name) or _absent(name) for name in _MACHINE}
    software = [
        f"{name} {version}"
        for name, version in versions.items()
        if version and name not in (*_MACHINE, *_TOLD_BY_RUN)
    ]
    return {**machine, "Software": ", ".join(software)}


def _absent(name: str) -> str:
    return "none: no images for the policy" if name == "renderer" else UNKNOWN


def _indices(suite: Suite) -> str:
    first, last = suite.indices[0], suite.indices[-1]
    return f"number {first}" if first == last else f"numbers {first}–{last}"


def _suite(suite: Suite, split: str) -> str:
    return f"{suite_text(suite)}, version {suite.version}, layouts of the split {split}"


def _batching(candidate: Candidate) -> str | None:
    batching = candidate.batching
    return batching and f"{batching.mode} batches of {batching.size}"


class PageVideos:
    """Finds videos for a page of a run.

    Args:
        folder: The folder of the run.
        run: The run.
        page: The folder of the page, from which its links lead.
        has_command: Whether a command started the run.
    """

    def __init__(self, folder: RunFolder, run: Run, page: Path, has_command: bool) -> None:
        self._folder, self._run, self._page = folder, run, page
        self._has_command = has_command

    def video(self, record: EpisodeRecord) -> str | None:
        """Link to the video of an episode; None if there is none."""
        path = self._folder.video(record.key)
        return self._link(path) if path.exists() else None

    def poster(self, record: EpisodeRecord) -> str | None:
        """Link to the last frame of a video; None if there is none."""
        path = self._folder.poster(record.key)
        if not path.exists():
            with suppress(VideoError):
                image = last_frame(self._folder.video(record.key))
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
            choice: Of which episodes, as `duobench.replay.videos.choose` takes it.
            what: "videos" or "replays".

        Returns:
            The command; empty if the run was not started by one.
        """
        if not self._has_command:
            return ""
        is_known = {task.id for task in self._run.suite.tasks} <= set(catalog.names())
        return _COMMAND.format(what, choice) + ("" if is_known else _IMPORTING)

    def _link(self, path: Path) -> str:
        return quote(os.path.relpath(path, self._page))


class PageReplays:
    """Finds replays for the page of a run."""

    def __init__(self, folder: RunFolder, results: Results) -> None:
        """Look into the folder of a run."""
        self._replays: dict[Key, EpisodeReplay] = {}
        for one in results.tasks:
            for record in one.records:
                path = folder.replay(record.key)
                if path is None:
                    continue
                self._replays[record.key] = EpisodeReplay(
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
        replay = self._replays.get(record.key)
        return replay and replay.id

    def fragment(self) -> str:
        """The part of the page that plays them; empty if there are none."""
        if not self._replays:
            return ""
        return Markup(replay_fragment(self._scenes, list(self._replays.values())))
