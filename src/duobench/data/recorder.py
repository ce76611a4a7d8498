"""Recording as a wrapper, so that it works in any loop: a rollout, one's own, teleoperation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from duobench.backend import DuoLimits
from duobench.data.after_success import steps_after_success
from duobench.data.dataset import DataSet
from duobench.data.schema import Actor, Domain, EpisodeInfo, Outcome
from duobench.data.stream import EpisodeRows, outcome_of
from duobench.envs import action_modes, spaces
from duobench.envs.action_modes import ActionMode
from duobench.envs.duo_env import TRUNCATION_REASON, Info, Observation, ResetOptions, Start
from duobench.envs.episode_state import EpisodeState
from duobench.envs.execution import optional_method
from duobench.envs.wrapper import DuoWrapper
from duobench.errors import BackendError, DataError
from duobench.looks.catalog import as_look
from duobench.randomness import SUITE_VERSION
from duobench.robot.cameras import describe_cameras
from duobench.types import CONTROL_HZ, Array
from duobench.versions import package_versions

if TYPE_CHECKING:
    from duobench.data.real.robot import Robot
    from duobench.data.real.videos import Videos
    from duobench.envs.sim_env import SimEnv

OBSERVED = ("agent_pos", "tcp_pose")
"""What of the observation is recorded as it is."""
UNDECIDED = "Nobody said whether to keep it."
"""Why an episode is not meant to be used that was left while it waited."""


class Recorder(DuoWrapper):
    """Writes every episode into a data set, while it is played.

    An episode is finished when the environment ends it, and then written as one Parquet file. One
    that is left earlier, by `reset` or `close`, is written as cut. A killed process loses at most
    0.3 seconds; `duobench data recover` turns what is left into an episode.

    With `after_success`, an episode that succeeds goes on for that long before `step` says that it
    is over, also beyond the horizon, while `info["success"]` stays true: so the recording shows how
    the hands open and retreat. Arms that cannot go on end it at once.

    Put it outside the wrapper of the action mode, so that it sees what the policy says, and inside
    wrappers that change the observation's `agent_pos` and `tcp_pose` or scale or chunk actions;
    cameras may be on either side of it, since images are rendered from the recorded states.

    Example:
        >>> env = Recorder(duobench.make("bin_sort"), DataSet.open("demos"), Actor(name="me"))
    """

    def __init__(
        self,
        env: gym.Env,
        data: DataSet | str | Path | None,
        actor: Actor | None = None,
        *,
        after_success: float = 0.0,
        keep: Callable[[Outcome], bool] = lambda _outcome: True,
        is_reviewed: bool = False,
        has_clutch: bool = False,
        robot: Robot | None = None,
    ) -> None:
        """Wrap an environment.

        Args:
            env: An environment that takes single actions and says the stage in `info`; on real arms
                no states are recorded, since there are none.
            data: Data set that episodes are added to, or its folder; None leaves each in `content`.
            actor: Who or what acts.
            after_success: Seconds that an episode goes on after success, rounded to control steps.
            keep: Whether a finished episode is written at all; by default every one is.
            is_reviewed: Whether a finished episode waits for `keep` or `discard`; one that is left
                without is written, and says that it is not meant to be used.
            has_clutch: Whether every row says which hands led their arms; see `clutch`.
            robot: The rig that the environment plays on, whose cameras and full state are recorded
                too, from the first step on: what the first row holds is seen again then.

        Raises:
            DataError: The environment takes chunks of actions, or actions of no known mode, or its
                observation lacks what is to be recorded, or there is no folder for the videos of a
                rig.
            OptionError: The seconds after success are negative or not finite.
        """
        super().__init__(env)
        # Asked without loading the simulation.
        self._sim = cast("SimEnv", self.base) if hasattr(self.base, "simulation") else None
        self.data = DataSet.open(data) if isinstance(data, str | Path) else data
        """What episodes are added to, if anything."""
        self.content: bytes | None = None
        """Without a data set, the last finished episode, as the content of its file."""
        self.actor = actor or Actor()
        """Who or what acts, from the next episode on."""
        self.next_name: str | None = None
        """Name of the next episode's file; without one it is the next free number."""
        self.clutch: tuple[bool, bool] = (False, False)
        """Whether each hand, left then right, leads its arm in the next action."""
        self._has_clutch = has_clutch
        self._is_reviewed = is_reviewed
        self._robot = robot
        if robot is not None and self.data is None:
            raise DataError("What cameras of a rig see is recorded in a data set; name one.")
        self._pending: tuple[EpisodeRows, Outcome, str | None] | None = None
        self._intended: Array | None = None
        self._steps_after_success = steps_after_success(after_success)
        self._steps_left: int | None = None  # None before success
        self._keep = keep
        self._stream: EpisodeRows | None = None
        observed = getattr(env.observation_space, "spaces", {})
        if missing := [name for name in OBSERVED if name not in observed]:
            raise DataError(
                f"The observation lacks {', '.join(missing)}; put the recorder inside wrappers "
                "that change the observation."
            )
        self._mode = _action_mode(env, self.base.backend.limits)

    def reset(self, *, seed: int | None = None, options: ResetOptions = None) -> Start:
        """Begin an episode and its recording; a running one ends here, marked as cut.

        Raises:
            OutputError: The recording cannot be written.
        """
        self._leave(reason="The environment was reset.")
        observation, info = self.env.reset(seed=seed, options=options)
        state = None if self._sim is None else self.save_state()
        config = self.base.config
        if config is not None and self._sim is not None:
            look = self._sim.look  # that of this episode
            config = config if look == as_look(config.look) else replace(config, look=look)
        described = EpisodeInfo(
            task=self.task,
            instruction=info["instruction"],
            subinstructions=tuple(info["stage_to_subinstructions"].values()),
            layout=info.get("layout", {}),
            seed=info.get("seed"),
            split=info.get("split"),
            config=config,
            suite_version=SUITE_VERSION,
            versions=package_versions(),
            actor=self.actor,
            first_hash=state and state.hash,
            action_names=self._mode.names,
            action_mode=self._mode.name,
            after_success=self._steps_after_success / CONTROL_HZ,
            cameras={} if self._sim is None else describe_cameras(),
            task_instruction=self._own_instruction(),
            has_clutch=self._has_clutch,
            domain=Domain.REAL if self._sim is None else Domain.SIM,
        )
        if self._robot is not None:
            described = replace(described, **self._robot.described())
        sizes = {"action": len(self._mode.names), "state": len(self._physics())}
        if self.data is None:
            self.content, self._stream = None, EpisodeRows(described, sizes)
        else:
            self._stream = self.data.new_stream(described, sizes, self.next_name, self._robot)
        self.next_name = self._intended = self._steps_left = None
        self._stream.append(self._seen(self._stream, observation, info))
        return observation, info

    def step(self, action: ArrayLike) -> tuple[Observation, float, bool, bool, Info]:
        """Advance one control step and record it.

        Args:
            action: In the action mode: 16 numbers, or 14 with `cartesian_relative`.

        Raises:
            OutputError: The recording cannot be written.
        """
        given = np.asarray(action)
        wanted, self._intended = self._intended, None
        if self._stream is not None:
            if self._steps_left:
                optional_method(self.env, "allow_step_after_end")()
            self._begin_videos(self._stream)
        try:
            observation, reward, terminated, truncated, info = self.env.step(action)
        except BackendError as error:
            self.finish(reason=str(error))
            raise
        if self._stream is not None:
            row = {"action": given if wanted is None else wanted, "sent": info["sent"]}
            row |= {"clutch": self.clutch} if self._has_clutch else {}
            self._stream.act(row | {"reward": reward})
            self._stream.append(self._seen(self._stream, observation, info))
            reason = info.get(TRUNCATION_REASON)
            if terminated and info["success"] and reason is None and self._steps_after_success:
                terminated, truncated = self._is_enough_after_success(), False
            if terminated or truncated:
                self._end(cut=False, reason=reason)
        return observation, float(reward), terminated, truncated, info

    def intend(self, action: ArrayLike) -> None:
        """Say what the actor wants the next action to be recorded as.

        For an actor that disturbs its own actions: what it wanted is the label to learn from, and
        what is executed then is not.

        Raises:
            ActionError: It has another shape than an action, or holds NaN or infinity.
        """
        self._intended = spaces.checked_action(action, self._mode.names)

    def restore_state(self, state: EpisodeState) -> Start:
        """Continue from a saved state, unrecorded; the recording of the running episode ends here.

        Raises:
            OutputError: The recording cannot be written.
        """
        self._leave(reason="Another state was restored.")
        return super().restore_state(state)

    def finish(self, *, kept: bool = True, reason: str | None = None) -> None:
        """End the recording of the running episode, if there is one, before its end.

        One that has ended and waits for `keep` or `discard` goes on waiting.

        Args:
            kept: Whether it is meant to be used.
            reason: Why it ended, or why it is not.
        """
        self._end(cut=True, kept=kept, reason=reason)

    @property
    def pending(self) -> Outcome | None:
        """How the episode ended that waits for `keep` or `discard`; None while none does."""
        return self._pending and self._pending[1]

    def keep(self) -> None:
        """Write the episode that waits for it, if one does.

        Raises:
            OutputError: It cannot be written.
        """
        pending, self._pending = self._pending, None
        if pending is not None:
            self._write(*pending)

    def discard(self) -> None:
        """Forget the running episode, or the one that waits; nothing of it is kept."""
        for stream in (self._stream, self._pending and self._pending[0]):
            if stream is not None:
                stream.discard()
        self._stream = self._pending = None

    def close(self) -> None:
        """End the running episode, marked as cut, and close the environment."""
        try:
            self._leave(reason="The environment was closed.")
        finally:
            super().close()  # arms stop, whatever could not be written

    def _is_enough_after_success(self) -> bool:
        """Count a step that ended with success, and say whether it is the last one to record."""
        left = self._steps_left
        self._steps_left = self._steps_after_success if left is None else left - 1
        return not self._steps_left

    def _seen(self, stream: EpisodeRows, observation: Observation, info: Info) -> dict[str, Any]:
        """What a row holds of what was seen."""
        backend = self.base.backend
        row: dict[str, Any] = {
            **{name: observation[name] for name in OBSERVED},
            "time": backend.time,
            "joint_velocity": backend.joint_velocities().ravel(),
            "stage": info["stage"],
            "success": info["success"],
            "success_at_end": info["success_at_end"],
            "state": self._physics(),
        }
        return row if self._robot is None else row | self._seen_by(self._robot, stream, row["time"])

    def _seen_by(self, robot: Robot, stream: EpisodeRows, time_s: float) -> dict[str, Any]:
        """What a row holds of what a rig alone sees."""
        row = robot.states(stream.info.robot_state_names)
        videos = _videos_of(stream)
        return row if videos is None else row | videos.see(robot.duo.frames(), time_s)

    def _begin_videos(self, stream: EpisodeRows) -> None:
        """Record what the cameras see from the first step on; a person may take long to begin."""
        videos, robot = _videos_of(stream), self._robot
        if robot is not None and videos is not None and not videos.is_listening:
            row = robot.observe()
            stream.correct(row | self._seen_by(robot, stream, row["time"]))
            videos.listen()

    def _end(self, *, cut: bool, kept: bool = True, reason: str | None = None) -> None:
        stream, self._stream = self._stream, None
        if stream is None:
            return
        self._leave_pending()
        if (videos := _videos_of(stream)) is not None:
            videos.close()  # now, whenever somebody decides
        if not len(stream.rows):  # not even the reset could be recorded
            stream.discard()
            return
        outcome = outcome_of(stream.info, stream.rows, kept=kept, reason=reason, cut=cut)
        if not self._keep(outcome):
            stream.discard()
            return
        # A step that was broken off has left another state than that of the last row.
        is_last = np.array_equal(self._physics(), stream.rows[-1]["state"])
        last_hash = self.state_hash() if self._sim is not None and is_last else None
        if self._is_reviewed:
            self._pending = stream, outcome, last_hash
            stream.flush()
        else:
            self._write(stream, outcome, last_hash)

    def _write(self, stream: EpisodeRows, outcome: Outcome, last_hash: str | None) -> None:
        recording = stream.finish(outcome, last_hash)
        if self.data is None:
            self.content = recording.to_bytes()

    def _leave(self, reason: str) -> None:
        """Write the running episode as cut, and one that waits as it is."""
        self.finish(reason=reason)
        self._leave_pending()

    def _leave_pending(self) -> None:
        """Write an episode that nobody has decided about, as one that is not meant to be used."""
        if self._pending is not None:
            stream, outcome, last_hash = self._pending
            self._pending = stream, replace(outcome, kept=False, reason=UNDECIDED), last_hash
            self.keep()

    def _own_instruction(self) -> str:
        """The task's own instruction, whatever this episode's is."""
        task = self.base.definition
        return task.instruction if self._sim is None else task.instruct(self._sim.layout)

    def _physics(self) -> Array:
        """The state of the simulation; no numbers where there is none."""
        return np.empty(0) if self._sim is None else self._sim.simulation.get_state()


def _videos_of(stream: EpisodeRows) -> Videos | None:
    return getattr(stream, "videos", None)


def _action_mode(env: gym.Env, limits: DuoLimits) -> ActionMode:
    """What an action means here, if the environment takes single ones as its mode has them."""
    mode = action_modes.get(env.get_wrapper_attr("action_mode"))
    if env.action_space != mode.space(limits):
        raise DataError(
            f"The recorder takes single actions as the mode {mode.name!r} has them, not "
            f"{env.action_space}: put it inside wrappers that scale or chunk actions."
        )
    return mode
