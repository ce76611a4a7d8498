"""Parts of pages of results: facts about a run, its videos and replays, their writer."""

import json
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

import matplotlib
from markupsafe import Markup

from duobench.core.errors import OtherRunError, VideoError
from duobench.core.files import files_in, make_folder, write
from duobench.core.machine import is_software_renderer
from duobench.core.pages import render
from duobench.core.types import CONTROL_HZ
from duobench.core.versions import __version__, other_engine, package_source
from duobench.core.video import jpeg, last_frame
from duobench.envs.camera_options import name_of
from duobench.envs.config import EnvConfig
from duobench.results import figures, scores
from duobench.results.folder import RunFolder
from duobench.results.labels import REACTION_S
from duobench.results.records import InvalidTrial, Key, Record
from duobench.results.run import Run
from duobench.results.scores import Results, RunPart, TaskResult
from duobench.results.suite import (
    execute_text,
    extra_sensing,
    latency_text,
    suite_text,
)
from duobench.web.page import EpisodeReplay, replay_fragment

PAGE = "index.html"
Facts = Mapping[str, str]
"""Values in words by name, in the order in which they are shown."""
UNKNOWN = "not known"
_MACHINE = {
    "platform": UNKNOWN,
    "processor": UNKNOWN,
    "renderer": "none: no images for the policy",
}
"""Facts of a record's versions about the machine, and the word where they are missing."""
_BY_PROCESSOR = ": no graphics card rendered the images, so they took longer"


def software() -> str:
    """Software that decides how a page looks, which every page names."""
    return f"DuoBench {__version__} {package_source()[:12]}, Matplotlib {matplotlib.__version__}"


def page(
    template: str,
    svgs: Mapping[str, str],
    **values: Any,
) -> str:
    """A page of results as HTML text, with its figures by name, from what its template shows."""
    return render(
        "duobench.results",
        template,
        svgs={name: Markup(figures.for_page(svg)) for name, svg in svgs.items()},
        figures=figures,
        scores=scores,
        rate_hz=CONTROL_HZ,
        software=software(),
        suite_text=suite_text,
        execute_text=execute_text,
        latency_text=latency_text,
        **values,
    )


def part_page(
    template: str, svgs: Mapping[str, str], part: RunPart, **values: Any
) -> str:
    """A page of what was played under one condition, as HTML text; see `page`."""
    return page(
        template,
        svgs,
        part=part,
        run=part.run,
        candidate=part.candidate,
        suite=part.suite,
        results=part.results,
        identity=identity(part),
        **values,
    )


def json_text(content: object) -> str:
    """A document for programs."""
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def check_free(
    out: Path,
    sign: str,
    what: str,
) -> None:
    """Make a folder to write into, or find by the file that is its sign that it holds the same."""
    if not (out / sign).exists() and any(files_in(out)):
        raise OtherRunError(f"{out} is not empty and holds no {what}.")
    make_folder(out)


def with_figures(
    contents: Mapping[str, str], svgs: Mapping[str, str]
) -> dict[str, str]:
    """Files by their names, figures first."""
    return {**{f"figures/{name}.svg": svg for name, svg in svgs.items()}, **contents}


def write_files(out: Path, contents: Mapping[str, str]) -> Path:
    """Write files by their names, and return the page among them."""
    for name, content in contents.items():
        write(out / name, content)
    return out / PAGE


