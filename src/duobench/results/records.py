"""The record of one finished episode: everything that a table or a report is computed from.

A record holds no clock time and no name of a machine's folder: equal episodes give equal bytes.
"""

from __future__ import annotations

import hashlib
import re
import zlib
from dataclasses import dataclass, replace
from typing import (
    Annotated,
    ClassVar,
    NamedTuple,
    TypedDict,
)

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike

from duobench.core.errors import (
    EvaluationError,
    PolicyEndedError,
    PolicyFailedError,
    PolicyTimeoutError,
    traceback_text,
)
from duobench.core.types import FLAT_SIZE, Array
from duobench.envs.config import EnvConfig
from duobench.envs.execution import ChunkExecution
from duobench.results.attempts import ENDS
from duobench.results.excess import Excess
from duobench.results.labels import FaultKind, StageLabel, StageLabels
from duobench.tasks.shifts.shift import Shift

RECORD_SCHEMA = 12
"""Version of the record's fields; raised when a field is added, removed or changes its meaning."""
SIM, REAL, MIXED = "sim", "real", "mixed"
"""Domains in which episodes were played or recorded: in simulation, on real arms, or both."""
DOMAINS = (SIM, REAL)
_LONGEST_PART = 40

_SHORT, _LONG = (
    np.dtype("<f4"),
    np.dtype("<f8"),
)  # numbers that joint targets are kept as


@dataclass(frozen=True, kw_only=True, slots=True)
class Condition:
    """Condition of episodes: the policy, the domain and the way in which they are played."""

    policy: str
    domain: str
    """Domain in which it is played: "sim" or "real"."""
    shift: Shift
    look: str
    """Name of the look; "custom" for one that has none."""
    robot: str = ""
    """Gripper and mount that are not the paper's; empty where both are."""

    @classmethod
    def of(
        cls,
        policy: str,
        domain: str,
        config: EnvConfig,
    ) -> Condition:
        """The condition of episodes in environments of a configuration."""
        look = config.look if isinstance(config.look, str) else "custom"
        return cls(
            policy=policy,
            domain=domain,
            shift=config.shift,
            look=look,
            robot=config.other_robot,
        )

    @property
    def name(self) -> str:
        """Readable name of a folder, another one for every condition."""
        parts = [self.policy, self.domain, self.shift.name, self.look]
        if self.robot:
            parts.append(self.robot)
        return ".".join(map(_slug, parts))


def _slug(text: str) -> str:
    """A text as a part of a name; where that loses something, a hash tells it from others."""
    plain = re.sub(r"[^A-Za-z0-9_-]+", "-", text)[:_LONGEST_PART].strip("-")
    return (
        plain
        if plain == text
        else f"{plain}-{hashlib.sha256(text.encode()).hexdigest()[:6]}"
    )


class Key(NamedTuple):
    """Key of an episode in a run's folder: id of the task, name of the condition, and index."""

    task: str
    condition: str
    episode: int

    @property
    def path(self) -> str:
        """Path of its files in a folder of such files, without an ending."""
        return f"{self.task}/{self.condition}/{self.episode:05d}"


class SampledLayout(TypedDict, total=False):
    """Sample of the reset, as `Layout.to_json` gives it; empty if nothing was."""

    poses: dict[str, Annotated[list[float], Meta(min_length=7, max_length=7)]]
    """Positions in metres and quaternions [x, y, z, qx, qy, qz, qw], in the table frame."""
    variants: dict[str, str]


@dataclass(frozen=True, kw_only=True, slots=True)
class StateHashes:
    """Hashes of the state of an episode at one moment: equal states have equal hashes."""

    physics: str
    stages: str | None
    """SHA-256 of the stage and of what its constraints remember; None without stages."""


@dataclass(frozen=True, kw_only=True, slots=True)
class InvalidTrial:
    """A trial on real arms that does not count, and was played again."""

    reason: str
    stage: int = 0
    """Highest stage that had been pressed."""
    fault: FaultKind | None = None
    """Kind of the fault that stopped the arms; None if none did."""
    is_chosen: bool = False
    """Whether a person chose so, who had seen the outcome; otherwise it could not have counted."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Judged:
    """Judgement of an episode on real arms by a person."""

    rater: str
    """Pseudonym of the rater."""
    presses: tuple[StageLabel, ...]
    """Every one in the order of time, those that were taken back included."""
    note: str = ""
    repeated: tuple[InvalidTrial, ...] = ()
    """Earlier trials of this episode, which are invalid."""
    stopped: str = ""
    """Reason why the arms ended the episode; empty if they did not."""
    fault: FaultKind | None = None
    """Kind of that fault; None if it was none. What counts is a contact, or a limit that
    the operator blamed on the policy."""
    waits: int = 0
    """Number of times that the arms rested for a late image."""

    @property
    def is_late(self) -> bool:
        """Whether its stage was pressed only long after the end, see `REACTION_S`."""
        return StageLabels(self.presses).is_late


@dataclass(frozen=True, kw_only=True, slots=True)
class Software:
    """Version of the benchmark's source that played an episode; empty if unknown."""

    decisive: str = ""
    """SHA-256 of all files that decide what an episode is."""
    package: str = ""
    """SHA-256 of all files of the package."""


