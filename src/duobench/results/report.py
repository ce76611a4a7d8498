"""The report of a run: one page a condition, its figures and a summary, computed from the records.

No file written here depends on a clock, a folder or an order: the same records and videos give the
same bytes. The one exception is the block of times on a page, which is about nothing else.
"""

import json
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from html import unescape
from typing import Any

from duobench.core.errors import OtherRunError, escaped
from duobench.core.files import remove
from duobench.results import figures, scores
from duobench.results.compare import compare_parts, comparison_files
from duobench.results.folder import CONDITIONS, RunFolder, RunReader
from duobench.results.journal import duration, run_times, side_by_side
from duobench.results.pages import (
    PAGE,
    PageVideos,
    check_free,
    json_text,
    page_replays,
    part_page,
    software,
    stacks,
    trials,
    with_figures,
    write_files,
)
from duobench.results.robustness import UNPROVEN, robustness_files, robustness_of
from duobench.results.run import Run, Shard
from duobench.results.scores import Results, RunPart, group_by_condition
from duobench.results.suite import deviations

SUMMARY_SCHEMA = 7
SUMMARY = "summary.json"
"""The results of a condition for programs."""
_NAMED = 6  # shards that a sentence names
_MOST_UNMET = 6
"""Constraints that did not hold of one stage that the page shows; others are folded away."""


def read_parts(source: RunReader) -> list[RunPart]:
    """What the records of a run add up to, condition by condition; nothing is written."""
    run = source.read_run()
    return group_by_condition(run, source.read_records(run))


def read_results(source: RunReader) -> tuple[Run, Results]:
    """A run and what all its records add up to, whatever their conditions; see `read_parts`."""
    run = source.read_run()
    return run, scores.summarize(run.suite.tasks, source.read_records(run))


def write_report(folder: RunFolder, source: RunReader | None = None) -> Results:
    """Compute everything from the records of a run, and write it into a folder.

    A run under one condition has one page. Another one has a page for each, and a first one that
    shows all: success by axis and level, or policies against each other.

    Args:
        folder: The folder of the run, beside whose records it is written.
        source: What reads the run, where that is not its folder; this holds no run then.

    Raises:
        EvaluationError: If there is no run, or a record of another episode.
        OtherRunError: If a record is of another run, or the folder holds a run beside the source's,
            or files of something else.
        FileError: If a record cannot be read.
        OutputError: If nothing can be written into the folder.
    """
    reader = source or folder
    parts = read_parts(reader)
    run = parts[0].run
    if source is not None:
        if folder.description.exists():
            raise OtherRunError(f"{folder.path} holds a run, and no report of a bundle.")
        check_free(folder.path, PAGE, "report of a bundle")
    if len(parts) > 1:
        stale = (SUMMARY, *(f"figures/{name}.svg" for name in figures.FIGURES))
        remove(*map(folder.file, stale))  # of the time when there was one condition
    for name, text in report_files(folder, reader, parts):
        write_files(folder.path, {name: text})
    return scores.summarize(run.suite.tasks, [each for part in parts for each in part.records])


def report_files(
    folder: RunFolder,
    source: RunReader,
    parts: Sequence[RunPart],
    shown: Mapping[str, str] | None = None,
) -> Iterator[tuple[str, str]]:
    """Each file of a report, by its name in the folder, and its text; see `write_report`.

    Nothing is written but posters of videos. With files that are there by name, nothing is: their
    pages show the videos and replays that they show there.
    """
    for part in parts:
        place = f"{CONDITIONS}/{part.condition.name}/" if len(parts) > 1 else ""
        for name, text in _part_files(folder, source, part, place, shown).items():
            yield place + name, text
    if len(parts[0].run.suite.shifts) > 1:
        yield from robustness_files(robustness_of(parts), CONDITIONS).items()
    elif len(played := [part for part in parts if part.results.overall.episodes]) > 1:
        yield from comparison_files(compare_parts(played)).items()


def summary_json(part: RunPart) -> str:
    """The results as JSON text: per task, per category and overall."""
    document = {
        "schema": SUMMARY_SCHEMA,
        **part.facts("policy", "policy_name", "policy_version", "privileged", "repeatable"),
        **part.facts("domain", "rig", "trained_on"),
        **part.facts("suite_version", "suite"),
        "suite_deviations": deviations(part.suite),
        **part.facts("execute", "latency", "overtime", "look", "shift", "versions"),
        **part.facts("first_episode", "expected_episodes"),
        "tasks": {
            one.task.id: {
                **one.score.numbers(),
                "max_stage": one.task.max_stage,
                "last_stage_counts": list(one.last_stage_counts),
            }
            for one in part.results.tasks
        },
        "categories": {one.label: one.numbers() for one in part.results.categories},
        "overall": part.results.overall.numbers(),
    }
    return json_text(document)