def identity(part: RunPart) -> Facts:
    """Identity of a run, as far as every episode has it in common."""
    run = part.run
    suite = part.suite
    candidate = part.candidate
    policy = candidate.metadata
    config = candidate.config
    batching = candidate.batching
    first, last = suite.indices[0], suite.indices[-1]
    indices = f"number {first}" if first == last else f"numbers {first}–{last}"
    objects = ", positions of the objects (privileged)" if config.object_state else ""
    batches = batching and f"{batching.mode} batches of {batching.size}"
    begun_again = part.results.overall.repeated
    ends = [end for record in part.records for end in record.earlier]
    actions = (
        f"{policy.horizon} action{'s' if policy.horizon and policy.horizon > 1 else ''}"
    )
    facts = {
        "Policy": candidate.policy
        if policy.name == candidate.policy
        else f"{candidate.policy} ({policy.name})",
        "Its version": policy.version or UNKNOWN,
        "Trained on": candidate.trained_on,
        "Rig": rig_text(part.records) if run.is_real else "",
        "Suite": f"{suite_text(suite, config)}, version {suite.version}, layouts of the split "
        f"{config.split}",
        "Tasks": ", ".join(task.id for task in suite.tasks),
        "Episodes": f"{indices}, {suite.episodes} of each task",
        "Look": "" if run.is_real else suite.look,
        "Gripper and mount": part.condition.robot,
        "Shift": "" if run.is_real else str(part.condition.shift),
        "Cameras": _cameras_text(config),
        "Beyond the robot's images": extra_sensing(config),
        "Other observations": f"joints, openings, tool poses{objects}",
        "Action mode": config.action_mode,
        "Chunk": "of varying or unknown length" if policy.horizon is None else actions,
        "Executed": f"{execute_text(suite)}, {latency_text(suite)}",
        "Instructions": config.instructions,
        "Inference": ", ".join(filter(None, (policy.dtype, policy.device, batches)))
        or UNKNOWN,
        "Begun more than once": str(begun_again or ""),
        "Earlier attempts": counts_text(ends) if ends else "",
        "Time limits": f"{run.limits.act_timeout:g} s an answer, "
        f"{run.limits.episode_timeout:g} s an episode",
    }
    return {name: value for name, value in facts.items() if value}


def _cameras_text(config: EnvConfig) -> str:
    """The cameras whose images, depth or parts a policy sees, with the sizes of these."""
    by_size: dict[tuple[int, int], list[str]] = {}
    for sizes in config.wanted.values():
        for camera, size in sizes.items():
            names = by_size.setdefault(size, [])
            if (name := name_of(camera)) not in names:
                names.append(name)
    return (
        "; ".join(
            f"{', '.join(names)}, {width} × {height} pixels"
            for (height, width), names in by_size.items()
        )
        or "none"
    )


def rig_text(records: Iterable[Record]) -> str:
    """The states of a rig's file that episodes were played on."""
    rigs = list(dict.fromkeys(record.rig[:12] for record in records if record.rig))
    return (
        f"{len(rigs)} measurements of it: {', '.join(rigs)}"
        if len(rigs) > 1
        else "".join(rigs)
    )


def stacks(records: Iterable[Record]) -> list[Facts]:
    """Machines and software that records come from, each combination once."""
    found = map(
        dict, dict.fromkeys(tuple(record.versions.items()) for record in records)
    )
    hidden = {*_MACHINE, "inference"}  # which the run says too
    return [
        {
            **{name.capitalize(): _machine(name, versions) for name in _MACHINE},
            "Software": ", ".join(
                f"{name} {version}"
                for name, version in versions.items()
                if version and name not in hidden
            )
            + (f" ({other})" if (other := other_engine(versions)) else ""),
        }
        for versions in found
    ]


def _machine(name: str, versions: Mapping[str, str | None]) -> str:
    value = versions.get(name) or _MACHINE[name]
    is_slow = name == "renderer" and is_software_renderer(value)
    return value + _BY_PROCESSOR * is_slow


