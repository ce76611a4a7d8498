"""The report of a run: one page a condition, its figures and a summary, computed from the records.

No file written here depends on a clock, a folder or an order: the same records and videos give the
same bytes. The one exception is the block of times on a page, which is about nothing else.
"""

import os
from collections.abc import Iterator, Sequence

from duobench.core.errors import OtherRunError
from duobench.core.files import remove
from duobench.results import figures, scores
from duobench.results.comparison import compare_parts, comparison_files
from duobench.results.folder import CONDITIONS, RunFolder, RunReader
from duobench.results.journal import duration, run_times, side_by_side
from duobench.results.pages import (
    PAGE,
    PageVideos,
    check_free,
    json_text,
    page_replays,
    part_page,
    stacks,
    trials,
    with_figures,
    write_files,
)
from duobench.results.robustness import UNPROVEN, robustness_files, robustness_of
from duobench.results.run import Run, Shard
from duobench.results.scores import Results, RunPart, group_by_condition
from duobench.results.suite import deviations

SUMMARY_SCHEMA = 8
SUMMARY = "summary.json"
"""The results of a condition for programs."""
_NAMED = 6  # shards that a sentence names
_MOST_UNMET = 6
"""Constraints that did not hold of one stage that the page shows; others are folded away."""


def read_parts(source: RunReader) -> list[RunPart]:
    """Scores of the records of a run, condition by condition; nothing is written."""
    run = source.read_run()
    return group_by_condition(run, source.read_records(run))


def read_results(source: RunReader) -> tuple[Run, Results]:
    """Run with the results of all its records, under all conditions; see `read_parts`."""
    run = source.read_run()
    return run, scores.summarize(run.suite.tasks, source.read_records(run))


def write_report(folder: RunFolder, source: RunReader | None = None) -> Results:
    """Compute the report of a run from its records, and write it into a folder.

    A run under one condition has one page. A run under several has one page for each, and a first
    page for all of them: success by axis and level, or policies against each other.

    Args:
        folder: The folder of the report; that of the run unless a source is given.
        source: Reader of a run that is not in the folder, such as a bundle.

    Returns:
        Results of the run.

    Raises:
        EvaluationError: If there is no run, or a record of another episode.
        OtherRunError: If a record belongs to another run, or if a source is given and the folder
            holds a run or foreign files.
        FileError: If a record cannot be read.
        OutputError: If the folder cannot be written.
    """
    reader = source or folder
    parts = read_parts(reader)
    run = parts[0].run
    if source is not None:
        if folder.description.exists():
            raise OtherRunError(
                f"{folder.path} holds a run, and no report of a bundle."
            )
        check_free(folder.path, PAGE, "report of a bundle")
    if len(parts) > 1:
        stale = (SUMMARY, *(f"figures/{name}.svg" for name in figures.FIGURES))
        remove(*map(folder.file, stale))  # from when the run had one condition
    for name, text in _report_files(folder, reader, parts):
        write_files(folder.path, {name: text})
    return scores.summarize(
        run.suite.tasks, [each for part in parts for each in part.records]
    )


def _report_files(
    folder: RunFolder, source: RunReader, parts: Sequence[RunPart]
) -> Iterator[tuple[str, str]]:
    """Give each file of a report by its name in the folder, and its text; see `write_report`."""
    for part in parts:
        place = f"{CONDITIONS}/{part.condition.name}/" if len(parts) > 1 else ""
        for name, text in _part_files(folder, source, part, place).items():
            yield place + name, text
    if len(parts[0].run.suite.shifts) > 1:
        yield from robustness_files(robustness_of(parts), CONDITIONS).items()
    elif len(played := [part for part in parts if part.results.overall.episodes]) > 1:
        yield from comparison_files(compare_parts(played)).items()


def summary_json(part: RunPart) -> str:
    """The results as JSON text: per task, per category and overall."""
    document = {
        "schema": SUMMARY_SCHEMA,
        **part.facts(
            "policy", "policy_name", "policy_version", "privileged", "repeatable"
        ),
        **part.facts("domain", "rig", "trained_on"),
        **part.facts("suite_version", "suite"),
        "suite_deviations": deviations(part.suite, part.candidate.config),
        **part.facts("execute", "latency", "look", "robot", "shift", "versions"),
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
    """Shards of an unfinished run that lack episodes, in a sentence; empty without shards."""
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
            parts.append(
                f"shard {shard} ({lacking} episode{'s' if lacking > 1 else ''}{word})"
            )
    more = f", and {len(parts) - _NAMED} more" if len(parts) > _NAMED else ""
    return f"Missing are: {', '.join(parts[:_NAMED])}{more}." if parts else ""


def _part_files(
    folder: RunFolder, source: RunReader, part: RunPart, place: str
) -> dict[str, str]:
    svgs, out = figures.plots(part.results), folder.path / place
    commands = source.commands()
    is_finished = part.results.overall.episodes == part.size
    videos = PageVideos(folder, part.run, out, bool(commands))
    replay_ids, replays = page_replays(folder, part.results)
    times = run_times(part.results, folder.entries())
    page = part_page(
        "report.html.j2",
        svgs,
        part,
        commands=commands,
        home=os.path.relpath(folder.path, out) if out != folder.path else "",
        missing=""
        if is_finished or source is not folder
        else missing_shards(folder, part.run),
        stacks=stacks(part.records),
        trials=trials(part.records),
        unproven=UNPROVEN,
        failed_stages=scores.failed_stages,
        most_unmet=_MOST_UNMET,
        clipping=scores.clipping,
        is_clipped=any(map(scores.clipping, part.results.tasks)),
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
