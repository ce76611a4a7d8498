"""Verification of a run: the joint targets in its records are played again, without the policy.

The claims of a record about its episode must come out again. Claims that a replay cannot check (the
policy's name, versions, the text of an error) are covered by the checksum of the record, which
shows that a file was changed, but not that its checksum was computed anew.
"""

import operator
from collections import Counter
from collections.abc import (
    Callable,
    Container,
    Iterable,
    Mapping,
    Sequence,
)
from contextlib import closing
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from typing import Any

import numpy as np

from duobench.core.errors import (
    DuoBenchError,
    ImportPathError,
    OtherRunError,
    UnknownNameError,
    escaped,
)
from duobench.core.processes import Progress, run_all
from duobench.core.versions import differing_arithmetic
from duobench.envs import action_modes
from duobench.evaluation.replay.player import RecordPlayer, actual_task, why_not
from duobench.results.attempts import ERROR, FAILURE, SUCCESS
from duobench.results.entrants import ReplayCheck
from duobench.results.folder import RunReader
from duobench.results.journal import end_of
from duobench.results.records import Key, Record
from duobench.results.run import Run
from duobench.results.scores import RunPart, group_by_condition

TOLERANCE = 1e-6
"""Difference of a pose that another processor may make, in metres or in parts of a quaternion."""
LONGEST_CLAIM = 120
"""Characters of a claim that are shown."""
_OUTCOME = (
    "seed",
    "horizon",
    "max_stage",
    "steps",
    "stage_changes",
    "final_stage",
    "success",
    "success_at_end",
    "terminated",
    "truncated",
    "instruction",
)


class Verdict(StrEnum):
    """Verdict of a replay on a record."""

    EXACT = "exact"
    STAGES = "stages only"
    """Layout, stages and outcome agree; the bits differ, as they may on another processor."""
    ERROR = "up to an error"
    """Everything is equal to the bit until an error ended the episode."""
    UNVERIFIABLE = "not verifiable"
    CONTRADICTED = "contradicted"
    """Something comes out differently, or the record cannot be read."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Finding:
    """Verdict on one record, with its reason."""

    key: Key
    verdict: Verdict
    reason: str = ""
    """Reason in one line: why the record cannot be verified, or how it differs from its replay;
    empty if it agrees."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Verification:
    """Verdicts on the records of a run, and their scores."""

    run: Run
    findings: tuple[Finding, ...]
    """One for each record, in the order of the run."""
    objections: tuple[str, ...] = ()
    """Contradictions between the run and its tasks, one sentence each."""
    unnoted: int = 0
    """Number of records without a noted attempt; earlier attempts at them cannot be ruled out."""
    missing: int = 0
    """Episodes of the run that have no record."""
    parts: tuple[RunPart, ...] = ()
    """Scores of the verified records under each condition. Contradicted records are left out, and
    those that cannot be verified count as failures that reached no stage."""

    def of(self, *verdicts: Verdict) -> list[Finding]:
        """The findings with one of these verdicts."""
        return [finding for finding in self.findings if finding.verdict in verdicts]

    @property
    def is_verified(self) -> bool:
        """Whether nothing is contradicted, and something was verified."""
        agreeing = self.of(Verdict.EXACT, Verdict.STAGES, Verdict.ERROR)
        return (
            bool(agreeing) and not self.objections and not self.of(Verdict.CONTRADICTED)
        )


