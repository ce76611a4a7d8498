"""Playing episodes: one environment, one policy, one task at a time; nothing is written here."""

import hashlib
import logging
import math
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, replace
from typing import Generic, Protocol, TypeVar

import gymnasium as gym
import msgspec

from duobench.core.errors import (
    DataError,
    PolicyError,
    escaped,
)
from duobench.core.randomness import EVAL, episode_seed
from duobench.core.versions import (
    package_source,
    package_versions,
    record_versions,
    source_hashes,
)
from duobench.data import (
    EpisodeInfo,
    Outcome,
    Recorder,
    Recording,
)
from duobench.data.stream import INTERRUPTED
from duobench.envs.config import FIXED, EnvConfig
from duobench.envs.registration import make
from duobench.evaluation.blame import Asking, before_policy
from duobench.evaluation.clock import EpisodeClock, Stopwatch
from duobench.evaluation.policies import PolicyChoice, PolicySource, actor_of
from duobench.evaluation.recorder import EpisodeRecorder
from duobench.evaluation.rollouts import Watcher, rollout
from duobench.evaluation.video import Overview, Picture, VideoRecorder
from duobench.policy import Policy
from duobench.policy.policy import as_chunk, check_fits
from duobench.policy.serving.codec import pack
from duobench.results.journal import EpisodeTimes
from duobench.results.records import NOT_REPEATABLE, FirstAnswer, Record
from duobench.results.run import (
    Candidate,
    Run,
    TimeLimits,
    needed_options,
)
from duobench.results.suite import Episode, Suite
from duobench.tasks import catalog
from duobench.tasks.shifts.shift import RENDERER
from duobench.world.looks.catalog import as_look
from duobench.world.looks.look import STUDIO
from duobench.world.objects.prop import digest_of
from duobench.world.sim.rendering import describe

_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordingPlan:
    """Plan of a recording of episodes, and which of them are kept."""

    split: str
    keep_failures: bool = False
    after_success: float = 0.0
    """Seconds that a recording goes on after success, a whole number of control steps."""
    instructions: str = FIXED
    """Instructions for the policy; see `EnvConfig`."""

    def keeps(self, outcome: Outcome) -> bool:
        """Whether an episode that ended so is kept."""
        return self.keep_failures or (outcome.success and not outcome.cut)

    def is_of(
        self,
        info: EpisodeInfo,
        task: str,
        index: int,
    ) -> bool:
        """Whether a recording belongs to an episode of a task, and is kept."""
        return (
            (info.task, info.split) == (task, self.split)
            and info.seed == episode_seed(task, index, self.split)
            and info.outcome is not None
            and info.outcome.reason != INTERRUPTED
            and self.keeps(info.outcome)
            and info.after_success == self.after_success
        )


class Job(msgspec.Struct, tag=True, frozen=True, kw_only=True):
    """Policy, suite and options with which executors, runners and workers play episodes."""

    policy: PolicyChoice
    suite: Suite
    limits: TimeLimits = TimeLimits()
    videos: int = 0
    """Number of episodes of each task, from the first on, with a video."""
    video_look: str | None = None
    """Look of the table in videos; None is that of the suite."""
    recording: RecordingPlan | None = None


class EpisodeResult(msgspec.Struct, tag=True, frozen=True, kw_only=True):
    """An episode that was played."""

    record: Record
    video: bytes | None = None
    """Its video as a WebM file, if there is one."""
    recording: bytes | None = None
    """Its recording as a Parquet file, if there is one that is kept."""
    times: EpisodeTimes | None = None

    def objection(
        self, episode: Episode, run: Run, plan: RecordingPlan | None
    ) -> str | None:
        """Reason why this is not the wanted episode of a run; None if it is."""
        wrong = run.objection(self.record, episode)
        if wrong is not None:
            return f"its record is another one: {wrong}"
        if self.video is not None and not episode.has_video:
            return "it has a video that was not requested."
        if self.recording is None:
            return None
        try:
            info = Recording.read_info(self.recording)
        except DataError as error:
            return str(error)
        if plan is None or not plan.is_of(info, episode.task.id, episode.index):
            return "its recording is another one."
        return None


class Closable(Protocol):
    """Object that is closed when it is not needed any more."""

    def close(self) -> None:
        """Free what it holds."""
        ...


V = TypeVar("V", bound=Closable)


