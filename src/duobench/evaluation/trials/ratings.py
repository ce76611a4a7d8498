"""What raters said about the films of trials, and whether they agree with the operator."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from duobench.evaluation.trials.folder import Standing, TrialsFolder
from duobench.evaluation.trials.judging import Presses
from duobench.evaluation.trials.log import Entry, Kind, read_entries
from duobench.evaluation.trials.plan import Plan
from duobench.results.records import Press
from duobench.results.reporting.agreement import Agreement, Verdict, agreements


@dataclass(frozen=True, kw_only=True, slots=True)
class Rating:
    """What one rater said about one film."""

    presses: tuple[Press, ...]
    """Every press."""
    stage: int
    """The highest stage that stands."""
    note: str = ""
    """What the rater wrote."""


def rated(entries: Iterable[Entry], max_stage: int) -> dict[tuple[int, int], Rating]:
    """The films that a log of ratings closes, by trial and attempt; the last word counts.

    Args:
        entries: The log of one rater.
        max_stage: The task's last stage.
    """
    found: dict[tuple[int, int], Rating] = {}
    presses, note = Presses(max_stage), ""
    for entry in entries:
        if entry.kind is Kind.BEGIN:
            presses, note = Presses(max_stage), ""
        elif entry.kind is Kind.PRESS:
            press = Press(stage=entry.stage, step=entry.step or 0, time_s=entry.time_s or 0.0)
            presses.add(press)
        elif entry.kind is Kind.NOTE:
            note = entry.text
        elif entry.kind is Kind.VALID:
            key = entry.trial, entry.attempt
            found[key] = Rating(presses=presses.all, stage=presses.stage, note=note)
    return found


def all_agreements(folder: TrialsFolder, plan: Plan) -> list[Agreement]:
    """How all who judged the trials agree, any two of them.

    Raises:
        FileError: A log or a record cannot be read.
        EvaluationError: A record is of another run.
    """
    standing = Standing.of(folder.read_log())
    last = plan.task.max_stage
    trials = {trial.number: trial for trial in plan.trials() if trial.number in standing.valid}
    remaining = {trial.number for trial in folder.remaining(plan, standing)}
    judged: dict[str, dict[int, Verdict]] = {plan.rater: {}}
    for number, trial in trials.items():
        if number in remaining:
            continue
        run_folder = folder.run(plan.letter(trial.policy))
        record = run_folder.read_record(run_folder.read_run(), plan.episode(trial.episode))
        judged[plan.rater][number] = _verdict(record.final_stage, last)
    for rater in folder.raters():
        ratings = rated(read_entries(folder.ratings(rater)), last)
        name = rater if rater != plan.rater else f"{rater} (film)"
        judged[name] = {
            number: _verdict(ratings[number, attempt].stage, last)
            for number, attempt in standing.valid.items()
            if (number, attempt) in ratings
        }
    return agreements(judged)


def _verdict(stage: int, last: int) -> Verdict:
    return Verdict(stage=stage, success=stage == last)