def verify(
    source: RunReader,
    *,
    wanted: Container[Key] | None = None,
    workers: int = 0,
    import_tasks: bool = False,
    progress: Progress = lambda _done, _total: None,
) -> Verification:
    """Play the joint targets in the records of a run again, and compare the episodes.

    Layout, first state, stages, end and last state must come out again: to the bit with the same
    MuJoCo and NumPy on x86-64 processors with AVX2, elsewhere in stages and outcome alone.

    Args:
        source: The run; see `duobench.results.bundle.open_source`.
        wanted: Episodes to verify; None verifies all.
        workers: Processes that verify side by side; 0 verifies in this process. See `run_all`.
        import_tasks: Whether to import tasks that are not of the benchmark, which runs the code of
            the modules that the run names. Otherwise their episodes are not verifiable.
        progress: Told about the progress, in episodes.

    Returns:
        Verdicts and scores; a record that cannot be read is contradicted.

    Raises:
        EvaluationError: There is no run.
        FileError: The run cannot be read.
        DataError: A process ended by itself.
    """
    run = source.read_run()
    unknown, objections = _check_tasks(run, import_tasks)
    findings: dict[Key, Finding] = {}
    jobs: list[Record] = []
    records: list[Record] = []
    there = source.finished(run)
    attempts = source.attempts()
    keys = [key for key in there if wanted is None or key in wanted]
    for key in keys:
        try:
            record = source.read_record(run, key)
        except OtherRunError:
            raise
        except DuoBenchError as error:
            findings[key] = _finding(key, Verdict.CONTRADICTED, str(error))
            continue
        records.append(record)
        wrong = _other_versions(run, record) or _other_attempts(attempts, record)
        if wrong:
            findings[key] = _finding(key, Verdict.CONTRADICTED, wrong)
            continue
        reason = unknown.get(record.task) or why_not(record)
        if reason:
            findings[key] = _finding(key, Verdict.UNVERIFIABLE, reason)
        else:
            jobs.append(record)
    progress(len(findings), len(keys))
    with closing(
        run_all(partial(_checker, run, import_tasks), jobs, workers)
    ) as results:
        for finding in results:
            findings[finding.key] = finding
            progress(len(findings), len(keys))
    return Verification(
        run=run,
        findings=tuple(map(findings.__getitem__, keys)),
        objections=tuple(objections),
        unnoted=0 if run.is_real else sum(key.path not in attempts for key in keys),
        missing=run.size - len(there),
        parts=_parts(
            run, ((record, findings[record.key].verdict) for record in records)
        ),
    )


def checks(found: Verification) -> dict[str, ReplayCheck]:
    """Return the result of a verification for each condition that has a record, by its name."""
    by_condition: dict[str, list[Finding]] = {}
    for finding in found.findings:
        by_condition.setdefault(finding.key.condition, []).append(finding)
    return {
        name: _check_of(findings, found.objections)
        for name, findings in by_condition.items()
    }


def _check_of(findings: Sequence[Finding], objections: Sequence[str]) -> ReplayCheck:
    counts = Counter(finding.verdict for finding in findings)
    unverifiable = counts[Verdict.UNVERIFIABLE]
    if objections or counts[Verdict.CONTRADICTED] or unverifiable == len(findings):
        verified = "no"
    else:
        verified = "in part" if unverifiable else "yes"
    said = [f"{verdict} {counts[verdict]}" for verdict in Verdict if counts[verdict]]
    wrong = [
        f"{finding.key.task}, episode {finding.key.episode}: {finding.reason}"
        for verdict in (Verdict.CONTRADICTED, Verdict.UNVERIFIABLE)
        for finding in findings
        if finding.verdict is verdict
    ]
    first = [*objections, *wrong][:1]
    return ReplayCheck(
        verified=verified,
        details=". ".join([", ".join(said), *(_short(each) for each in first)]),
    )


def _parts(run: Run, each: Iterable[tuple[Record, Verdict]]) -> tuple[RunPart, ...]:
    """Return the scores of records as far as they are verified; see `Verification.parts`."""
    records = [
        record.unproven if verdict is Verdict.UNVERIFIABLE else record
        for record, verdict in each
        if verdict is not Verdict.CONTRADICTED
    ]
    return tuple(group_by_condition(run, records))


def _finding(
    key: Key,
    verdict: Verdict,
    reason: str = "",
) -> Finding:
    return Finding(key=key, verdict=verdict, reason=" ".join(escaped(reason).split()))


def _check_tasks(run: Run, import_tasks: bool) -> tuple[Mapping[str, str], list[str]]:
    """Return why tasks of a run cannot be played, by id, and false claims about the others."""
    unknown: dict[str, str] = {}
    objections: list[str] = []
    for claimed in run.suite.tasks:
        try:
            actual = actual_task(claimed, import_tasks=import_tasks)
        except (UnknownNameError, ImportPathError) as error:
            unknown[claimed.id] = str(error)
            continue
        objections += [
            f"The run says of {claimed.id} that its {name} is {getattr(claimed, name)}, not "
            f"{getattr(actual, name)}."
            for name in ("id", "category", "max_stage", "horizon")
            if getattr(claimed, name) != getattr(actual, name)
        ]
    return unknown, [escaped(sentence) for sentence in objections]


def _other_versions(run: Run, record: Record) -> str:
    """Return the differences between the versions of a record and its run; empty if equal."""
    return "; ".join(
        f"its version of {name} is {record.versions.get(name)}, that of the run {version}"
        for name, version in run.versions.items()
        if record.versions.get(name) != version
    )


