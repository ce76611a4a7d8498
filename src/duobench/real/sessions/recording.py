"""Recording of a policy on a rig, with an operator at a terminal: episodes are not judged.

Nothing moves without a key. A recorded episode is a policy too: what was sent to the arms then is
sent again, more slowly.
"""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from duobench.core.errors import OptionError, OutputError, PolicyError
from duobench.core.randomness import TRAIN, episode_seed
from duobench.core.types import Array
from duobench.data import (
    Actor,
    ActorKind,
    DataSet,
    Recording,
)
from duobench.data.rig import placement
from duobench.data.schema import AFTER_SUCCESS_S
from duobench.envs.action_modes import JOINT
from duobench.envs.config import INSTRUCTION, LAYOUT, SPLIT
from duobench.evaluation.policies import PolicySource
from duobench.policy import PolicyMetadata
from duobench.policy.policy import robot_note
from duobench.real.duo import FrankaDuo
from duobench.real.env import make_real_env
from duobench.real.sessions.operator import Operator, TerminalView
from duobench.real.sessions.policy_runner import (
    PolicyRunner,
    find_rig_policy,
    make_rig_recorder,
)
from duobench.real.sessions.session import RigSession, Stopped
from duobench.results.run import needed_options
from duobench.results.suite import find_tasks
from duobench.world.sim.layout import Layout

EPISODE_SUFFIX = ".parquet"
"""Suffix of the name of a policy that is a recorded episode."""
TEMPO = 0.5
"""Part of the recorded speed with which it is played."""
CHUNK = 30
"""Actions of a chunk."""


class Playback:
    """Sends the commands of a recorded episode, joint targets and openings, in a slower tempo.

    Args:
        recording: The episode, simulated or real.
        name: What to call it.
        tempo: Part of its speed, at most 1; commands in between are interpolated.
    """

    def __init__(
        self, recording: Recording, name: str = "playback", tempo: float = TEMPO
    ) -> None:
        if not len(recording):
            raise PolicyError("The episode has no commands that could be played.")
        if not 0.0 < tempo <= 1.0:
            raise OptionError(f"The tempo is over 0 and at most 1, got {tempo}.")
        self.commands = slowed(recording.sent, tempo)
        """The commands (n, 16) that are played."""
        self.metadata = PolicyMetadata(
            name=f"{name} at {tempo:g} of its speed",
            cameras=(),
            action_mode=JOINT.name,
            robot=recording.info.other_robot,
        )

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002 - as policies have it
        """Begin at the first command."""
        self._next = 0

    def act(self, observation: Mapping[str, Any]) -> Array:  # noqa: ARG002 - it looks at nothing
        """The next commands (30, 16); after the last one, that one."""
        places = np.minimum(self._next + np.arange(CHUNK), len(self.commands) - 1)
        self._next += CHUNK
        return self.commands[places]


def slowed(commands: Array, tempo: float) -> Array:
    """Commands (n, 16) at a part of their speed, interpolated.

    Returns:
        Commands (m, 16) that begin and end with the same ones, one a control step.
    """
    last = len(commands) - 1
    times = np.minimum(np.arange(int(np.ceil(last / tempo)) + 1) * tempo, last)
    steps = np.arange(len(commands))
    return np.stack([np.interp(times, steps, column) for column in commands.T], axis=1)


def find_policy(name: str, tempo: float = TEMPO) -> PolicySource:
    """A policy as `find_rig_policy` finds it, or the file of a recorded episode as one.

    The tempo is the part of its speed with which a recorded episode is played.
    """
    if not name.endswith(EPISODE_SUFFIX):
        return find_rig_policy(name)
    path = Path(name)
    recording = Recording.read(path)
    playback = Playback(
        recording, f"playback of {recording.info.task}/{path.stem}", tempo
    )
    return PolicySource(metadata=playback.metadata, bind=lambda _env: playback)


