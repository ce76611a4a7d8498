"""Verifying a run: the joint targets in its records are played again, without the policy.

What a record says about its episode must come out again. What a replay cannot find (the policy's
name, versions, the text of an error) is covered by the checksum of the record, which shows that a
file was changed, not that somebody computed a new one.
"""

import operator
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
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
from duobench.core.versions import differing_arithmetic
from duobench.data.processes import Progress, run_all
from duobench.envs import action_modes
from duobench.evaluation.replay.player import RecordPlayer, actual_task, why_not
from duobench.results.attempts import ERROR, FAILURE, SUCCESS
from duobench.results.folder import RunFolder, RunReader
from duobench.results.journal import end_of
from duobench.results.records import EpisodeRecord, Key
from duobench.results.run import Run
from duobench.results.scores import RunPart, group_by_condition

TOLERANCE = 1e-6
"""Difference of a pose that another processor may make, in metres or in parts of a quaternion."""
LONGEST_CLAIM = 120
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
    """What a replay says about a record."""

    EXACT = "exact"
    STAGES = "stages only"
    """Layout, stages and end agree; the bits need not be those of this processor, and are not."""
    ERROR = "up to an error"
    """Everything is equal to the bit until an error ended the episode."""
    UNVERIFIABLE = "not verifiable"
    CONTRADICTED = "contradicted"
    """Something comes out differently, or the record cannot be read."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Finding:
    """What was found out about one record."""

    key: Key
    verdict: Verdict
    reason: str = ""
    """Why it is not verifiable or not equal to the bit, or what the record says and what its
    replay gives, in one line; empty where it agrees."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Verification:
    """What was found out about a run."""

    run: Run
    findings: tuple[Finding, ...]
    """One for each record, in the order of the run."""
    objections: tuple[str, ...] = ()
    """What the run says wrongly of its tasks, and its report of its records, one sentence each."""
    unnoted: int = 0
    """Of how many records no attempt is noted, so that earlier ones cannot be ruled out."""
    missing: int = 0
    """Episodes of the run that have no record."""
    parts: tuple[RunPart, ...] = ()
    """What is verified adds up to, under each condition: nothing that is contradicted, what cannot
    be verified as failures that reached no stage, and nothing after the horizon."""
    compared_in_numbers: tuple[str, ...] = ()
    """Pages of other software, or of a run without journals: their words were not compared."""

    def of(self, *verdicts: Verdict) -> list[Finding]:
        """The findings with one of these verdicts."""
        return [finding for finding in self.findings if finding.verdict in verdicts]

    @property
    def is_verified(self) -> bool:
        """Whether nothing is contradicted, and something was verified."""
        agreeing = self.of(Verdict.EXACT, Verdict.STAGES, Verdict.ERROR)
        return bool(agreeing) and not self.objections and not self.of(Verdict.CONTRADICTED)


def verify(
    source: RunReader,
    *,
    wanted: Container[Key] | None = None,
    workers: int = 0,
    import_tasks: bool = False,
    progress: Progress = lambda _done, _total: None,
) -> Verification:
    """Play the joint targets in the records of a run again, and compare what comes out.

    Layout, first state, stages, end and last state must come out again: to the bit with the same
    MuJoCo and NumPy on x86-64 processors with AVX2, elsewhere in stages and outcome alone.

    Args:
        source: The run; see `duobench.results.bundle.open_source`.
        wanted: Episodes to verify; all without.
        workers: Processes that verify side by side; 0 verifies in this process. See `run_all`.
        import_tasks: Whether to import tasks that are not of the benchmark, which runs the code of
            the modules that the run names. Their episodes are not verifiable without.
        progress: Told about the progress, in episodes.

    Returns:
        What was found out; a record that cannot be read is contradicted.

    Raises:
        EvaluationError: There is no run.
        OtherRunError: The source has the salt of another run.
        FileError: The run cannot be read.
        DataError: A process ended by itself.
    """
    run = source.read_run()
    if source.salt and source.salt.sha256 != run.suite.salt:
        given, expected = source.salt.sha256, run.suite.salt or "no salt"
        raise OtherRunError(f"The SHA-256 of the salt is {given}; the run says {expected}.")
    unknown, objections = _check_tasks(run, import_tasks)
    findings: dict[Key, Finding] = {}
    jobs: list[EpisodeRecord] = []
    records: list[EpisodeRecord] = []
    there, attempts = source.finished(run), source.attempts()
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
        elif reason := unknown.get(record.task) or why_not(record):
            findings[key] = _finding(key, Verdict.UNVERIFIABLE, reason)
        else:
            jobs.append(record)
    progress(len(findings), len(keys))
    with closing(run_all(partial(_checker, run, import_tasks), jobs, workers)) as results:
        for finding in results:
            findings[finding.key] = finding
            progress(len(findings), len(keys))
    others: list[str] = []
    if isinstance(source, RunFolder) and len(records) == len(keys):  # else no report can be written
        from duobench.results.report import check_report  # draws, which no worker needs

        wrong, others = check_report(source, group_by_condition(run, records))
        objections += map(escaped, wrong)
    return Verification(
        run=run,
        findings=tuple(map(findings.__getitem__, keys)),
        objections=tuple(objections),
        unnoted=0 if run.is_real else sum(key.path not in attempts for key in keys),
        missing=run.size - len(there),
        parts=_parts(run, ((record, findings[record.key].verdict) for record in records)),
        compared_in_numbers=tuple(others),
    )


