"""Summary of a data set: lengths, success, time a stage, actions and speeds."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from statistics import median

import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import DataError
from duobench.core.types import (
    FLAT_SIZE,
    OPENING_SLOTS,
    SIDES,
    Array,
)
from duobench.data.attempts import (
    SKIPPED,
    Attempt,
    compared,
    led_tasks,
    of_task,
)
from duobench.data.dataset import DataSet
from duobench.data.leading import (
    Leading,
    LedEpisode,
    add_up,
    episodes_without_file,
)
from duobench.data.recording import Recording
from duobench.data.schema import Actor, EpisodeInfo
from duobench.data.used_rows import Reason, RowChoice, used_rows
from duobench.envs.action_modes import JOINT
from duobench.envs.spaces import JOINT_NAMES
from duobench.tasks import catalog
from duobench.tasks.task import Task
from duobench.world.robot.frames import USUAL_ROBOT
from duobench.world.robot.joints import JOINT_RANGES, VELOCITY_LIMITS

LONG = 0.99
"""Share of episodes that are at most as long as the length that is compared with the horizon."""
AT_LIMIT = 1e-3
"""A target this near to the end of its joint's range is at the limit, in radians."""
REVERSAL = 0.02
"""Two steps in opposite directions, each longer than this, are a reversal: 0.6 rad/s to and fro, in
radians. A policy that averages over them learns neither."""
JUMP = 0.05
"""A step longer or shorter than the one before by more than this is a jump, in radians: 45 rad/s²,
where an FR3 allows 10 rad/s²."""
MOST_NAMED = 20
"""Most given-up layouts that are named: a line or two."""
_JOINTS = [place for place in range(FLAT_SIZE) if place not in OPENING_SLOTS]
"""Places of the joints among the 16 numbers of a command."""
_RANGES = np.tile(JOINT_RANGES, (len(SIDES), 1))
"""Lower and upper ends of their ranges (14, 2), in radians."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Smoothness:
    """Properties of episodes' joint targets that are hard to learn, or to execute on real arms."""

    at_limit: float
    """Share of steps with a joint at an end of its range."""
    reversals: float
    """Reversals an episode, of all joints together, in the mean."""
    jumps: float
    """Share of steps with a jump of a joint."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskSummary:
    """Summary of the episodes of one task."""

    task: str
    title: str
    horizon: int
    """Control steps after which an evaluation's episode is truncated."""
    stages: tuple[str, ...]
    episodes: int
    successes: int
    discarded: int
    """Number of episodes that are not meant to be used."""
    cut: int
    failures_led: int
    """Number of kept episodes without success that people led; exports leave them out by
    default."""
    frames: int
    """Actions of all episodes."""
    lengths: tuple[int, ...]
    """Control steps of each episode until it succeeded or ended, ascending."""
    stage_seconds: tuple[float, ...]
    """Mean seconds that an episode spends in stage 0, 1, ..., n."""
    rows_led: dict[str, int]
    """Rows that each actor led, in the order in which they did first."""
    repeated_layouts: int
    """Episodes whose layout an earlier one has too."""
    eval_layouts: int
    """Episodes with a layout of the evaluation's split."""
    smoothness: Smoothness
    led: float | None
    """Share of steps in which a hand of an operator led an arm; None where nothing says it."""
    real: int = 0
    """Episodes that were played on a rig, and not in the simulation."""
    rigs: tuple[str, ...] = ()
    """Names of the rigs; that of a rehearsal has "no hardware" behind its name."""
    robots: tuple[str, ...] = ()
    """Grippers and mounts, in a word; empty for those of the paper."""
    left_out: int = 0
    """Frames that are missing in videos, because the encoder was too far behind."""
    unused: dict[Reason, int] = field(default_factory=dict)
    """Rows that exports leave out by default, for each reason."""
    reviewed: int = 0
    """Episodes about which something was said at a second look that stands."""
    attempts: tuple[Attempt, ...] = ()
    """Episodes that were begun for the data set, as far as that was noted."""
    takeovers: dict[str, int] = field(default_factory=dict)
    """Take-overs of a policy, by the reason that was given; empty words without one."""

    @property
    def actors(self) -> tuple[str, ...]:
        """All who led, in words."""
        return tuple(self.rows_led)

    @property
    def corrected(self) -> str:
        """Rows that each led, and reasons of take-overs, in words; empty without take-overs."""
        if not self.takeovers:
            return ""
        rows = ", ".join(f"{who} {count}" for who, count in self.rows_led.items())
        reasons = ", ".join(
            f"{why or 'no reason given'} {count}"
            for why, count in sorted(self.takeovers.items())
        )
        return f"rows led by {rows}; take-overs: {reasons}"

    @property
    def attempted(self) -> str:
        """Counts of attempts in words; empty without attempts."""
        if not self.attempts:
            return ""
        begun = sum(each.error != SKIPPED for each in self.attempts)
        kept = [each.of_layout for each in self.attempts if each.kept]
        tried = {each.of_layout for each in self.attempts}
        lost = [str(layout) for layout in sorted(tried.difference(kept))]
        words = f"{begun} begun, {len(kept)} of them kept"
        named = ", ".join(lost[:MOST_NAMED] + ["…"] * (len(lost) > MOST_NAMED))
        return f"{words}; given up: layouts {named}" if lost else words

    @property
    def median_length(self) -> float:
        """The median of the lengths; the mean of the middle two of an even number."""
        return median(self.lengths)

    @property
    def long_length(self) -> float:
        """The 99 % quantile of the lengths, interpolated between neighbours."""
        return float(np.quantile(self.lengths, LONG))