class RigRecording(RigSession):
    """A session at a rig that records one episode of a policy after the other; nothing moves yet.

    Args:
        duo: The rig, which belongs to the session from now on.
        task: The task, its id, or its import path.
        data: Where episodes are added.
        source: The policy.
        operator: Who places, watches and decides.
        episodes: How many are to be kept, those of earlier sessions in the data set counted.
        instruction: What the policy is told; empty for the task's own words.
        horizon: Control steps of an episode at most; the task's own where none is given.
        after_success: Seconds that an episode goes on after success.
    """

    def __init__(  # noqa: PLR0913 - what can be chosen about it
        self,
        duo: FrankaDuo,
        task: str,
        data: DataSet,
        source: PolicySource,
        operator: Operator,
        *,
        episodes: int = 10,
        instruction: str = "",
        horizon: int | None = None,
        after_success: float = AFTER_SUCCESS_S,
    ) -> None:
        if episodes < 1:
            raise OptionError(
                f"A session records at least one episode, got {episodes}."
            )
        self._operator = operator
        self._source = source
        self._data = data
        self._wanted = episodes
        metadata = source.metadata
        (info,) = find_tasks([task])
        horizon = horizon or info.horizon
        env = make_real_env(
            duo,
            task,
            **needed_options(metadata),
            horizon=horizon,
        )
        super().__init__(duo, env.get_wrapper_attr("judge"))
        who = Actor(kind=ActorKind.POLICY, name=metadata.name, version=metadata.version)
        self.env = make_rig_recorder(
            env,
            duo,
            data,
            who,
            after_success=after_success,
        )
        """The environment, which records."""
        self._runner = PolicyRunner(self.env, source)
        if isinstance(self._runner.policy, Playback):
            self.env.actor = Actor(
                kind=ActorKind.PROGRAM, name=who.name, version=who.version
            )
        self._layout = Layout(poses={})
        self._options = {SPLIT: TRAIN} | (
            {INSTRUCTION: instruction} if instruction else {}
        )
        self.view = self._terminal = TerminalView(self, operator)
        self.kept = data.kept(self.env.task)
        """Number of kept episodes of the task, with those of earlier sessions."""

    def run(self) -> int:
        """Record until so many episodes are kept, or the operator ends it; how many are kept."""
        with suppress(Stopped):
            note = robot_note(
                self._source.metadata, self.env.get_wrapper_attr("config")
            )
            if note:
                self._operator.say(note)
            while self.kept < self._wanted:
                self._operator.say(f"Kept so far: {self.kept} of {self._wanted}.")
                self._record_one()
        return self.kept

    def close(self) -> None:
        """End the session: the arms stop, and an undecided episode says so."""
        try:
            self._runner.env.close()
        finally:
            self._runner.asked.close()
            self._source.close()

    def keep_placed(self) -> None:
        """Place the objects of a rehearsal."""
        self.duo.place(self.env.base.definition, self._layout)

    def _record_one(self) -> None:
        self.begin()
        number = self._data.next_number(self.env.task)
        seed = episode_seed(self.env.task, number, TRAIN)
        self._layout = layout = next(self.env.base.definition.layouts(seed, TRAIN))
        self._terminal.placing = placement(layout)
        while True:
            self.place()
            self.env.next_name = f"{number:05d}"
            played = self.play(self._runner, seed, {**self._options, LAYOUT: layout})
            if isinstance(played.failure, OutputError):
                raise played.failure
            if played.has_begun:
                break
            self.env.discard()
        error = str(played.error or played.failure or "")
        if error:
            self.env.finish(kept=False, reason=error)
        outcome = self.env.pending
        if outcome is None:
            self._operator.say(f"Nothing was recorded. {error}")
            return
        how = (
            "It is solved."
            if outcome.success
            else f"It ended at stage {outcome.stage}."
        )
        why = played.ending if played.reasons else error or outcome.reason or ""
        reason = self.decide(played, f"{how} {why}".strip())
        if reason:
            self.env.discard()
            self._operator.say(reason)
        else:
            self.env.keep()
            self.kept += int(outcome.kept)