def _parts(run: Run, each: Iterable[tuple[EpisodeRecord, Verdict]]) -> tuple[RunPart, ...]:
    """What records add up to as far as they are verified; see `Verification.parts`."""
    records = [
        record.unproven if verdict is Verdict.UNVERIFIABLE else record
        for record, verdict in each
        if verdict is not Verdict.CONTRADICTED
    ]
    shown = replace(run, suite=replace(run.suite, overtime=1.0))
    return tuple(group_by_condition(shown, records))


def _finding(key: Key, verdict: Verdict, reason: str = "") -> Finding:
    return Finding(key=key, verdict=verdict, reason=" ".join(escaped(reason).split()))


def _check_tasks(run: Run, import_tasks: bool) -> tuple[Mapping[str, str], list[str]]:
    """Why tasks of a run cannot be played, by id, and what the run says wrongly of others."""
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


def _other_versions(run: Run, record: EpisodeRecord) -> str:
    """What was installed for a record and not for its run; empty if nothing."""
    return "; ".join(
        f"its version of {name} is {record.versions.get(name)}, that of the run {version}"
        for name, version in run.versions.items()
        if record.versions.get(name) != version
    )


def _other_attempts(noted: Mapping[str, Sequence[str]], record: EpisodeRecord) -> str:
    """What was noted of attempts and a record says otherwise; empty if nothing."""
    ends = noted.get(record.key.path)
    if ends is None:
        return ""
    if (record.attempt, *record.earlier) == (len(ends), *ends[:-1]):
        # Whoever was killed before the record's end was noted has noted none, or why it is lost.
        is_told = ends[-1] == end_of(record) or ends[-1] not in {SUCCESS, FAILURE, ERROR}
        return "" if is_told else f"it is a {end_of(record)}; the journal says: {ends[-1]}"
    claimed, known = (", ".join(each) or "none" for each in (record.earlier, ends[:-1]))
    return f"its earlier attempts ended so: {claimed}; the journal says: {known}"


def _checker(run: Run, import_tasks: bool) -> Callable[[EpisodeRecord], Finding]:
    """What checks one record after the other; it keeps the environment of one for the next."""
    return partial(_check, RecordPlayer(run, import_tasks=import_tasks))


def _check(player: RecordPlayer, record: EpisodeRecord) -> Finding:
    try:
        replay = player.replay(record)
    except DuoBenchError as error:
        reason = f"its targets cannot be played: {error}"
        return _finding(record.key, Verdict.CONTRADICTED, reason)
    different, bits = disagreements(record, replay), differing_bits(record, replay)
    elsewhere = differing_arithmetic(record.versions)
    if different or (bits and not elsewhere):
        reason = "; ".join(dict.fromkeys([*different, *bits]))
        return _finding(record.key, Verdict.CONTRADICTED, reason)
    if bits:
        reason = f"{', '.join(elsewhere)}: {'; '.join(bits)}"
        return _finding(record.key, Verdict.STAGES, reason)
    return _finding(record.key, Verdict.EXACT if record.error is None else Verdict.ERROR)


def disagreements(record: EpisodeRecord, replay: EpisodeRecord) -> list[str]:
    """What a record claims and its replay does not show, though it would on any processor.

    The replay has the same error. What both say is one phrase each.
    """
    found = _different(_outcome(record), _outcome(replay))
    found += _different(_poses(record), _poses(replay), _is_close)
    is_over = replay.terminated or replay.truncated
    if record.error is None and record.steps == replay.steps and not is_over:
        found.append(f"the episode is not over after {record.steps} steps")
    return found


def differing_bits(record: EpisodeRecord, replay: EpisodeRecord) -> list[str]:
    """What in a record is not equal to the bit to its replay; on other processors it need not be.

    See `disagreements`. Words on what the next stage lacks are none where the last step failed.
    """
    if record.unmet is None:
        replay = replace(replay, unmet=None)
    return _different(_bits(record), _bits(replay))


def _outcome(record: EpisodeRecord) -> dict[str, Any]:
    variants = record.layout.get("variants", {})
    return {
        **{name: getattr(record, name) for name in _OUTCOME},
        **{f"variant {name}": value for name, value in variants.items()},
    }


def _poses(record: EpisodeRecord) -> dict[str, Any]:
    return {f"start of {name}": pose for name, pose in record.layout.get("poses", {}).items()}


def _bits(record: EpisodeRecord) -> dict[str, Any]:
    # What relative Cartesian actions add up to is part of it, and not of what was sent.
    is_relative = record.config.action_mode == action_modes.CARTESIAN_RELATIVE.name
    start, end = record.start, record.end
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
    return np.allclose(claimed, shown, rtol=0, atol=TOLERANCE)


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
