"""The watchers that make the record of an episode, and its video."""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

import gymnasium as gym

from duobench.backend import Image
from duobench.envs.episode_state import EpisodeState
from duobench.envs.observation_wrappers import PIXELS
from duobench.errors import escaped
from duobench.randomness import SUITE_VERSION
from duobench.results.records import EpisodeRecord, SampledLayout, StateHashes
from duobench.results.run import Run
from duobench.results.suite import Episode
from duobench.results.targets import pack_targets
from duobench.types import CONTROL_HZ, Array
from duobench.video import VP9, VideoWriter

if TYPE_CHECKING:
    from duobench.evaluation.picture import Picture
    from duobench.evaluation.rollout import Info, Observation, Step
    from duobench.stages.logic import Words

FRAME_EVERY = 2
"""Control steps from one frame to the next."""
FRAME_RATE = Fraction(CONTROL_HZ) / FRAME_EVERY
"""Frames a second: the video plays in real time."""


class EpisodeRecorder:
    """Watches an episode, and keeps what its record needs, whether or not it ends well."""

    def __init__(self, episode: Episode, on_stage: Callable[[], None] = lambda: None) -> None:
        """Begin with an episode of which nothing is known but its place in the suite.

        Args:
            episode: The episode.
            on_stage: Called when the episode has begun, and whenever it has reached a new stage.
        """
        self._episode = episode
        self._on_stage = on_stage
        self._env: gym.Env | None = None
        self._instruction = ""
        self._layout: SampledLayout = {}
        self._stage_changes: list[tuple[int, int]] = []
        self._last: Step | None = None
        self._sent: list[Array] = []
        self._clipped = 0
        self._unmet: Words | None = None
        self._start: EpisodeState | None = None
        self._end: EpisodeState | None = None

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:  # noqa: ARG002 - the protocol's signature
        """Note what the reset sampled, and the state that it led to."""
        self._env = env
        self._start = _state(env)
        self._instruction = escaped(info["instruction"])
        self._layout = info.get("layout", {})
        if stage := info["stage"]:
            self._stage_changes.append((0, stage))
        env.get_wrapper_attr("explain_stages")()
        self._on_stage()

    def on_step(self, step: Step) -> None:
        """Note what was sent, and a stage that was newly reached.

        Steps after success are no part of the episode: only a recording has them.
        """
        if self._last is not None and self._last.info["success"]:
            return
        self._last = step
        self._sent.append(step.info["sent"])
        self._clipped += bool(step.info["clipped"].any())
        if (stage := step.info["stage"]) > self.stage:
            self._stage_changes.append((step.number, stage))
            self._look()
            self._on_stage()

    def on_episode_end(self, error: BaseException | None) -> None:
        """Note the final state, and what the next stage lacks."""
        self._look()
        if self._env is not None and error is None:
            self._end = _state(self._env)

    def _look(self) -> None:
        """See why the next stage is not reached."""
        if self._env is not None:
            self._unmet = self._env.get_wrapper_attr("unmet")

    @property
    def steps(self) -> int:
        """Control steps so far."""
        return self._last.number if self._last else 0

    @property
    def stage(self) -> int:
        """Highest stage so far."""
        return self._stage_changes[-1][1] if self._stage_changes else 0

    def record(self, run: Run, versions: Mapping[str, str | None]) -> EpisodeRecord:
        """The record of the episode so far.

        Args:
            run: What it belongs to.
            versions: Versions of everything that the result may depend on.
        """
        task, last = self._episode.task, self._last
        return EpisodeRecord(
            suite_version=SUITE_VERSION,
            suite=run.suite.label,
            execution=run.suite.execution_of(task.id, self._episode.shift),
            task=task.id,
            episode=self._episode.index,
            seed=self._episode.seed,
            policy_seed=self._episode.policy_seed,
            policy=run.policy,
            policy_version=run.metadata.version,
            config=replace(run.config, shift=self._episode.shift),
            instruction=self._instruction,
            success=self.stage == task.max_stage,
            success_at_end=bool(last and last.info["success_at_end"]),
            final_stage=self.stage,
            max_stage=task.max_stage,
            unmet=self._unmet,
            stage_changes=tuple(self._stage_changes),
            steps=self.steps,
            horizon=task.horizon,
            terminated=bool(last and last.terminated),
            truncated=bool(last and last.truncated),
            error=None,
            layout=self._layout,
            state_hash=self._end and self._end.hash,
            start=_hashes(self._start),
            end=_hashes(self._end),
            sent=pack_targets(self._sent),
            clipped=self._clipped,
            versions=dict(versions),
        )


class VideoRecorder:
    """Encodes a video in memory: a frame at the start, and one every other control step.

    A video of an episode is half a megabyte, so it needs no file until it is complete.
    """

    def __init__(self, render: Callable[[], Image], picture: Picture | None = None) -> None:
        """Remember what to show; encoding begins with the first frame.

        Args:
            render: Gives the current image, (height, width, 3), both even.
            picture: Adds stage, time and the images of observations; None shows the image alone.
        """
        self._render = render
        self._picture = picture
        self.seconds = 0.0
        """Seconds that the video has taken so far."""
        self._file = io.BytesIO()
        self._writer = VideoWriter(self._file, VP9, FRAME_RATE)

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:  # noqa: ARG002 - the protocol's signature
        """Show the reset."""
        self._look(0, observation)
        self._show(0, info)

    def on_step(self, step: Step) -> None:
        """Show every other step, and the last."""
        if not step.is_last:  # after which no policy acts
            self._look(step.number, step.observation)
        if step.number % FRAME_EVERY == 0 or step.is_last:
            self._show(step.number, step.info)

    def on_episode_end(self, error: BaseException | None) -> None:  # noqa: ARG002 - what there was is shown
        """Finish the video, whatever the end was."""
        self._writer.close()

    def video(self) -> bytes | None:
        """The video as a WebM file, once the episode has ended; None if nothing was shown."""
        return self._file.getvalue() or None

    def _look(self, number: int, observation: Observation) -> None:
        if self._picture is not None and PIXELS in observation:
            self._picture.look(number, observation[PIXELS])

    def _show(self, number: int, info: Info) -> None:
        start = time.perf_counter()
        image = self._render()
        if self._picture is not None:
            image = self._picture.draw(image, number, info["stage"])
        self._writer.add(image)
        self.seconds += time.perf_counter() - start


def _state(env: gym.Env) -> EpisodeState | None:
    """The whole state of the running episode, where there is a simulation that can tell it."""
    base = env.unwrapped
    return env.get_wrapper_attr("save_state")() if hasattr(base, "save_state") else None


def _hashes(state: EpisodeState | None) -> StateHashes | None:
    return state and StateHashes(physics=state.physics_hash, stages=state.progress_hash)
