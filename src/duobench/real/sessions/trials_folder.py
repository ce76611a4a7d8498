"""The folder of an evaluation on real arms: its plan, its log, and the run of its policies.

The log holds every press of a person as one JSON object a line. A line is handed to the operating
system before its effect is shown, so that a killed process loses none. The end of a trial is
flushed to the disk as well. A trial that the log does not close was cut, and is played again.
"""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import msgspec

from duobench.core import files
from duobench.core.errors import EvaluationError, FileError, OtherRunError
from duobench.real.doctor.checks import DOCTOR_FILE
from duobench.real.rig import Rig
from duobench.real.sessions.trials_plan import PLAN_SCHEMA, RigEpisode, TrialsPlan
from duobench.results.folder import RUN_BEGINNINGS, RunFolder
from duobench.results.labels import FaultKind, StageLabel, StageLabels
from duobench.results.records import InvalidTrial
from duobench.world.robot.cameras import HEAD

DESCRIPTION = "trials.json"
"""The file that holds the plan."""
TRIALS_BEGINNINGS = (
    DESCRIPTION,
    "rig.json",
    "rigs/*.json",
    "log.jsonl",
    *RUN_BEGINNINGS,
)
"""Files that an evaluation begins with; without a trial they are worth nothing."""
REMOVED = "It counted, and its record was removed, to play it again."
CUT = "The program ended during the trial."
"""Reason why a trial is invalid whose process was killed."""


class LogKind(StrEnum):
    """Kind of an entry."""

    BEGIN = "begin"
    """A trial begins: objects are to be placed."""
    PLACED = "placed"
    START = "start"
    """The policy begins to play."""
    PRESS = "press"
    """A stage was pressed, or a press taken back."""
    HOLD = "hold"
    NOT_BEGUN = "not_begun"
    """The arms were held before the policy's first command: it may be started again."""
    END = "end"
    """The policy plays no more."""
    AT_END = "at_end"
    """Whether the last stage still held at the end."""
    NOTE = "note"
    VALID = "valid"
    """The trial counts."""
    INVALID = "invalid"
    """The trial does not count, and is played again."""


_CLOSING = (LogKind.VALID, LogKind.INVALID)