class Latest(Generic[V]):
    """Value that was made last; it is closed before another one is made."""

    def __init__(self) -> None:
        self._key: object = None
        self._value: V | None = None

    def get(self, key: object, make: Callable[[], V]) -> V:
        """Return the value of a key, made now if the last one has another key."""
        if self._value is None or self._key != key:
            self.close()
            self._value, self._key = make(), key
        return self._value

    def close(self) -> None:
        """Close what is there; another one can be made afterwards."""
        value, self._value = self._value, None
        if value is not None:
            value.close()


class _TaskSetup:
    """Environment and policy of a task and a shift, with what records and shows them."""

    def __init__(
        self,
        env: gym.Env,
        policy: Policy,
        recorder: Recorder | None,
        video_look: str | None,
    ) -> None:
        self.env = env
        self.policy = policy
        self.recorder = recorder
        self.overview = Overview(env, video_look)

    def close(self) -> None:
        self.overview.close()
        self.env.close()


def _inference(source: PolicySource) -> str | None:
    """Inference of a policy in words: all but the version that its actions may depend on."""
    metadata, batching = source.metadata, source.batching
    parts = [f"{batching.mode} batches of {batching.size}"] if batching else []
    parts += [part for part in (metadata.dtype, metadata.device) if part]
    return ", ".join(parts) or None


def _digest(**values: object) -> str:
    """SHA-256 of arrays, numbers and texts."""
    return hashlib.sha256(pack(values)).hexdigest()


def _digest_of_objects(reference: str) -> str:
    """Digest of a task's objects; of those that cannot be built, their episodes say so."""
    try:
        return digest_of(catalog.get(reference).props)
    except Exception:  # noqa: BLE001 - it is the task's, and told when it is played
        return "cannot be built"