def trials(records: Iterable[Record]) -> Facts:
    """Outcomes of trials on real arms; empty in simulation."""
    judged = [record.judged for record in records if record.judged is not None]
    if not judged:
        return {}
    presses = [press for each in judged for press in each.presses]
    late = sum(each.is_late for each in judged)
    counted = sum(press.late for press in presses)
    return {
        "Judged by": ", ".join(sorted({each.rater for each in judged})),
        "Presses": f"{len(presses)}, of which {sum(press.stage is None for press in presses)} take "
        "one back",
        f"Presses more than {REACTION_S:g} s after the end": f"{counted}: {late} episodes have "
        "their stage from one"
        if counted
        else "none",
        "Arms stopped by": counts_text(each.fault or "" for each in judged),
        "Waits for late images": str(sum(each.waits for each in judged)),
        "Invalid trials, played again": invalid_text(
            [trial for each in judged for trial in each.repeated]
        ),
    }


def invalid_text(trials: Sequence[InvalidTrial]) -> str:
    """Trials that do not count, in a line: how many, at which stages, and why."""
    if not trials:
        return "none"
    chosen = sum(trial.is_chosen for trial in trials)
    return (
        f"{len(trials)}, of which {chosen} by the operator's choice; at stage "
        f"{counts_text(str(trial.stage) for trial in trials)}; stopped by "
        f"{counts_text(trial.fault or '' for trial in trials)}; reasons: "
        f"{counts_text(trial.reason for trial in trials)}"
    )


def counts_text(values: Iterable[str]) -> str:
    """Count values, such as "contact (2), person (1)"; empty ones are left out."""
    counts = Counter(filter(None, values))
    return (
        ", ".join(f"{value} ({count})" for value, count in sorted(counts.items()))
        or "nothing"
    )


class PageVideos:
    """Finder of videos for a page of a run, from whose folder its links lead."""

    def __init__(
        self, folder: RunFolder, run: Run, page: Path, has_command: bool
    ) -> None:
        self._folder = folder
        self._run = run
        self._page = page
        self._has_command = has_command

    def video(self, record: Record) -> str | None:
        """Link to the video of an episode; None without a video."""
        return self._link(self._folder.video(record.key))

    def poster(self, record: Record) -> str | None:
        """Make the last frame of a video an image, and link to it; None without a video."""
        path = self._folder.poster(record.key)
        if not path.exists():
            with suppress(VideoError):
                write(path, jpeg(last_frame(self._folder.video(record.key))))
        return self._link(path)

    def featured(self, result: TaskResult) -> list[Record]:
        """Episodes of a task whose videos are shown: the first of each last stage, in order."""
        found = [record for record in reversed(result.records) if self.video(record)]
        first = {record.final_stage: record for record in found}
        return [first[stage] for stage in sorted(first)]

    def command(self, choice: str, what: str = "videos") -> str:
        """The command that makes videos or replays, with DIR for the folder; empty for no command.

        The choice is one of episodes, as `duobench.evaluation.replay.render.choose` takes it.
        """
        if not self._has_command:
            return ""
        imports = " --import-tasks" if self._run.suite.foreign else ""
        return f"duobench report DIR --{what} {choice}{imports}"

    def _link(self, path: Path) -> str | None:
        return quote(os.path.relpath(path, self._page)) if path.exists() else None


def page_replays(folder: RunFolder, results: Results) -> tuple[dict[Key, str], str]:
    """Return what opens each replay, as `data-replay`, and the part of a page with them."""
    replays: dict[Key, EpisodeReplay] = {}
    for one in results.tasks:
        for record in one.records:
            path = folder.replay(record.key)
            if path is not None:
                replays[record.key] = EpisodeReplay(
                    id=f"replay-{record.task}-{record.episode}",
                    title=f"{one.task.title}, episode {record.episode}",
                    scene=path.name.split(".")[1],
                    track=path.read_bytes(),
                    stage_changes=record.stage_changes,
                    stages=one.task.stages,
                    instruction=record.instruction,
                )
    scenes = sorted({replay.scene for replay in replays.values()})
    contents = {name: folder.scene(name).read_bytes() for name in scenes}
    fragment = replay_fragment(contents, list(replays.values())) if replays else ""
    return {key: replay.id for key, replay in replays.items()}, Markup(fragment)
