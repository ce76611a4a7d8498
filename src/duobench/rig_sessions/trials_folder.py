"""The folder of an evaluation on real arms: its plan, its log, and the run of its policies."""

from __future__ import annotations

from pathlib import Path

from duobench.errors import EvaluationError
from duobench.files import begin_or_continue, encode, read, write
from duobench.hardware.doctor.checks import DOCTOR_FILE
from duobench.results.folder import RunFolder
from duobench.rig_sessions.trials_log import (
    LogEntry,
    LogKind,
    TrialLog,
    TrialsProgress,
    read_entries,
)
from duobench.rig_sessions.trials_plan import PLAN_SCHEMA, RigEpisode, TrialsPlan

DESCRIPTION = "trials.json"
"""The file that holds the plan."""
CUT = "The program ended during the trial."
"""Why a trial is invalid whose process was killed."""


class TrialsFolder:
    """Names in the folder, and how it is begun, continued and read."""

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()  # now: a policy may change the working folder
        self.description = self.path / DESCRIPTION
        self.log_file = self.path / "log.jsonl"
        self.rig = self.path / "rig.json"
        """The rig's file, as it was."""
        self.page = self.path / "index.html"
        self.run = RunFolder(self.path / "run")
        """Records, films and report of all policies."""

    def placed(self, trial: int, attempt: int) -> Path:
        """What the head camera saw when the objects were placed."""
        return self.path / "placed" / f"{trial:04d}.{attempt}.jpg"

    def invalid_film(self, trial: int, attempt: int) -> Path:
        """Film of a trial that does not count."""
        return self.path / "invalid" / f"{trial:04d}.{attempt}.webm"

    def begin(self, plan: TrialsPlan) -> TrialsPlan:
        """Begin an evaluation, or continue the one that is there, perhaps with more episodes.

        Returns:
            The plan that holds: with letters and order of the one that is there already.

        Raises:
            OtherRunError: The folder holds another one, or files that belong to none.
            FileError: The plan that is there cannot be read.
            OutputError: Nothing can be written.
        """
        if self.description.exists():
            plan = plan.ordered_as(self.read_plan())
        begin_or_continue(
            self.path,
            self.description,
            plan,
            PLAN_SCHEMA,
            what="evaluation on real arms",
            kept=(DOCTOR_FILE,),
        )
        write(self.description, encode(plan, PLAN_SCHEMA))
        return plan

    def read_plan(self) -> TrialsPlan:
        """The plan.

        Raises:
            EvaluationError: There is none.
            FileError: It cannot be read.
        """
        if not self.description.exists():
            raise EvaluationError(
                f"{self.path} holds no evaluation on real arms: {DESCRIPTION} is missing."
            )
        return read(self.description, TrialsPlan, PLAN_SCHEMA)

    def open_log(self, at: str) -> TrialLog:
        """The log to write on; a trial that was cut is closed as invalid first, at a date and time.

        Raises:
            FileError: It is damaged.
            OutputError: It cannot be written.
        """
        log = TrialLog(self.log_file)
        if (cut := TrialsProgress.of(log.entries).cut) is not None:
            about = {"trial": cut[0], "attempt": cut[1]}
            log.add(LogEntry(kind=LogKind.INVALID, **about, text=CUT, yes=True, at=at))
        return log

    def read_log(self) -> list[LogEntry]:
        """The log as it is; nothing before the first trial."""
        return list(read_entries(self.log_file)) if self.log_file.exists() else []

    def remaining(self, plan: TrialsPlan, progress: TrialsProgress) -> list[RigEpisode]:
        """Trials that are still to be played, in the order of the plan."""
        return [
            trial
            for trial in plan.trials()
            if trial.number not in progress.valid or not self._record(plan, trial).exists()
        ]

    def _record(self, plan: TrialsPlan, trial: RigEpisode) -> Path:
        policy = plan.policies[trial.policy].policy
        return self.run.record(plan.run.key(plan.episode(trial), policy))
