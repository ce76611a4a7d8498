"""What a data set adds up to: lengths, success, time a stage, actions and speeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from duobench.data.dataset import DataSet
from duobench.data.recording import Recording
from duobench.data.schema import Actor, EpisodeInfo
from duobench.data.smoothness import JOINTS, Smoothness, at_limit, measure
from duobench.errors import DataError
from duobench.robot.joints import JOINT_RANGES, VELOCITY_LIMITS
from duobench.tasks import catalog
from duobench.types import SIDES

LONG = 0.99
"""Share of episodes that are at most as long as the length that is compared with the horizon."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskSummary:
    """What the episodes of one task add up to."""

    task: str
    title: str
    horizon: int
    """Control steps after which an evaluation's episode is truncated."""
    stages: tuple[str, ...]
    """Names of the stages 1 to n."""
    episodes: int
    successes: int
    discarded: int
    """How many are not meant to be used."""
    cut: int
    """How many ended before their environment ended them."""
    frames: int
    """Actions of all episodes."""
    lengths: tuple[int, ...]
    """Control steps of each episode until it succeeded or ended, ascending."""
    stage_seconds: tuple[float, ...]
    """Mean seconds that an episode spends in stage 0, 1, ..., n."""
    actors: tuple[str, ...]
    repeated_layouts: int
    """Episodes whose layout an earlier one has too."""
    eval_layouts: int
    """Episodes with a layout of the evaluation's split."""
    smoothness: Smoothness
    """What their joint targets do that is hard to learn."""
    led: float | None
    """Share of steps in which a hand of an operator led an arm; None where nothing says it."""
    real: int = 0
    """Episodes that were played on a rig, and not in the simulation."""
    rigs: tuple[str, ...] = ()
    """Names of the rigs; one without hardware has "simulated drivers" behind its name."""
    left_out: int = 0
    """Frames that are missing in videos, because the encoder was too far behind."""

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
    """What one joint does in all episodes."""

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
    """What a data set adds up to."""

    tasks: tuple[TaskSummary, ...]
    joints: tuple[JointSummary, ...]
    """Joint by joint, left then right; none if there is no action."""

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
        """Where the episodes were played, in words."""
        real = sum(task.real for task in self.tasks)
        rigs = dict.fromkeys(rig for task in self.tasks for rig in task.rigs)
        parts = [f"{self.episodes - real} simulated"] if real < self.episodes else []
        parts += [f"{real} real ({'; '.join(rigs)})"] if real else []
        return ", ".join(parts)

    @property
    def left_out(self) -> int:
        """Frames that are missing in videos, because the encoder was too far behind."""
        return sum(task.left_out for task in self.tasks)


def summarize(data: DataSet) -> Summary:
    """Read a data set and add it up.

    Raises:
        DataError: A file cannot be read, or there is no episode.
    """
    tasks, commands, speeds, names = [], [], [], ()
    for task in data.tasks:
        recordings = []
        for recording in data.recordings(task):
            commands.append(recording.sent.astype(np.float32))
            speeds.append(np.abs(recording.joint_velocity).max(axis=0))
            names = recording.info.observation_names
            # States are most of a recording, and not needed.
            recordings.append(replace(recording, state=recording.state[:, :1].copy()))
        tasks.append(_summarize_task(task, recordings))
    if not tasks:
        raise DataError(f"{data.path} holds no episode.")
    sent = np.concatenate(commands)
    joints = _summarize_joints(names, sent, np.max(speeds, axis=0)) if len(sent) else ()
    return Summary(tasks=tuple(tasks), joints=tuple(joints))


def _summarize_task(task: str, recordings: Sequence[Recording]) -> TaskSummary:
    definition = catalog.get(task)
    stages = range(definition.max_stage + 1)
    seconds = [
        [np.diff(each.time)[each.stage[:-1] == stage].sum() for stage in stages]
        for each in recordings
    ]
    infos = [each.info for each in recordings]
    simulated = [info for info in infos if not info.is_real]
    outcomes = [info.outcome for info in infos]
    return TaskSummary(
        task=task,
        title=definition.title,
        horizon=definition.horizon,
        stages=tuple(stage.name for stage in definition.stages),
        episodes=len(recordings),
        successes=sum(bool(each.success[-1]) for each in recordings),
        discarded=sum(outcome is None or not outcome.kept for outcome in outcomes),
        cut=sum(outcome is None or outcome.cut for outcome in outcomes),
        frames=sum(map(len, recordings)),
        lengths=tuple(sorted(map(_steps, recordings))),
        stage_seconds=tuple(np.mean(seconds, axis=0).tolist()),
        actors=tuple(dict.fromkeys(_who(info.actor) for info in infos)),
        repeated_layouts=len(simulated) - len({repr(info.layout) for info in simulated}),
        eval_layouts=sum(info.split == "eval" for info in infos),
        smoothness=measure(recordings),
        led=_led(recordings),
        real=len(infos) - len(simulated),
        rigs=tuple(dict.fromkeys(map(_rig, (info for info in infos if info.is_real)))),
        left_out=sum(video.left_out for info in infos for video in info.videos.values()),
    )


def _rig(info: EpisodeInfo) -> str:
    """The rig of an episode in words."""
    rig = info.rig
    if rig is None:
        return "a rig without a name"
    return f"{rig.name}, simulated drivers" if set(rig.drivers) == {"simulated"} else rig.name


def _led(recordings: Sequence[Recording]) -> float | None:
    """The share of steps in which a hand led an arm, of the episodes that say it."""
    clutches = [each.clutch for each in recordings if each.info.has_clutch]
    steps = sum(map(len, clutches))
    return sum(int(each.any(axis=1).sum()) for each in clutches) / steps if steps else None


def _steps(recording: Recording) -> int:
    """Control steps until success, or until the end; what was recorded after success is no part."""
    return len(recording) if recording.success_step is None else recording.success_step


def _who(actor: Actor) -> str:
    """An actor in words: its kind and name, where the name does not say its kind already."""
    says_kind = actor.name.partition(":")[0] == actor.kind
    who = actor.name if says_kind else f"{actor.kind} {actor.name}".strip()
    return who if actor.device is None else f"{who} with {actor.device}"


def _summarize_joints(
    names: Sequence[str], commands: np.ndarray, fastest: np.ndarray
) -> Iterator[JointSummary]:
    ranges = np.tile(JOINT_RANGES, (len(SIDES), 1))
    limits = np.tile(VELOCITY_LIMITS, len(SIDES))
    shares = at_limit(commands[:, JOINTS]).mean(axis=0)
    for joint, place in enumerate(JOINTS):
        (low, high), targets = ranges[joint], commands[:, place]
        quantiles = np.quantile(targets, [0.0, 0.01, 0.5, 0.99, 1.0]).tolist()
        yield JointSummary(
            name=names[place],
            low=float(low),
            high=float(high),
            quantiles=tuple(quantiles),
            fastest=float(fastest[joint]),
            speed_limit=float(limits[joint]),
            at_limit=float(shares[joint]),
        )