@dataclass(frozen=True, kw_only=True, slots=True)
class JointSummary:
    """Summary of one joint in all episodes."""

    name: str
    low: float
    high: float
    """Ends of its range, in radians."""
    quantiles: tuple[float, float, float, float, float]
    """Commanded targets: smallest, 1 %, median, 99 %, largest, in radians."""
    fastest: float
    speed_limit: float
    """Largest speed, and the arm's limit, in rad/s."""
    at_limit: float
    """Share of commands at an end of the range."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Summary:
    """Summary of a data set."""

    tasks: tuple[TaskSummary, ...]
    joints: tuple[JointSummary, ...]
    """Joint by joint, left then right; none if there is no action."""
    differences: dict[str, str] = field(default_factory=dict)
    """Differences of files from noted attempts, by task, in words."""
    leading: tuple[Leading, ...] = ()
    """Episodes that operators have led, added up by task, operator and device."""

    @property
    def episodes(self) -> int:
        """Episodes of all tasks."""
        return sum(task.episodes for task in self.tasks)

    @property
    def successes(self) -> int:
        """Episodes that succeeded."""
        return sum(task.successes for task in self.tasks)

    @property
    def frames(self) -> int:
        """Actions of all episodes."""
        return sum(task.frames for task in self.tasks)

    @property
    def domains(self) -> str:
        """Domains in which the episodes were played, and with which arms, in words."""
        real = sum(task.real for task in self.tasks)
        rigs = dict.fromkeys(rig for task in self.tasks for rig in task.rigs)
        parts = [f"{self.episodes - real} simulated"] if real < self.episodes else []
        parts += [f"{real} real ({'; '.join(rigs)})"] if real else []
        robots = dict.fromkeys(robot for task in self.tasks for robot in task.robots)
        if any(robots):
            parts += [f"with {' and '.join(one or USUAL_ROBOT for one in robots)}"]
        return ", ".join(parts)

    @property
    def left_out(self) -> int:
        """Frames that are missing in videos."""
        return sum(task.left_out for task in self.tasks)


def summarize(data: DataSet) -> Summary:
    """Read a data set and add it up.

    Raises:
        DataError: A file cannot be read, or there is no episode.
        UnknownNameError, ImportPathError, ForeignTaskError: See `DataSet.reference`.
    """
    tasks = []
    commands = []
    speeds = []
    names = ()
    reviews = data.reviews
    differences = {
        task: words for task, each in compared(data).items() if (words := str(each))
    }
    led: list[LedEpisode | None] = []
    for task in led_tasks(data):
        files = {path.stem for path in data.episodes(task)}
        led += episodes_without_file(of_task(data, task), files)
    for task in data.tasks:
        recordings = []
        unused = Counter[Reason]()
        reviewed = 0
        for path in data.episodes(task):
            recording = Recording.read(path)
            judgement = reviews.of(path)
            reviewed += bool(judgement.at)
            recording = replace(recording, info=judgement.judged(recording.info))
            commands.append(recording.sent.astype(np.float32))
            speeds.append(np.abs(recording.joint_velocity).max(axis=0))
            names = recording.info.observation_names
            reference = data.reference(recording.info)
            rows = used_rows(
                recording,
                RowChoice(),
                reference,
                within=judgement.rows,
            )
            unused.update(rows.left_out)
            led.append(LedEpisode.of(recording))
            # States are most of a recording, and not needed.
            recordings.append(replace(recording, state=recording.state[:, :1].copy()))
        begun = tuple(of_task(data, task))
        definition = catalog.get(data.reference(recordings[0].info))
        found = _summarize_task(definition, recordings)
        found = replace(
            found,
            attempts=begun,
            reviewed=reviewed,
            unused=dict(unused),
        )
        tasks.append(found)
    if not tasks:
        words = "".join(f" Of {task} {each}." for task, each in differences.items())
        raise DataError(f"{data.path} holds no episode.{words}")
    sent = np.concatenate(commands)
    joints = _summarize_joints(names, sent, np.max(speeds, axis=0)) if len(sent) else ()
    return Summary(
        tasks=tuple(tasks),
        joints=tuple(joints),
        differences=differences,
        leading=add_up([each for each in led if each is not None]),
    )


def _summarize_task(task: Task, recordings: Sequence[Recording]) -> TaskSummary:
    stages = range(task.max_stage + 1)
    seconds = [
        [np.diff(each.time)[each.stage[:-1] == stage].sum() for stage in stages]
        for each in recordings
    ]
    infos = [each.info for each in recordings]
    simulated = [info for info in infos if not info.is_real]
    outcomes = [info.outcome for info in infos]
    return TaskSummary(
        task=task.id,
        title=task.title,
        horizon=task.horizon,
        stages=tuple(stage.name for stage in task.stages),
        episodes=len(recordings),
        successes=sum(outcome is not None and outcome.success for outcome in outcomes),
        failures_led=sum(
            info.is_led_failure and info.outcome.kept
            for info in infos
            if info.outcome is not None
        ),
        discarded=sum(outcome is None or not outcome.kept for outcome in outcomes),
        cut=sum(outcome is None or outcome.cut for outcome in outcomes),
        frames=sum(map(len, recordings)),
        lengths=tuple(sorted(each.steps for each in recordings)),
        stage_seconds=tuple(np.mean(seconds, axis=0).tolist()),
        rows_led=_rows_led(recordings),
        takeovers=Counter(one.why for info in infos for one in info.takeovers),
        repeated_layouts=len(simulated)
        - len({repr(info.layout) for info in simulated}),
        eval_layouts=sum(info.split == "eval" for info in infos),
        smoothness=_smoothness(recordings),
        led=_led(recordings),
        real=len(infos) - len(simulated),
        rigs=tuple(dict.fromkeys(map(_rig, (info for info in infos if info.is_real)))),
        robots=tuple(dict.fromkeys(info.other_robot for info in infos)),
        left_out=sum(
            video.left_out for info in infos for video in info.videos.values()
        ),
    )


def _rows_led(recordings: Sequence[Recording]) -> dict[str, int]:
    """Rows that each actor led, in the order in which they did first."""
    led = Counter[str]()
    for each in recordings:
        for place, actor in enumerate(each.info.actors):
            led[_who(actor)] += int((each.leader == place).sum())
    return dict(led)


def _rig(info: EpisodeInfo) -> str:
    rig = info.rig
    if rig is None:
        return "a rig without a name"
    return f"{rig.name}, no hardware" if rig.is_rehearsal else rig.name


def _led(recordings: Sequence[Recording]) -> float | None:
    """The share of steps in which a hand led an arm, of the episodes that say it."""
    clutches = [each.clutch for each in recordings if each.info.has_clutch]
    steps = sum(map(len, clutches))
    return (
        sum(int(each.any(axis=1).sum()) for each in clutches) / steps if steps else None
    )


def _who(actor: Actor) -> str:
    """An actor in words, with its device."""
    if actor.device is None:
        return actor.words
    return f"{actor.words} with {actor.device}"


def _summarize_joints(
    names: Sequence[str], commands: np.ndarray, fastest: np.ndarray
) -> Iterator[JointSummary]:
    limits = np.tile(VELOCITY_LIMITS, len(SIDES))
    shares = _at_limit(commands[:, _JOINTS]).mean(axis=0)
    for joint, place in enumerate(_JOINTS):
        low, high = _RANGES[joint].tolist()
        quantiles = np.quantile(
            commands[:, place], [0.0, 0.01, 0.5, 0.99, 1.0]
        ).tolist()
        yield JointSummary(
            name=names[place],
            low=low,
            high=high,
            quantiles=tuple(quantiles),
            fastest=float(fastest[joint]),
            speed_limit=float(limits[joint]),
            at_limit=float(shares[joint]),
        )


def _smoothness(recordings: Sequence[Recording]) -> Smoothness:
    """Smoothness of some episodes; perfect without steps."""
    steps = at_limit = reversals = jumps = 0
    for recording in recordings:
        targets = _labels(recording)
        increments = np.diff(targets, axis=0)
        before, after = increments[:-1], increments[1:]
        are_long = np.minimum(np.abs(before), np.abs(after)) > REVERSAL
        steps += len(targets)
        at_limit += int(_at_limit(targets).any(axis=1).sum())
        reversals += int((are_long & (before * after < 0)).sum())
        jumps += int((np.abs(after - before) > JUMP).any(axis=1).sum())
    return Smoothness(
        at_limit=at_limit / max(steps, 1),
        reversals=reversals / max(len(recordings), 1),
        jumps=jumps / max(steps, 1),
    )


def _labels(recording: Recording) -> Array:
    """Joint targets (T, 14) as the actor wanted them; as they were sent, if it wanted poses."""
    info = recording.info
    is_joint = info.action_mode == JOINT.name and info.action_names == JOINT_NAMES
    return (recording.action if is_joint else recording.sent)[:, _JOINTS]


def _at_limit(targets: Array) -> NDArray[np.bool_]:
    """Whether each joint target (T, 14) is at an end of its joint's range (T, 14)."""
    low, high = _RANGES.T
    return (targets < low + AT_LIMIT) | (targets > high - AT_LIMIT)