def _other_attempts(noted: Mapping[str, Sequence[str]], record: Record) -> str:
    """Return the differences between noted attempts and a record; empty if equal."""
    ends = noted.get(record.key.path)
    if ends is None:
        return ""
    if (record.attempt, *record.earlier) == (len(ends), *ends[:-1]):
        # A process that was killed after it wrote the record has not noted how the attempt ended.
        is_noted = ends[-1] in {SUCCESS, FAILURE, ERROR}
        if is_noted and ends[-1] != end_of(record):
            return f"it is a {end_of(record)}; the journal says: {ends[-1]}"
        return ""
    claimed = ", ".join(record.earlier) or "none"
    known = ", ".join(ends[:-1]) or "none"
    return f"its earlier attempts ended so: {claimed}; the journal says: {known}"


def _checker(run: Run, import_tasks: bool) -> Callable[[Record], Finding]:
    """Return a function that checks a record, and keeps its environment for the next one."""
    return partial(_check, RecordPlayer(run, import_tasks=import_tasks))


def _check(player: RecordPlayer, record: Record) -> Finding:
    try:
        replay = player.replay(record)
    except DuoBenchError as error:
        reason = f"its targets cannot be played: {error}"
        return _finding(record.key, Verdict.CONTRADICTED, reason)
    different = disagreements(record, replay)
    bits = differing_bits(record, replay)
    elsewhere = differing_arithmetic(record.versions)
    if different or (bits and not elsewhere):
        reason = "; ".join(dict.fromkeys([*different, *bits]))
        return _finding(record.key, Verdict.CONTRADICTED, reason)
    if bits:
        reason = f"{', '.join(elsewhere)}: {'; '.join(bits)}"
        return _finding(record.key, Verdict.STAGES, reason)
    return _finding(
        record.key, Verdict.EXACT if record.error is None else Verdict.ERROR
    )


def disagreements(record: Record, replay: Record) -> list[str]:
    """Return claims of a record that its replay contradicts on any processor, one phrase each.

    The replay has the same error.
    """
    found = _different(_outcome(record), _outcome(replay))
    found += _different(_poses(record), _poses(replay), _is_close)
    is_over = replay.terminated or replay.truncated
    if record.error is None and record.steps == replay.steps and not is_over:
        found.append(f"the episode is not over after {record.steps} steps")
    return found


def differing_bits(record: Record, replay: Record) -> list[str]:
    """Return differences in bits, which another processor may cause, one phrase each.

    `unmet` is not compared where the record has none because its last step failed.
    """
    if record.unmet is None:
        replay = replace(replay, unmet=None)
    return _different(_bits(record), _bits(replay))


def _outcome(record: Record) -> dict[str, Any]:
    variants = record.layout.get("variants", {})
    return {
        **{name: getattr(record, name) for name in _OUTCOME},
        **{f"variant {name}": value for name, value in variants.items()},
    }


def _poses(record: Record) -> dict[str, Any]:
    return {
        f"start of {name}": pose
        for name, pose in record.layout.get("poses", {}).items()
    }


def _bits(record: Record) -> dict[str, Any]:
    # Its hash covers the sum of relative Cartesian actions, which the targets do not hold.
    is_relative = record.config.action_mode == action_modes.CARTESIAN_RELATIVE.name
    start = record.start
    end = record.end
    return {
        **_poses(record),
        "physics at the start": start and start.physics,
        "stages at the start": start and start.stages,
        "physics at the end": end and end.physics,
        "stages at the end": end and end.stages,
        "unmet": record.unmet,
        "state_hash": None if is_relative else record.state_hash,
    }


def _is_close(claimed: Any, shown: Any) -> bool:
    if claimed is None or shown is None:
        return False
    return np.allclose(
        claimed,
        shown,
        rtol=0,
        atol=TOLERANCE,
    )


def _different(
    claimed: Mapping[str, Any],
    shown: Mapping[str, Any],
    is_same: Callable[[Any, Any], bool] = operator.eq,
) -> list[str]:
    return [
        f"{name} is {_short(claimed.get(name))}, the replay gives {_short(shown.get(name))}"
        for name in {**claimed, **shown}
        if not is_same(claimed.get(name), shown.get(name))
    ]


def _short(claim: object) -> str:
    text = escaped(claim if isinstance(claim, str) else str(claim)).replace("\n", " ")
    return text if len(text) <= LONGEST_CLAIM else f"{text[:LONGEST_CLAIM]}…"