NOT_REPEATABLE = "not repeatable"


@dataclass(frozen=True, kw_only=True, slots=True)
class FirstAnswer:
    """Hashes of the first observation of a run and of the policy's chunk for it.

    Before anything is played, the policy is reset and acts, twice with the same seed.
    """

    question: str
    """SHA-256 of instruction, seed and observation."""
    answer: str
    """SHA-256 of the chunk, or `NOT_REPEATABLE` if the second one has other bits."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Record:
    """One episode of one task under one condition, from its seed to its last stage."""

    CHECKED_FROM: ClassVar[int] = RECORD_SCHEMA
    run: str
    """SHA-256 of what decides in `run.json`: all but episodes and shifts."""
    suite_version: str
    """Version of the suite that the seed belongs to."""
    suite: str
    """Name and version of the suite; "custom" without a name."""
    execution: ChunkExecution
    """Actions of a chunk to `execute` at most, None for all, and `latency` in control steps, a
    shift's included."""
    task: str
    """Id of the task."""
    episode: int
    """Index of the episode in the suite."""
    seed: int
    """Seed of the reset; a pure function of task, suite version and episode."""
    policy_seed: int
    """Seed of the policy, a hash of that of the reset."""
    attempt: int = 1
    """Number of the attempt, over all commands."""
    earlier: tuple[str, ...] = ()
    """End of each earlier attempt."""
    first_answer: FirstAnswer | None = None
    """Hashes of the first question and answer of the command; None if they were not computed."""
    policy: str
    """Name of the policy, as given."""
    policy_version: str | None
    """Version of the policy; None if unknown."""
    config: EnvConfig
    """Configuration of the environment."""
    instruction: str
    """Instruction that the policy got; empty if it failed before its reset."""
    success: bool
    """Whether the last stage was reached, without an error."""
    success_at_end: bool
    """Whether the constraints of the last stage still held after the last step."""
    final_stage: int
    """Highest stage that was reached, 0 for none."""
    max_stage: int
    """Number of the last stage."""
    unmet: tuple[str, ...] | None
    """Why the next stage was not reached: what of its constraints did not hold after the last step,
    in words; empty after a success, None if the last step failed, or there is none, and where a
    person judged."""
    stage_changes: tuple[tuple[int, int], ...]
    """Pairs (control step, stage): after how many steps each newly reached stage was reached."""
    steps: int
    """Control steps that were executed."""
    horizon: int
    """Control steps after which the task truncates an episode."""
    terminated: bool
    """Whether the last stage ended the episode."""
    truncated: bool
    """Whether the horizon ended the episode, or arms that could not go on."""
    error: str | None
    """Traceback that the episode failed with; None without an error."""
    layout: SampledLayout
    """Start poses and variants."""
    state_hash: str | None
    """SHA-256 of the whole state after the last step, with what relative actions add up to; None
    after an error."""
    start: StateHashes | None
    """Hashes of the state after the reset: `physics`, and `stages` with their memory; None before
    it, and where there is no simulation."""
    end: StateHashes | None
    """The same after the last step; None as `start` is, and after an error."""
    sent: bytes | None
    """Joint targets that were sent, as below; None if the policy was stopped."""
    clipped: int | None
    """Control steps at which limits of the arms changed what was to be sent; None as `sent` is."""
    excess: Excess | None
    """Excess of requested targets over the limits: `joint` and `opening` furthest out, each with
    the end of its range; the largest `change`; `first`, how far the first target was from the arms,
    and from the arms exchanged; `speed`, the fastest joint's as a part of its limit. None without
    excess, and where `sent` is."""
    versions: dict[str, str | None]
    """Versions of packages and of Python; platform, processor and renderer."""
    software: Software = Software()
    """Hashes of the source that decides, and of the whole package."""
    domain: str = SIM
    """Domain in which it was played: sim or real."""
    rig: str | None = None
    """SHA-256 of the file of the rig on which it was played; None in simulation."""
    judged: Judged | None = None
    """Operator's judgement: rater; presses, with `late` for one long after the end; note; earlier
    invalid trials (`reason`, `stage`, `fault`, `is_chosen`); why arms stopped, and the kind of
    `fault`; `waits` for a late image. None in simulation."""

    def __post_init__(self) -> None:
        when = [step for step, _ in self.stage_changes]
        reached = [stage for _, stage in self.stage_changes]
        problems = {
            "stage_changes must rise in step and stage": when != sorted(set(when))
            or reached != sorted(set(reached)),
            "final_stage must be the last stage of stage_changes": self.final_stage
            != (reached[-1] if reached else 0),
            "final_stage must lie in 0..max_stage": not 0
            <= self.final_stage
            <= self.max_stage,
            "max_stage must be positive": self.max_stage < 1,
            "success must mean that the last stage was reached without an error": self.success
            != (self.final_stage == self.max_stage and self.error is None),
            "stages are reached within the executed steps": bool(when)
            and not 0 <= when[0] <= when[-1] <= self.steps,
            "steps must lie in 0..horizon": not 0 <= self.steps <= self.horizon,
            "attempts count from 1, and each earlier one has ended somehow": self.attempt
            != 1 + len(self.earlier)
            or not ENDS.issuperset(self.earlier),
            "error must say something": self.error is not None
            and not self.error.strip(),
            "domain must be sim or real": self.domain not in DOMAINS,
            "an episode on real arms has a rig and is judged by a person": (
                (self.domain == REAL) != (self.rig is not None)
                or (self.domain == REAL) != (self.judged is not None)
            ),
        }
        broken = [rule for rule, violated in problems.items() if violated]
        if broken:
            raise EvaluationError(
                f"Record of {self.task}, episode {self.episode}: {'; '.join(broken)}."
            )

    @property
    def condition(self) -> Condition:
        """Condition under which it was played."""
        return Condition.of(self.policy, self.domain, self.config)

    @property
    def key(self) -> Key:
        """Key in the folder of its run."""
        return Key(self.task, self.condition.name, self.episode)

    @property
    def progress(self) -> float:
        """Highest stage over last stage, 0..1."""
        return self.final_stage / self.max_stage

    @property
    def unproven(self) -> Record:
        """The episode as it counts where it cannot be verified: a failure that reached no stage."""
        return replace(
            self, final_stage=0, stage_changes=(), success=False, success_at_end=False
        )

    @property
    def reason(self) -> str:
        """The last line of the error, which says what it was; empty without one."""
        return (self.error or "").strip().rpartition("\n")[2]

    @property
    def missing(self) -> str:
        """Reason why the next stage was not reached, in one line; empty if that is unknown."""
        return "; ".join(self.unmet or ())

    def targets(self) -> Array | None:
        """Joint targets in radians and openings (steps, 16) that were sent; None if unknown."""
        return None if self.sent is None else unpack_targets(self.sent, self.steps)

    def stage_after(self, step: int) -> int:
        """Stage after that many control steps; the last one stays once the episode is over."""
        return max(
            (stage for when, stage in self.stage_changes if when <= step), default=0
        )

    def broken(self, error: BaseException, steps: int) -> Record:
        """The record of the episode if it failed with an error, so many steps after its start."""
        # Where it was stuck, or ended, is unknown.
        is_late = isinstance(error, PolicyTimeoutError | PolicyEndedError)
        if is_late:
            text = f"{type(error).__name__}: {error}\n"
        else:
            text = (
                f"{error}\n"
                if isinstance(error, PolicyFailedError)
                else traceback_text(error)
            )
        return replace(
            self,
            success=False,
            success_at_end=False,
            steps=steps,
            error=text,
            sent=None if is_late else self.sent,
            clipped=None if is_late else self.clipped,
            excess=None if is_late else self.excess,
        )


