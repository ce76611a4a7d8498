"""Recording as a wrapper, so that it works in any loop: a rollout, one's own, teleoperation."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from duobench.core.backend import DuoLimits
from duobench.core.errors import BackendError, DataError
from duobench.core.randomness import SUITE_VERSION
from duobench.core.types import CONTROL_HZ, Array
from duobench.core.versions import package_versions
from duobench.data.dataset import DataSet
from duobench.data.schema import (
    Actor,
    Domain,
    EpisodeInfo,
    Outcome,
    Takeover,
    steps_after_success,
)
from duobench.data.stream import EpisodeRows, outcome_of
from duobench.envs import action_modes, spaces
from duobench.envs.action_modes import ActionMode
from duobench.envs.config import EnvConfig
from duobench.envs.duo_env import (
    TRUNCATION_REASON,
    DuoWrapper,
    Info,
    Observation,
    ResetOptions,
    Start,
)
from duobench.envs.episode_state import EpisodeState
from duobench.envs.execution import optional_method
from duobench.envs.rewards import reward_of
from duobench.world.looks.catalog import as_look
from duobench.world.robot.cameras import describe_cameras

if TYPE_CHECKING:
    from duobench.data.rig import RigRecorder
    from duobench.envs.sim_env import SimEnv

OBSERVED = ("agent_pos", "tcp_pose")
"""Parts of the observation that are recorded as they are."""
UNDECIDED = "It was not decided whether to keep it."
"""Reason why an episode that was left undecided is not meant to be used."""


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

    Args:
        env: An environment that takes single actions and says the stage in `info`; on real arms
            no states are recorded.
        data: Data set that episodes are added to, or its folder; None leaves each in `content`.
        actor: Who or what acts.
        after_success: Seconds that an episode goes on after success, rounded to control steps.
        keep: Whether a finished episode is written at all; by default every one is.
        is_reviewed: Whether a finished episode waits for `keep` or `discard`; one that is left
            without is written, and says that it is not meant to be used.
        has_clutch: Whether every row says which hands led their arms; see `clutch`.
        rig: Records the cameras and the full state of the rig that the environment plays on,
            from the first step on: what the first row holds is seen again then.

    Raises:
        DataError: The environment takes chunks of actions, or actions of no known mode, or its
            observation lacks what is to be recorded, or there is no folder for the videos of a
            rig.
        OptionError: The seconds after success are negative or not finite.
        OutputError: From any method: the recording cannot be written.

    Example:
        >>> env = duobench.make("bin_sort", split="train")
        >>> env = Recorder(env, DataSet.open("demos"), Actor(name="me"))
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
        rig: RigRecorder | None = None,
    ) -> None:
        super().__init__(env)
        # Asked without loading the simulation.
        self._sim = (
            cast("SimEnv", self.base) if hasattr(self.base, "simulation") else None
        )
        self.data = DataSet.open(data) if isinstance(data, str | Path) else data
        """Data set to which episodes are added, if any."""
        self.content: bytes | None = None
        """Content of the file of the last finished episode, if there is no data set."""
        self.actor = actor or Actor()
        """Actor, from the next episode on."""
        self.next_name: str | None = None
        """Name of the next episode's file; without one it is the next free number."""
        self.clutch: tuple[bool, bool] = (False, False)
        """Whether each hand, left then right, leads its arm in the next action."""
        self.leader: Actor | None = None
        """Actor of the next actions of this episode, where that is not `actor`."""
        self.device: str | None = None
        """Device that the present leader has led with in this episode, where that shows only while
        it runs; else the actor's."""
        if rig is not None and self.data is None:
            raise DataError(
                "What cameras of a rig see is recorded in a data set; name one."
            )
        self._rig = rig
        self._keep = keep
        self._is_reviewed = is_reviewed
        self._episode: EpisodeRows | None = None
        """The running one, or the one that waits."""
        self._intended: Array | None = None
        self._leaders: list[Actor] = []
        self._devices: dict[int, str] = {}  # by the place of who leads
        self._steps_after_success = steps_after_success(after_success)
        self._steps_left = 0  # after success, of an episode that has succeeded
        observed = getattr(env.observation_space, "spaces", {})
        missing = [name for name in OBSERVED if name not in observed]
        if missing:
            raise DataError(
                f"The observation lacks {', '.join(missing)}; put the recorder inside wrappers "
                "that change the observation."
            )
        mode = _action_mode(env, self.base.backend.limits)
        self._of_all = {
            "action_names": mode.names,
            "action_mode": mode.name,
            "after_success": self._steps_after_success / CONTROL_HZ,
            "cameras": {}
            if self._sim is None
            else describe_cameras(self._sim.simulation.robot.gripper),
            "has_clutch": has_clutch,
            "domain": Domain.REAL if self._sim is None else Domain.SIM,
        }  # what every episode says

    def reset(self, *, seed: int | None = None, options: ResetOptions = None) -> Start:
        """Begin an episode and its recording; a running one ends here, marked as cut.

        Raises:
            DataError: The actor is invalid, or the name of the next episode is taken.
        """
        if not isinstance(self.actor, Actor):
            raise DataError(
                f"The actor is an Actor, such as Actor(name='me'), got {self.actor!r}."
            )
        name, self.next_name = self.next_name, None
        self._leave(reason="The environment was reset.")
        observation, info = self.env.reset(seed=seed, options=options)
        described = EpisodeInfo(
            task=self.task,
            reference=self.base.reference,
            instruction=info["instruction"],
            subinstructions=tuple(info["stage_to_subinstructions"].values()),
            layout=info.get("layout", {}),
            seed=info.get("seed"),
            split=info.get("split"),
            config=self._config(),
            suite_version=SUITE_VERSION,
            versions=package_versions(),
            actor=self.actor,
            first_hash=None if self._sim is None else self.state_hash(),
            task_instruction=self._own_instruction(),
            **(
                self._of_all
                if self._rig is None
                else self._of_all | self._rig.described()
            ),
        )
        sizes = {"action": len(described.action_names), "state": len(self._physics())}
        if self.data is None:
            self.content, self._episode = None, EpisodeRows(described, sizes)
        else:
            self._episode = stream = self.data.new_stream(described, sizes, name)
            if self._rig is not None:
                self._rig.begin(stream)
        self._intended = None
        self._steps_left = 0
        self.device = self.leader = None
        self._leaders = []
        self._devices = {}
        self._episode.append(self._seen(self._episode, observation, info))
        return observation, info

    def step(self, action: ArrayLike) -> tuple[Observation, float, bool, bool, Info]:
        """Advance one control step, by an action in the action mode, and record it."""
        given = np.asarray(action)
        episode = self._running
        if episode is not None:
            if self._steps_left:
                optional_method(self.env, "allow_step_after_end")()
            if self._rig is not None:
                self._rig.begin_step(episode)
        try:
            observation, reward, terminated, truncated, info = self.env.step(action)
        except BackendError as error:
            self.finish(reason=str(error))
            raise
        # Not before: a wrong action is given again.
        wanted, self._intended = self._intended, None
        if episode is not None:
            row = {"action": given if wanted is None else wanted, "sent": info["sent"]}
            row |= {"clutch": self.clutch} if episode.info.has_clutch else {}
            place = self._place_of_leader(episode)
            self._note_leaders(episode, place)
            row |= {"leader": place}
            episode.complete(row | {"reward": reward})
            episode.append(self._seen(episode, observation, info))
            reason = info.get(TRUNCATION_REASON)
            if not info["success"]:  # a person may take it back
                self._steps_left = 0
            elif terminated and reason is None and self._steps_after_success:
                left = self._steps_left
                self._steps_left = left - 1 if left else self._steps_after_success
                terminated, truncated = not self._steps_left, False
            if terminated or truncated:
                self.finish(cut=False, reason=reason)
        return observation, float(reward), terminated, truncated, info

    def pause(self) -> None:
        """Say that time passes on a rig that is not recorded, before the next step.

        Videos stand still, and the last row is seen again when the episode goes on.
        """
        if self._rig is not None and self._running is not None:
            self._rig.pause(self._running)

    def intend(self, action: ArrayLike) -> None:
        """Say what the actor wants the next action to be recorded as.

        For an actor that disturbs its own actions: what it wanted is the label to learn from, and
        what is executed then is not.

        Raises:
            ActionError: It has another shape than an action, or holds NaN or infinity.
        """
        self._intended = spaces.checked_action(action, self._of_all["action_names"])

    def take_over(
        self,
        leader: Actor,
        why: str = "",
    ) -> None:
        """Let another actor lead from the next action on, in the place of a policy.

        Args:
            leader: That actor; `leader` is set again when the policy goes on.
            why: Reason, as far as it is known; see `explain`.
        """
        self.leader = leader
        episode = self._running
        if episode is not None:
            takeover = Takeover(
                step=len(episode.rows) - 1,
                why=why,
            )
            episode.note(takeovers=(*episode.info.takeovers, takeover))

    def explain(self, why: str) -> None:
        """Say why the last take-over of the running episode began, if there was one."""
        episode = self._running
        if episode is not None and episode.info.takeovers:
            *before, last = episode.info.takeovers
            episode.note(takeovers=(*before, replace(last, why=why)))

    def _place_of_leader(self, episode: EpisodeRows) -> int:
        """Place of who leads this row among those who led; the first one is the actor."""
        first = self._leaders[0] if self._leaders else episode.info.actor
        leader = self.leader or first
        if leader not in self._leaders:
            self._leaders.append(leader)
        return self._leaders.index(leader)

    def _note_leaders(
        self,
        episode: EpisodeRows,
        place: int,
    ) -> None:
        """Note who has led so far, where the one at a place led last, and with which devices."""
        if self.device is not None:
            self._devices[place] = self.device
        actors = tuple(map(self._with_device, range(len(self._leaders))))
        if actors != episode.info.actors:
            is_shared = len(self._leaders) > 1
            leaders = actors if is_shared else ()
            episode.note(
                actor=actors[0],
                leaders=leaders,
            )

    def _with_device(self, place: int) -> Actor:
        """A leader with the last device of its own rows; a policy has none."""
        leader = self._leaders[place]
        if leader.kind.is_policy:
            return leader
        device = self._devices.get(place) or self.device or leader.device
        return replace(leader, device=device)

    def restore_state(self, state: EpisodeState) -> Start:
        """Continue from a saved state, unrecorded; the running episode's recording ends here."""
        self._leave(reason="Another state was restored.")
        return super().restore_state(state)

    def finish(
        self, *, cut: bool = True, kept: bool = True, reason: str | None = None
    ) -> None:
        """End the recording of the running episode, if there is one.

        One that has ended and waits for `keep` or `discard` goes on waiting.

        Args:
            cut: Whether it ends before the environment ended it.
            kept: Whether it is meant to be used.
            reason: Why it ended, or why it is not.
        """
        episode = self._running
        if episode is None:
            return
        rows = episode.rows
        if not len(rows):  # not even the reset could be recorded
            self.discard()
            return
        outcome = outcome_of(
            episode.info,
            rows,
            kept=kept,
            reason=reason,
            cut=cut,
        )
        if not self._keep(outcome):
            self.discard()
            return
        # A step that was broken off has left another state than that of the last row.
        is_last = np.array_equal(self._physics(), rows[-1]["state"])
        last_hash = self.state_hash() if self._sim is not None and is_last else None
        if self._leaders:
            self._note_leaders(episode, int(rows["leader"][-2]))
        info = episode.info
        episode.info = replace(
            info,
            outcome=outcome,
            last_hash=last_hash,
            takeovers=tuple(one for one in info.takeovers if one.step < len(rows) - 1),
        )
        if self._is_reviewed:
            episode.flush()
        else:
            self._write()

    @property
    def pending(self) -> Outcome | None:
        """Outcome of the episode that waits for `keep` or `discard`; None otherwise."""
        return self._episode and self._episode.info.outcome

    def keep(self) -> None:
        """Write the episode that waits for it, if one does."""
        if self.pending is not None:
            self._write()

    def correct(self, changes: Iterable[tuple[int, int]], *, holds: bool) -> None:
        """Set a person's judgement of the waiting episode, if one waits.

        Args:
            changes: Pairs (control step, stage), each in the rows after that step, or in the last.
            holds: Whether the last stage still held at the end.
        """
        episode = self._episode
        if episode is None or (outcome := self.pending) is None:
            return
        rows = episode.rows
        last = outcome.max_stage
        info = episode.info
        stage = np.zeros_like(rows["stage"])
        for step, reached in changes:
            stage[min(step + 1, len(rows) - 1) :] = reached
        rows["stage"] = stage
        rows["success"] = stage == last
        rows["success_at_end"] = stage == last
        rows["success_at_end"][-1] &= holds
        if info.config is not None:
            rows["reward"][:-1] = reward_of(
                info.config.reward, stage[:-1], stage[1:], last
            )
        told = {"kept": outcome.kept, "reason": outcome.reason, "cut": outcome.cut}
        outcome = outcome_of(info, rows, **told)
        episode.info = replace(info, outcome=outcome)
        if outcome.success_step is not None:  # seen late, it did not end the episode
            after_s = (len(rows) - 1 - outcome.success_step) / CONTROL_HZ
            episode.info = replace(episode.info, after_success=after_s)

    def set_aside(self, reason: str) -> None:
        """Write the running episode, which ends for a reason, or the one that waits.

        It is written as if it were kept, into the `discarded` ones of the data set.
        """
        self.finish(reason=reason)
        if self.pending is not None and self.data is not None:
            self._write(self.data.discarded.episode(self.task, "0").parent)

    def discard(self) -> None:
        """Forget the running episode, or the one that waits; nothing of it is kept."""
        episode, self._episode = self._episode, None
        if episode is not None:
            episode.discard()

    def close(self) -> None:
        """End the running episode, marked as cut, and close the environment."""
        try:
            self._leave(reason="The environment was closed.")
        finally:
            super().close()  # arms stop even if writing failed

    @property
    def _running(self) -> EpisodeRows | None:
        """Episode that is being recorded; None between episodes, and while one waits."""
        return self._episode if self.pending is None else None

    def _seen(
        self, episode: EpisodeRows, observation: Observation, info: Info
    ) -> dict[str, Any]:
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
        return row if self._rig is None else row | self._rig.seen(episode, row["time"])

    def _write(self, folder: Path | None = None) -> None:
        """Write the episode that has ended; where that fails, it is left to `recover`."""
        episode, self._episode = self._episode, None
        if episode is not None:
            recording = episode.finish(folder)
            if self.data is None:
                self.content = recording.to_bytes()

    def _leave(self, reason: str) -> None:
        """Write the running episode as cut, and one that waits as not meant to be used."""
        self.finish(reason=reason)
        if self._episode is not None and self.pending is not None:
            outcome = replace(self.pending, kept=False, reason=UNDECIDED)
            self._episode.info = replace(self._episode.info, outcome=outcome)
            self._write()

    def _config(self) -> EnvConfig | None:
        config = self.base.config
        if (
            config is None
            or self._sim is None
            or self._sim.look == as_look(config.look)
        ):
            return config
        return replace(config, look=self._sim.look)

    def _own_instruction(self) -> str:
        """The task's own instruction, which this episode's may paraphrase."""
        task = self.base.definition
        return (
            task.instruction if self._sim is None else task.instruct(self._sim.layout)
        )

    def _physics(self) -> Array:
        """State of the simulation; empty on real arms."""
        return np.empty(0) if self._sim is None else self._sim.simulation.get_state()


def _action_mode(env: gym.Env, limits: DuoLimits) -> ActionMode:
    """Mode of an action here, if the environment takes single ones as its mode has them."""
    mode = action_modes.get(env.get_wrapper_attr("action_mode"))
    if env.action_space != mode.space(limits):
        raise DataError(
            f"The recorder takes single actions as the mode {mode.name!r} has them, not "
            f"{env.action_space}: put it inside wrappers that scale or chunk actions."
        )
    return mode