class EpisodeRunner:
    """Plays episodes with one policy, one after the other; environments are made when needed.

    Args:
        source: The policy of the job, which belongs to the runner from now on.
        job: How it plays.
        clock: Where its times are noted, for another process.
        tell: Takes the record of an episode so far, whenever it has reached a new stage.
        is_interruptible: Whether a `KeyboardInterrupt` is a person's, not the policy's.
    """

    def __init__(
        self,
        source: PolicySource,
        job: Job,
        clock: EpisodeClock | None = None,
        tell: Callable[[Record], None] = lambda _record: None,
        *,
        is_interruptible: bool = True,
    ) -> None:
        self._source = source
        act_s = math.inf if source.waits_for_others else job.limits.act_timeout
        self._limits = replace(job.limits, act_timeout=act_s)
        self._recording = job.recording
        self._video_look = job.video_look
        self._clock = clock or EpisodeClock()
        self._tell = tell
        self._let_through = (KeyboardInterrupt,) if is_interruptible else ()
        self._latest: Latest[_TaskSetup] = Latest()
        metadata = source.metadata
        config = EnvConfig(
            **needed_options(metadata),
            instructions=job.recording.instructions if job.recording else FIXED,
            split=job.recording.split if job.recording else EVAL,
            look=job.suite.look,
            gripper=job.suite.gripper,
            mount=job.suite.mount,
        )
        with before_policy(""):
            shown_by = as_look(config.look).renderer
            renderer = describe(shown_by).renderer if config.wanted else None
        choice = job.policy
        candidate = Candidate(
            policy=choice.name,
            metadata=metadata,
            config=config,
            batching=source.batching,
        )
        references = [task.reference for task in job.suite.tasks]
        own = sorted({each for each in references if ":" in each})
        objects = {f"objects of {each}": _digest_of_objects(each) for each in own}
        modules = {each.partition(":")[0] for each in own}
        self.run = Run(
            candidates=(candidate,),
            suite=job.suite,
            limits=job.limits,
            versions=package_versions(),
            sources=objects
            | source_hashes(sorted(modules), is_scripted=choice.kind.is_scripted),
            package=package_source(),
        )
        self._actor = actor_of(choice, metadata)
        self.versions = record_versions(renderer) | {"inference": _inference(source)}

    def _versions(self, episode: Episode) -> dict[str, str | None]:
        """Versions of an episode, which may be shifted to another renderer."""
        if not episode.shift.level_of(RENDERER) or self.versions["renderer"] is None:
            return self.versions
        with before_policy(""):
            return {**self.versions, "renderer": describe(STUDIO).renderer}

    def play(self, episode: Episode) -> EpisodeResult:
        """Play one episode.

        The episode fails if the policy raises an error, `sys.exit` included, or if its actions
        break the physics. A `MachineryError` is no fault of the policy, and other errors mean that
        it does not fit; see `blame`.
        """
        watch = Stopwatch()
        versions = self._versions(episode)
        setting = self._prepare(episode)
        env = setting.env
        policy = setting.policy
        recording = setting.recorder
        if recording is not None:
            recording.content = None
        recorder = EpisodeRecorder(
            episode, lambda: self._tell(recorder.record(self.run, versions))
        )
        video = None
        if episode.has_video:
            video = VideoRecorder(setting.overview.image, Picture(episode.task))
        watchers: list[Watcher] = [recorder] if video is None else [recorder, video]
        asking = Asking()

        def busy() -> AbstractContextManager[None]:
            return asking.within(
                watch.policy(self._clock.timed(self._limits, recorder.steps))
            )

        error = None
        before = getattr(policy, "busy_s", None)
        try:
            with self._clock.playing(), watch.rollout(env):
                rollout(
                    env,
                    policy,
                    seed=episode.seed,
                    hashed=episode.policy_seed,
                    watchers=watchers,
                    busy=busy,
                    execution=self.run.suite.execution_of(
                        episode.task.id, episode.shift
                    ),
                )
        except self._let_through:
            raise
        except BaseException as caught:
            fault = asking.fault_of(caught, episode.task.id)
            if recording is not None and fault is not None:
                recording.discard()
            elif recording is not None:
                reason = escaped(f"{type(caught).__name__}: {caught}")
                recording.finish(kept=False, reason=reason)
            self._latest.close()  # a failure may have left it in any state
            if fault is not None:
                raise fault from caught
            error = caught
        record = recorder.record(self.run, versions)
        return EpisodeResult(
            record=record if error is None else record.broken(error, record.steps),
            video=None if video is None else video.video(),
            recording=recording and recording.content,
            times=watch.times(
                0.0 if video is None else video.seconds,
                None if before is None else getattr(policy, "busy_s", before) - before,
            ),
        )

    def rehearse(self, episode: Episode) -> FirstAnswer:
        """Let the policy act twice on the first observation of an episode, which is not played."""
        setting = self._prepare(episode)
        env, policy = setting.env, setting.policy
        (size,) = env.action_space.shape or (0,)
        check_fits(policy.metadata, env)
        with before_policy(episode.task.id):
            observation, info = env.reset(seed=episode.seed)
        question = _digest(
            instruction=info["instruction"],
            seed=episode.policy_seed,
            observation=observation,
        )
        digests: list[str] = []
        try:
            for _ in range(2):
                with self._clock.playing(), self._clock.timed(self._limits):
                    policy.reset(info["instruction"], episode.policy_seed)
                    chunk = as_chunk(policy.act(observation), size)
                digests.append(_digest(actions=chunk))
        except PolicyError as error:
            raise PolicyError(
                f"The policy does not answer the first observation of {episode.task.id}, so that "
                f"nothing was played:\n{error}"
            ) from error
        is_same = digests[0] == digests[1]
        return FirstAnswer(
            question=question, answer=digests[0] if is_same else NOT_REPEATABLE
        )

    def close(self) -> None:
        """Free environment and policy, which are not used again."""
        self._latest.close()
        try:
            self._source.close()
        except Exception:  # noqa: BLE001 - the results are there
            _log.warning("The policy could not be closed.", exc_info=True)

    def _prepare(self, episode: Episode) -> _TaskSetup:
        """Return the environment and policy of a task and a shift; those of others are closed."""
        with before_policy(episode.task.id):
            return self._latest.get(
                (episode.task, episode.shift), lambda: self._make(episode)
            )

    def _make(self, episode: Episode) -> _TaskSetup:
        config = replace(self.run.candidate.config, shift=episode.shift)
        env = make(episode.task.reference, **asdict(config))
        plan = self._recording
        try:
            policy = self._source.bind(env)
        except BaseException:
            env.close()
            raise
        if plan is None:
            return _TaskSetup(env, policy, None, self._video_look)
        recorder = Recorder(
            env, None, self._actor, after_success=plan.after_success, keep=plan.keeps
        )
        return _TaskSetup(recorder, policy, recorder, self._video_look)
