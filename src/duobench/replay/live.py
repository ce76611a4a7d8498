"""What whoever plays an episode lets others see of it, and only while they look."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import gymnasium as gym
import msgspec

from duobench.envs.duo_env import base_of
from duobench.envs.sim_env import SimEnv
from duobench.replay.playback import SceneCache
from duobench.web.messages import FRAMES_HZ, pack_frame

if TYPE_CHECKING:
    from duobench.envs.execution import Step
    from duobench.evaluation.rollout import Info, Observation

_log = logging.getLogger(__name__)


class LiveScene(msgspec.Struct, tag=True, frozen=True):
    """Something else is shown from now on."""

    name: str
    """Name of the scene; see `Geometry.name`."""
    data: bytes
    """The scene file."""


class LiveFrame(msgspec.Struct, tag=True, frozen=True):
    """A moment of an episode."""

    frame: bytes
    """Where everything is; see `web.messages.pack_frame`."""
    step: int
    """Control steps so far."""
    stage: int
    """Highest stage so far."""
    instruction: str
    """What is to be done."""
    next: str
    """What is to be done next."""


Live = LiveScene | LiveFrame


class LiveWatcher:
    """Watches episodes that are played, and tells of them at most 30 times a second.

    While nobody looks it does nothing but ask whether somebody does. Whatever goes wrong here ends
    the view of an episode, and never the episode.
    """

    def __init__(self, is_watched: Callable[[], bool], tell: Callable[[Live], object]) -> None:
        """Tell of episodes.

        Args:
            is_watched: Whether somebody looks; called after every control step.
            tell: Takes what there is to see.
        """
        self._is_watched, self._tell = is_watched, tell
        self._base: SimEnv | None = None
        self._scenes = SceneCache()
        self._is_shown = False
        self._next_s = 0.0

    def on_episode_start(self, env: gym.Env, observation: Observation, info: Info) -> None:  # noqa: ARG002 - the protocol's signature
        """Show the start."""
        base = base_of(env)
        self._base = base if isinstance(base, SimEnv) else None
        self._is_shown = False
        self._look(0, info)

    def on_step(self, step: Step) -> None:
        """Show a step, if it is time for another one, or the last."""
        if step.is_last:
            self._next_s = 0.0
        self._look(step.number, step.info)

    def on_episode_end(self, error: BaseException | None) -> None:  # noqa: ARG002 - the protocol's signature
        """Let go of the episode."""
        self._base = None

    def _look(self, step: int, info: Info) -> None:
        if self._base is None:
            return
        if not self._is_watched():
            self._is_shown = False
            return
        now = time.monotonic()
        if now < self._next_s:
            return
        self._next_s = now + 1 / FRAMES_HZ
        try:
            self._show(self._base, step, info, now)
        except Exception:  # noqa: BLE001 - looking on must not change what is seen
            _log.warning("An episode cannot be watched.", exc_info=True)
            self._base = None

    def _show(self, base: SimEnv, step: int, info: Info, now: float) -> None:
        geometry = self._scenes.of(base.simulation, base.look)
        if not self._is_shown:
            self._tell(LiveScene(name=geometry.name, data=geometry.data))
            self._is_shown = True
        self._tell(
            LiveFrame(
                frame=pack_frame(geometry.poses(base.simulation.data), step, now),
                step=step,
                stage=info["stage"],
                instruction=info["instruction"],
                next=info["current_subinstruction"],
            )
        )