def missing_shards(folder: RunFolder, run: Run) -> str:
    """Which shards of an unfinished run lack episodes, in a sentence; empty if it has no shards."""
    writers = folder.writers
    counts = {shard.count for shard in writers}
    if len(counts) != 1 or counts == {1}:
        return ""
    (count,) = counts
    there = set(folder.finished(run))
    parts: list[str] = []
    for number in range(1, count + 1):
        shard = Shard(number=number, count=count)
        lacking = sum(key not in there for key in run.episode_keys(shard))
        if lacking:
            word = "" if shard in writers else ", not begun"
            parts.append(f"shard {shard} ({lacking} episode{'s' if lacking > 1 else ''}{word})")
    more = f", and {len(parts) - _NAMED} more" if len(parts) > _NAMED else ""
    return f"Missing are: {', '.join(parts[:_NAMED])}{more}." if parts else ""


def _part_files(
    folder: RunFolder,
    source: RunReader,
    part: RunPart,
    place: str,
    shown: Mapping[str, str] | None,
) -> dict[str, str]:
    svgs, out = figures.plots(part.results), folder.path / place
    before = None if shown is None else shown.get(f"{place}{PAGE}", "")
    commands = source.commands()
    is_finished = part.results.overall.episodes == part.size
    videos = PageVideos(folder, part.run, out, bool(commands), before)
    replay_ids, replays = page_replays(folder, part.results, before)
    times = run_times(part.results, folder.entries())
    page = part_page(
        "report.html.j2",
        svgs,
        part,
        commands=commands,
        home=os.path.relpath(folder.path, out) if out != folder.path else "",
        missing="" if is_finished or source is not folder else missing_shards(folder, part.run),
        stacks=stacks(part.records),
        trials=trials(part.records),
        unproven=UNPROVEN,
        failed_stages=scores.failed_stages,
        most_unmet=_MOST_UNMET,
        clipping=scores.clipping,
        video=videos.video,
        video_command=videos.command,
        poster=videos.poster,
        featured=videos.featured,
        replay_ids=replay_ids,
        replays=replays,
        times=times,
        side_by_side=side_by_side(times.workers, len(folder.writers)),
        duration=duration,
    )
    return with_figures({SUMMARY: summary_json(part), PAGE: page}, svgs)


_LONGEST = 200  # characters of what is quoted
_TAG = re.compile(r"<[^<>]*>")
_CELL = re.compile(r"<(?:dd|td)\b[^<>]*>(?:\s*<(?!/)[^<>]*>)*\s*(\d[\d.–% ]*)")


def check_report(folder: RunFolder, parts: Sequence[RunPart]) -> tuple[list[str], list[str]]:
    """Compare every file of a report in the folder of a run with what would be written there.

    Videos are those that a page shows, and so are replays, as far as they are there. A page of
    other software, or of a run without journals, needs only to have the numbers that the records
    give, and so does what lies beside it.

    Returns:
        What differs, one sentence a file, and the pages of which numbers alone are compared.
    """
    left = {name: folder.file(name).read_text("utf-8", "replace") for name in folder.report()}
    pages = {name: text for name, text in left.items() if name.endswith(PAGE)}
    is_known = bool(folder.writers)  # without journals its times and commands are not
    others = [name for name, text in pages.items() if not (is_known and software() in text)]
    wrong: list[str] = []
    for name, text in report_files(folder, folder, parts, pages) if left else ():
        is_other = re.sub(r"(figures/)?[^/]+$", PAGE, name) in others
        if name in left and (words := _difference(name, left.pop(name), text, is_other)):
            wrong.append(f"{name} {words}; duobench report writes it anew.")
    return wrong + [f"{name} is no part of this run's report; remove it." for name in left], others


def _difference(name: str, said: str, given: str, is_other: bool) -> str:
    """In what a file differs first, in words; empty for nothing."""
    claims, facts = (Counter(_claims(name, text, is_other)) for text in (said, given))
    lacking, added = (list(left) for left in (facts - claims, claims - facts))
    if lacking or (added and not is_other):
        first = ((each or ["nothing"])[0] for each in (added, lacking))
        claim, fact = (escaped(" ".join(text[:_LONGEST].split())) for text in first)
        return f"says “{claim}”, its records give “{fact}”"
    if is_other or name.endswith(".json") or said.splitlines() == given.splitlines():
        return ""
    return "differs in a figure, a style, a script or an order from what its records give"


def _claims(name: str, text: str, is_other: bool) -> list[str]:
    """What a file says: value by value, line by line, or in numbers alone."""
    if name.endswith(".json"):
        with suppress(ValueError, RecursionError):
            return [*_leaves(json.loads(text, parse_float=_number, object_pairs_hook=tuple))]
    if is_other and name.endswith(".html"):
        return [cell.strip() for cell in _CELL.findall(text)]
    if is_other:
        return [] if name.endswith(".svg") else re.findall(r"\d[\d.]*", text)
    return [line for line in unescape(_TAG.sub(" ", text)).splitlines() if line.strip()]


def _number(text: str) -> float:
    return float(f"{float(text):.9g}")  # the last bits of a logarithm are a processor's own


def _leaves(
    value: list[Any] | tuple[tuple[str, Any], ...] | float | str | None, place: str = ""
) -> Iterator[str]:
    if isinstance(value, list | tuple) and value:
        for name, part in value if isinstance(value, tuple) else enumerate(value):
            yield from _leaves(part, f"{place}{name} ")
    else:
        yield f"{place}{json.dumps(value, ensure_ascii=False)}"
