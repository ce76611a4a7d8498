"""Results of an evaluation on real arms: a report each, a comparison, one page."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

from duobench.core.files import write
from duobench.core.pages import render
from duobench.real.doctor.checks import Report, read_checks
from duobench.real.rig import Rig
from duobench.real.sessions.trials_folder import TrialsFolder, TrialsProgress
from duobench.real.sessions.trials_plan import TrialsPlan
from duobench.results import scores, tables
from duobench.results.comparison import compare_parts
from duobench.results.folder import CONDITIONS
from duobench.results.pages import counts_text, rig_text
from duobench.results.pairs import Pair
from duobench.results.records import InvalidTrial
from duobench.results.report import read_parts, write_report
from duobench.results.scores import RunPart, Score


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicyResult:
    """Result of one policy."""

    letter: str
    policy: str
    page: str
    """Folder of its report, in that of the run."""
    trained_on: str
    score: Score
    stops: str
    """Number of its episodes that each kind of fault ended."""

    def row(self) -> dict[str, Any]:
        """Return JSON data for the operator's page."""
        about = {
            "letter": self.letter,
            "policy": self.policy,
            "trained_on": self.trained_on,
        }
        return about | self.score.numbers()


@dataclass(frozen=True, kw_only=True, slots=True)
class InvalidRow:
    """Trials of one policy that do not count."""

    policy: str
    trials: int
    chosen: int
    """Trials that the operator called invalid after the outcome; the others could not count."""
    stages: tuple[int, ...]
    """Number that reached each stage, from 0 on."""
    stops: str
    """Number of stops by each kind of fault."""


def invalid_rows(plan: TrialsPlan, progress: TrialsProgress) -> tuple[InvalidRow, ...]:
    """Trials that do not count, policy by policy, those with none included."""
    found: list[list[InvalidTrial]] = [[] for _ in plan.policies]
    for trial in plan.trials():
        found[trial.policy] += progress.invalid.get(trial.number, [])
    return tuple(
        InvalidRow(
            policy=f"{plan.letter(number)}: {plan.policies[number].policy}",
            trials=len(ours),
            chosen=sum(each.is_chosen for each in ours),
            stages=tuple(
                sum(each.stage == stage for each in ours)
                for stage in range(plan.task.max_stage + 1)
            ),
            stops=counts_text(each.fault or "" for each in ours),
        )
        for number, ours in enumerate(found)
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class TrialsReport:
    """Results of all trials so far."""

    plan: TrialsPlan
    policies: tuple[PolicyResult, ...]
    """Results of the policies, letter by letter."""
    invalid: tuple[tuple[str, int], ...]
    """Number of invalid trials by reason."""
    invalid_by_policy: tuple[InvalidRow, ...]
    """The same policy by policy; empty while names are hidden, and where none is invalid."""
    missing: int
    differing: str
    """Sentences on what is missing of what the log tells; empty if nothing."""
    pairs: tuple[Pair, ...]
    """Any two policies against each other."""
    rigs: str
    """The states of the rig's file that trials were played on; empty without one."""
    objection: str
    """Objection of the doctor against the rig as it is now; empty without one."""
    doctor: Report | None
    """Last report of the doctor on the rig; None without one."""


def write_trials_report(folder: TrialsFolder) -> TrialsReport:
    """Write the reports of all policies, their comparison, and the page that leads to them.

    While trials are missing, a blind evaluation gets no report: its names stay hidden.
    """
    plan, differing = folder.read_plan(), folder.compared()
    progress = TrialsProgress.of(folder.read_log())
    missing = len(folder.remaining(plan, progress))
    is_shown = not (plan.blind and missing)
    parts: list[RunPart] = []
    if is_shown and folder.run.has_records:
        write_report(folder.run)
        parts = read_parts(folder.run)
    policies = [
        PolicyResult(
            letter=plan.letter(number),
            policy=part.candidate.policy,
            page=f"{CONDITIONS}/{part.condition.name}/" if len(parts) > 1 else "",
            trained_on=part.candidate.trained_on,
            score=part.results.overall,
            stops=counts_text(
                each.judged.fault or "" for each in part.records if each.judged
            ),
        )
        for number, part in enumerate(parts)
        if part.records
    ]
    pairs: tuple[Pair, ...] = ()
    if len(policies) > 1:
        pairs = compare_parts(part for part in parts if part.records).pairs
    doctor = read_checks(folder.path)
    reasons = Counter(one.reason for each in progress.invalid.values() for one in each)
    report = TrialsReport(
        plan=plan,
        policies=tuple(policies),
        invalid=tuple(sorted(reasons.items())),
        invalid_by_policy=invalid_rows(plan, progress) if is_shown and reasons else (),
        missing=missing,
        differing=differing,
        pairs=pairs,
        rigs=rig_text(record for part in parts for record in part.records),
        objection=doctor.objection(Rig.read(folder.rig).hash) if doctor else "",
        doctor=doctor,
    )
    shown = {"report": report, "plan": plan, "scores": scores, "text": tables}
    write(folder.page, render("duobench.real.sessions", "trials.html.j2", **shown))
    return report