def pack_targets(sent: ArrayLike) -> bytes:
    """Compress the commands (T, 16) of an episode.

    They are kept as float32, in which policies act. Where that would change one, because it was
    clipped to a limit that is no float32, all of the episode are kept as float64. What neighbouring
    numbers share is brought side by side: the bytes are sorted by their significance.
    """
    exact = np.asarray(sent, dtype=_LONG).reshape(-1, FLAT_SIZE)
    short = exact.astype(_SHORT)
    kept = short if np.array_equal(short, exact) else exact
    columns = np.ascontiguousarray(kept.T)
    planes = columns.view(np.uint8).reshape(-1, kept.itemsize).T
    return zlib.compress(planes.tobytes(), level=9)


def unpack_targets(content: bytes, steps: int) -> Array:
    """The commands (steps, 16) that `pack_targets` compressed, as float64."""
    sizes = {steps * FLAT_SIZE * kind.itemsize: kind for kind in (_SHORT, _LONG)}
    unpacking = zlib.decompressobj()
    try:
        data = unpacking.decompress(
            content, max(sizes) + 1
        )  # a few bytes can become many
    except zlib.error as error:
        raise EvaluationError(
            f"The joint targets of a record are damaged: {error}."
        ) from error
    if len(data) not in sizes:
        raise EvaluationError(
            f"A record of {steps} steps does not hold as many joint targets."
        )
    kind = sizes[len(data)]
    planes = np.frombuffer(data, np.uint8).reshape(kind.itemsize, -1)
    columns = np.ascontiguousarray(planes.T).view(kind).reshape(FLAT_SIZE, steps)
    return columns.T.astype(np.float64)