class LogEntry(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One line of the log."""

    kind: LogKind
    trial: int
    attempt: int
    """Number of the attempt at the trial, from 1 on."""
    text: str = ""
    """Reason of an end, a hold or an invalid trial; a note; what plays."""
    stage: int | None = None
    """Stage of a press; None takes the latest one back."""
    step: int | None = None
    """Control steps of the episode by then."""
    time_s: float | None = None
    """Seconds of the episode by then, on the rig's clock."""
    yes: bool | None = None
    """Whether the last stage still held; whether a press came late; whether an invalid trial could
    not have counted, so that no person chose."""
    fault: FaultKind | None = None
    """Kind of the fault that stopped the arms, of an end and of an invalid trial."""
    at: str = ""
    """Date and time of day in UTC, for people; nothing depends on it."""


@dataclass(kw_only=True, slots=True)
class TrialsProgress:
    """Progress of an evaluation, by its log."""

    valid: dict[int, int] = field(default_factory=dict[int, int])
    """Attempt that counts, by the trial's number."""
    attempts: dict[int, int] = field(default_factory=dict[int, int])
    """Attempts at each trial, by its number."""
    invalid: dict[int, list[InvalidTrial]] = field(
        default_factory=dict[int, list[InvalidTrial]]
    )
    """Attempts that do not count, by the trial's number."""
    presses: dict[int, list[tuple[int | None, int]]] = field(default_factory=dict)
    """Stage and control step of each press in the attempt that counted last."""
    cut: tuple[int, int] | None = None
    """Trial and attempt that was being played when the log ended; None if none was."""

    @staticmethod
    def of(entries: Iterable[LogEntry]) -> TrialsProgress:
        """Return the progress that a log adds up to."""
        progress = TrialsProgress()
        labels, fault = StageLabels(), None
        counted: dict[int, InvalidTrial] = {}
        for entry in entries:
            match entry.kind:
                case LogKind.BEGIN:
                    if progress.valid.pop(entry.trial, None) is not None:
                        progress.invalid.setdefault(entry.trial, []).append(
                            counted[entry.trial]
                        )
                    progress.attempts[entry.trial] = entry.attempt
                    labels, fault = StageLabels(), None
                case LogKind.PRESS:
                    label = StageLabel(
                        stage=entry.stage, step=entry.step or 0, time_s=0.0
                    )
                    labels = StageLabels((*labels.all, label))
                case LogKind.END:
                    fault = entry.fault
                case LogKind.START:
                    progress.cut = entry.trial, entry.attempt
                case LogKind.NOT_BEGUN:
                    labels, progress.cut = StageLabels(), None
                case LogKind.VALID:
                    progress.valid[entry.trial], progress.cut = entry.attempt, None
                    progress.presses[entry.trial] = [
                        (one.stage, one.step) for one in labels.all
                    ]
                    counted[entry.trial] = InvalidTrial(
                        reason=REMOVED, stage=labels.stage, fault=fault, is_chosen=True
                    )
                case LogKind.INVALID:
                    found = InvalidTrial(
                        reason=entry.text,
                        stage=labels.stage,
                        fault=entry.fault or fault,
                        is_chosen=not entry.yes,
                    )
                    progress.invalid.setdefault(entry.trial, []).append(found)
                    progress.cut = None
                case _:
                    pass
        return progress


class TrialLog:
    """A log that is written by one process, from any of its threads.

    Opening it creates a missing file, and removes half a line that a killed process left.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        files.make_folder(path.parent)
        with files.writing(path):
            self._file = path.open("ab", buffering=0)
            content = path.read_bytes()
            whole = content.rfind(b"\n") + 1
            if whole < len(content):
                self._file.truncate(whole)
        self._entries = list(read_entries(path))

    @property
    def entries(self) -> tuple[LogEntry, ...]:
        """Everything so far."""
        with self._lock:
            return tuple(self._entries)

    def add(self, entry: LogEntry) -> None:
        """Write a line; when this returns, the end of this process loses nothing of it."""
        said = msgspec.to_builtins(entry)
        if entry.kind is LogKind.PRESS:
            said["stage"] = entry.stage  # null takes a press back
        line = msgspec.json.encode(said) + b"\n"
        with self._lock, files.writing(self.path):
            end = self._file.seek(0, os.SEEK_END)
            if self._file.write(line) != len(line):  # there is no room for the rest
                self._file.truncate(end)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            if entry.kind in _CLOSING:  # a press shall not wait for a disk
                os.fsync(self._file.fileno())
            self._entries.append(entry)

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()


def read_entries(path: Path) -> Iterable[LogEntry]:
    """The lines of a log; half a line at the end is left out."""
    try:
        lines = path.read_bytes().split(b"\n")[:-1]
        return [msgspec.json.decode(line, type=LogEntry) for line in lines]
    except (OSError, msgspec.MsgspecError, RecursionError) as error:
        raise FileError(f"{path} cannot be read as a log of trials: {error}") from error


class TrialsFolder:
    """Names in the folder, and how it is begun, continued and read."""

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()  # now: a policy may change the working folder
        self.description = self.path / DESCRIPTION
        self.log_file = self.path / "log.jsonl"
        self.rig = self.path / "rig.json"
        """The rig's file, as it was last."""
        self.page = self.path / "index.html"
        self.run = RunFolder(self.path / "run")
        """Records, films and report of all policies."""

    def placed(self, trial: int, attempt: int) -> Path:
        """Image of the head camera when the objects were placed."""
        return self.path / "placed" / f"{trial:04d}.{attempt}.jpg"

    def invalid_film(self, trial: int, attempt: int) -> Path:
        """Film of a trial that does not count."""
        return self.path / "invalid" / f"{trial:04d}.{attempt}.webm"

    def check_rig(self, rig: Rig) -> None:
        """Reject another rig than that of the evaluation here; one measured again is the same."""
        if not self.rig.exists():
            return
        now, before = rig.chosen, Rig.read(self.rig).chosen
        places = {**before, **now}
        found = files.differences(
            *({place: each.get(place) for place in places} for each in (now, before))
        )
        if found:
            raise OtherRunError(
                f"{self.path} holds an evaluation on another rig; this one has {'; '.join(found)}. "
                "While an evaluation goes on, only its name, its grippers' ends and its cameras' "
                "calibrations may change."
            )

    def keep_rig(self, rig: Rig) -> None:
        """Write the file of the rig as it is now, beside those that it had before."""
        rig.write(self.path / "rigs" / f"{rig.hash}.json")
        rig.write(self.rig)

    def begin(self, plan: TrialsPlan) -> TrialsPlan:
        """Begin an evaluation, or continue the one that is there, perhaps with more episodes.

        Returns:
            The plan that holds: with letters and order of the one that is there already.
        """
        if self.description.exists():
            plan = plan.ordered_as(self.read_plan())
        files.begin_or_continue(
            self.path,
            self.description,
            plan,
            PLAN_SCHEMA,
            what="evaluation on real arms",
            kept=(DOCTOR_FILE,),
        )
        files.write(self.description, files.encode(plan, PLAN_SCHEMA))
        return plan

    def read_plan(self) -> TrialsPlan:
        """The plan."""
        if not self.description.exists():
            raise EvaluationError(
                f"{self.path} holds no evaluation on real arms: {DESCRIPTION} is missing."
            )
        return files.read(self.description, TrialsPlan, PLAN_SCHEMA)

    def open_log(self, at: str) -> TrialLog:
        """The log to write on; a trial that was cut is closed as invalid first.

        One that was over is told as a person's choice: who ended the program had seen the outcome.
        """
        log = TrialLog(self.log_file)
        cut = TrialsProgress.of(log.entries).cut
        if cut is not None:
            is_seen = any(
                entry.kind is LogKind.END
                and (entry.trial, entry.attempt) == cut
                and (entry.fault is None or entry.fault.may_count)
                for entry in log.entries
            )
            trial, attempt = cut
            log.add(
                LogEntry(
                    kind=LogKind.INVALID,
                    trial=trial,
                    attempt=attempt,
                    text=CUT,
                    yes=not is_seen,
                    at=at,
                )
            )
        return log

    def read_log(self) -> list[LogEntry]:
        """The log as it is; nothing before the first trial."""
        return list(read_entries(self.log_file)) if self.log_file.exists() else []

    def remaining(self, plan: TrialsPlan, progress: TrialsProgress) -> list[RigEpisode]:
        """Trials that are still to be played, in the order of the plan."""
        return [
            trial
            for trial in plan.trials()
            if trial.number not in progress.valid
            or not self.run.record(plan.key(trial)).exists()
        ]

    def compared(self) -> str:
        """Compare plan, log and files; what is missing, in sentences, empty if nothing is.

        Raises:
            EvaluationError: The log or a record is of no trial here, so that nothing goes on.
        """
        plan, progress = self.read_plan(), TrialsProgress.of(self.read_log())
        numbers = {plan.key(trial): trial.number for trial in plan.trials()}
        records = {numbers[each.key]: each for each in self.run.read_records(plan.run)}
        has_camera = self.rig.exists() and HEAD in Rig.read(self.rig).cameras
        foreign = dict.fromkeys(
            progress.attempts.keys() - numbers.values(), self.log_file
        )
        unseen = set[int]()
        for number, record in records.items():
            attempt = progress.valid.get(number, 0)
            presses = record.judged and [
                (one.stage, one.step) for one in record.judged.presses
            ]
            is_other = attempt and presses != progress.presses[number]
            if is_other or number not in progress.attempts:
                foreign[number] = self.run.record(record.key)
            film, photo = self.run.video(record.key), self.placed(number, attempt)
            is_seen = photo.exists() and (film.exists() or not record.steps)
            if has_camera and attempt and not is_seen:
                unseen.add(number)
        if foreign:
            raise EvaluationError(
                f"{foreign[min(foreign)]} is of another evaluation, or one of {DESCRIPTION} and "
                f"{self.log_file.name} was changed: they do not agree on trial {min(foreign) + 1}; "
                f"such trials: {len(foreign)}. Put back what was there; a trial whose record is "
                "moved away comes again."
            )
        found = (
            (
                "counted, have no record now, and come again",
                progress.valid.keys() - records,
            ),
            (
                "have a record that does not count, and come again",
                records.keys() - progress.valid,
            ),
            ("lack a photo or film", unseen),
        )
        return " ".join(
            f"Trials that {what}: {len(trials)}, such as number {min(trials) + 1}."
            for what, trials in found
            if trials
        )
