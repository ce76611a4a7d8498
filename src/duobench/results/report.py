"""The report of a run: one page, its figures and a summary, computed from the records.

No file written here depends on a clock, a folder or an order: the same records and videos give the
same bytes. The one exception is the block of times on the page, which is about nothing else.
"""

from __future__ import annotations

import json
from typing import Any

from markupsafe import Markup

from duobench.errors import OtherRunError
from duobench.files import write
from duobench.pages import render
from duobench.results import figures, metrics
from duobench.results.folder import RunFolder
from duobench.results.metrics import Results, Score, summarize
from duobench.results.reader import RunReader
from duobench.results.reporting.clipping import clipping
from duobench.results.reporting.failures import failed_stages
from duobench.results.reporting.identity import identity, stacks, trials
from duobench.results.reporting.replays import PageReplays
from duobench.results.reporting.times import duration, read_notes, run_times, side_by_side
from duobench.results.reporting.videos import PageVideos
from duobench.results.run import Run
from duobench.results.suites.catalog import deviations, latency_text, suite_text
from duobench.types import CONTROL_HZ

SUMMARY_SCHEMA = 4
"""Version of the summary's fields."""
_MOST_UNMET = 6
"""Constraints that did not hold of one stage that the page shows; others are folded away."""


def read_results(source: RunReader) -> tuple[Run, Results]:
    """What the records of a run add up to; nothing is written.

    Args:
        source: The folder of the run, or what else reads one.

    Raises:
        EvaluationError: If there is no run, or a record of another one.
        FileError: If a record cannot be read.
    """
    run = source.read_run()
    return run, summarize(run.suite.tasks, source.read_records(run))


def write_report(folder: RunFolder, source: RunReader | None = None) -> Results:
    """Compute everything from the records of a run, and write it into a folder.

    Args:
        folder: The folder of the run, beside whose records it is written.
        source: What reads the run, where that is not its folder; this holds no run then, or the
            shards of it.

    Returns:
        What the records of the run, finished or not, add up to.

    Raises:
        EvaluationError: If there is no run, or a record of another one.
        FileError: If a record cannot be read.
        OtherRunError: If the folder holds a run beside the source's, or files of something else.
        OutputError: If nothing can be written into the folder.
    """
    run, results = read_results(source or folder)
    if source is not None:
        _check_free(folder)
    svgs = {name: figures.plot(name, results) for name in figures.FIGURES}
    for name, svg in svgs.items():
        write(folder.figure(name), svg)
    write(folder.summary, summary_json(run, results))
    write(folder.page, _page(folder, run, results, svgs))
    return results


def _check_free(folder: RunFolder) -> None:
    """Reject a folder that holds anything but a report without its run."""
    is_report = folder.page.exists() and not folder.description.exists()
    there = set(folder.path.iterdir()) if folder.path.is_dir() else set()
    if there - set(folder.parts) and not is_report:
        raise OtherRunError(
            f"{folder.path} is not empty and holds no report of a bundle or of shards."
        )


def summary_json(run: Run, results: Results) -> str:
    """The results as JSON text: per task, per category and overall."""
    document = {
        "schema": SUMMARY_SCHEMA,
        "policy": run.policy,
        "policy_version": run.metadata.version,
        "privileged": run.privileged,
        "domain": run.domain,
        "rig": run.rig,
        "trained_on": run.trained_on,
        "suite_version": run.suite.version,
        "suite": run.suite.label,
        "suite_deviations": deviations(run.suite),
        "execute": run.suite.execution.execute,
        "latency": run.suite.execution.latency,
        "overtime": run.suite.overtime,
        "shift": run.suite.shift.name,
        "shard": run.shard and str(run.shard),
        "versions": run.versions,
        "first_episode": run.suite.first_episode,
        "expected_episodes": run.size,
        "tasks": {
            one.task.id: {
                **_score(one.score),
                "max_stage": one.task.max_stage,
                "last_stage_counts": list(one.last_stage_counts),
            }
            for one in results.tasks
        },
        "categories": {category.label: _score(category) for category in results.categories},
        "overall": _score(results.overall),
    }
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def _score(score: Score) -> dict[str, Any]:
    """A score for the summary."""
    return {
        "episodes": score.episodes,
        "successes": score.successes,
        "success_rate": score.success_rate,
        "wilson_95": list(score.interval),
        "mean_final_progress": score.mean_final_progress,
        "errors": score.errors,
        "late_successes": score.late_successes,
    }


def _page(folder: RunFolder, run: Run, results: Results, svgs: dict[str, str]) -> str:
    """The page as HTML text."""
    videos, replays = PageVideos(folder, run), PageReplays(folder, results)
    times = run_times(results, read_notes(*folder.timings))
    return render(
        "duobench.results",
        "report.html.j2",
        run=run,
        suite=run.suite,
        results=results,
        identity=identity(run),
        stacks=stacks(record for one in results.tasks for record in one.records),
        svgs={name: Markup(figures.for_page(svg)) for name, svg in svgs.items()},
        trials=trials(record for one in results.tasks for record in one.records),
        control_rate_hz=CONTROL_HZ,
        figures=figures,
        metrics=metrics,
        failed_stages=failed_stages,
        most_unmet=_MOST_UNMET,
        clipping=clipping,
        suite_text=suite_text,
        expected=lambda members: sum(run.counts[one.task.id] for one in members),
        latency_text=latency_text,
        video=videos.video,
        video_command=videos.command,
        poster=videos.poster,
        featured=videos.featured,
        replay=replays.id,
        replays=replays.fragment(),
        times=times,
        side_by_side=side_by_side(times.workers),
        duration=duration,
    )
