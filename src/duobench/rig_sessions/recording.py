"""Recording what a policy does on a rig, episode by episode, with an operator at a terminal.

The operator sends the arms home, places the objects, has the policy play, says how far it came, and
keeps or discards the episode. Nothing moves without a key.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from duobench.data import Actor, ActorKind, DataSet, Recorder
from duobench.data.rig import RigRecorder, placement
from duobench.data.schema import AFTER_SUCCESS_S
from duobench.envs.config import IMAGE_SIZE, INSTRUCTION, LAYOUT, SPLIT
from duobench.envs.duo_env import ResetOptions, Start
from duobench.envs.wrapper import DuoWrapper
from duobench.errors import BackendError, OptionError, PolicyError
from duobench.evaluation.policies import PolicyChoice, PolicySource, find_source
from duobench.evaluation.rollout import rollout
from duobench.hardware.clock import VirtualClock
from duobench.hardware.duo import HardwareDuo
from duobench.hardware.env import make_real_env
from duobench.hardware.judge import DeclaredJudge
from duobench.randomness import TRAIN, episode_seed
from duobench.results.limits import TimeLimits
from duobench.results.suite import find_tasks
from duobench.rig_sessions.operator import QUIT, Operator
from duobench.rig_sessions.playback import TEMPO, Playback

EPISODE_SUFFIX = ".parquet"
"""What ends the name of a policy that is a recorded episode."""
PLAYING = "It plays. 1 to {last}: this stage is reached; s: solved; u: undo; space: hold both arms."
HELD_BY_OPERATOR = "The operator held the arms."
OPERATOR_LOST = "The operator's terminal is gone."
OVER = "The episode is over."
FAULT = "Something is wrong: {}\nSet it right, then r: recover; q: end."
HOME = "Clear the space of the arms. h: they go home slowly, with open grippers; q: end."
PLACE = "Place the objects:\n{}\np: placed, the arms may move; q: end."
DECIDE = "{} k: keep it; d: discard it; q: end, and leave it undecided."


class Placed(DuoWrapper):
    """Begins every episode with the layout that a person has placed."""

    def __init__(self, env: DuoWrapper) -> None:
        """Wrap an environment of real arms."""
        super().__init__(env)
        self.options: dict[str, object] = {}
        """Options of the next reset."""

    def reset(self, *, seed: int | None = None, options: ResetOptions = None) -> Start:
        """Begin an episode."""
        return self.env.reset(seed=seed, options={**(options or {}), **self.options})


def find_policy(name: str, tempo: float = TEMPO) -> PolicySource:
    """A policy by its name, or a recorded episode as one.

    Args:
        name: A name that `PolicyChoice.parse` takes, or a file of a recorded episode.
        tempo: Part of its speed with which a recorded episode is played.

    Raises:
        UnknownNameError: There is none of that name.
        PolicyError: It reads the simulation, or cannot be made.
        DataError: The episode cannot be read.
    """
    if name.endswith(EPISODE_SUFFIX):
        playback = Playback.read(Path(name), tempo)
        return PolicySource(metadata=playback.metadata, bind=lambda _env: playback)
    choice = PolicyChoice.parse(name)
    if choice.is_scripted:
        raise PolicyError(
            f"{name} reads the simulation, which real arms do not have; name a policy that sees "
            "images, or the file of a recorded episode."
        )
    return find_source(choice, (), TimeLimits())


class RealRecording:
    """A session at a rig: one episode of a policy after the other."""

    def __init__(  # noqa: PLR0913 - what can be chosen about it
        self,
        duo: HardwareDuo,
        task: str,
        data: DataSet,
        source: PolicySource,
        operator: Operator,
        *,
        actor: str = "",
        episodes: int = 10,
        instruction: str = "",
        horizon: int | None = None,
        after_success: float = AFTER_SUCCESS_S,
    ) -> None:
        """Connect to the rig; nothing moves.

        Args:
            duo: The rig, which belongs to the session from now on.
            task: The task, its id, or its import path.
            data: Where episodes are added.
            source: The policy.
            operator: Who places, watches and decides.
            actor: What the policy is called in recordings; by default as its metadata says.
            episodes: How many are to be kept, those of earlier sessions in the data set counted.
            instruction: What the policy is told; empty for the task's own words.
            horizon: Control steps of an episode at most; the task's own where none is given.
            after_success: Seconds that an episode goes on after success.

        Raises:
            UnknownNameError: There is no such task, or the rig lacks a camera of the policy.
            OptionError: A number is out of range.
            BackendError: A device cannot be reached.
        """
        if episodes < 1:
            raise OptionError(f"A session records at least one episode, got {episodes}.")
        self._operator, self._source, self._wanted = operator, source, episodes
        self._instruction = instruction
        metadata = source.metadata
        (info,) = find_tasks([task])
        env = make_real_env(
            duo,
            task,
            cameras=metadata.cameras,
            image_size=metadata.image_size or IMAGE_SIZE,
            action_mode=metadata.action_mode,
            horizon=horizon or info.horizon,
        )
        self._duo = duo
        self._judge: DeclaredJudge = env.get_wrapper_attr("judge")
        is_program = isinstance(source.bind(env), Playback)
        who = Actor(
            kind=ActorKind.PROGRAM if is_program else ActorKind.POLICY,
            name=actor or metadata.name,
            version=metadata.version,
        )
        rig = RigRecorder(duo, waits=isinstance(duo.clock, VirtualClock))
        self.env = Recorder(env, data, who, is_reviewed=True, rig=rig, after_success=after_success)
        """The environment, which records."""
        self._placed = Placed(self.env)
        self._policy = source.bind(self._placed)
        self._data = data
        self.kept = data.kept(self.env.task)
        """Episodes of the task that are kept, those of earlier sessions counted."""

    def run(self) -> int:
        """Record until as many episodes are kept as were wanted, or the operator ends it.

        Returns:
            How many are kept.

        Raises:
            OutputError: An episode cannot be written.
        """
        while self.kept < self._wanted:
            if not (self._prepare() and self._play_one()):
                break
        return self.kept

    def close(self) -> None:
        """End the session: the arms stop, and an episode nobody decided about says so."""
        try:
            self._placed.close()
        finally:
            self._source.close()

    def _prepare(self) -> bool:
        """Have the arms go home at the operator's word; whether to go on."""
        self._operator.say(f"Kept so far: {self.kept} of {self._wanted}.")
        while True:
            supervisor = self._duo.supervisor
            if supervisor.fault is not None:
                if self._operator.ask(FAULT.format(supervisor.reason), f"r{QUIT}") == QUIT:
                    return False
                with suppress(BackendError):  # then it is said again, with what is still wrong
                    supervisor.recover()
                continue
            if self._operator.ask(HOME, f"h{QUIT}") == QUIT:
                return False
            try:
                supervisor.confirm()
                with self._watched():
                    self._duo.home()
            except BackendError as error:
                self._operator.say(str(error))
            else:
                supervisor.revoke()  # hands are among the objects now
                return True

    def _play_one(self) -> bool:
        """Have one episode placed, played and decided; whether to go on."""
        task = self.env.base.definition
        number = self._data.next_number(self.env.task)
        seed = episode_seed(self.env.task, number, TRAIN)
        layout = next(task.layouts(seed, TRAIN))
        if self._operator.ask(PLACE.format(placement(layout)), f"p{QUIT}") == QUIT:
            return False
        self.env.next_name = f"{number:05d}"
        options = {LAYOUT: layout, SPLIT: TRAIN, INSTRUCTION: self._instruction or None}
        self._placed.options = {name: value for name, value in options.items() if value is not None}
        self._operator.say(PLAYING.format(last=task.max_stage))
        error = ""
        try:
            self._duo.supervisor.confirm()
            with self._watched():
                rollout(self._placed, self._policy, seed=seed)
        except (BackendError, PolicyError) as failure:
            error = str(failure)
            self.env.finish(kept=False, reason=error)
        self._duo.hold(OVER)
        return self._decide(error)

    def _decide(self, error: str) -> bool:
        outcome = self.env.pending
        if outcome is None:
            self._operator.say(f"Nothing was recorded. {error}")
            return True
        how = "It is solved." if outcome.success else f"It ended at stage {outcome.stage}."
        why = error or outcome.reason or ""
        answer = self._operator.ask(DECIDE.format(f"{how} {why}".strip()), f"kd{QUIT}")
        if answer == "k":
            self.env.keep()
            self.kept += int(outcome.kept)
        elif answer == "d":
            self.env.discard()
        return answer != QUIT

    def _watched(self) -> _Watched:
        return _Watched(self._operator, self._duo, self._judge, self.env.base.definition.max_stage)


class _Watched:
    """A block in which the arms move, and keys of the operator count at once."""

    def __init__(
        self, operator: Operator, duo: HardwareDuo, judge: DeclaredJudge, last: int
    ) -> None:
        self._operator, self._duo, self._judge, self._last = operator, duo, judge, last

    def __enter__(self) -> None:
        self._operator.listen(self._take)

    def __exit__(self, *_: object) -> None:
        self._operator.listen(None)

    def _take(self, key: str) -> None:
        """Do what a key says, in the operator's thread."""
        if key in {"", " "}:
            self._duo.hold(HELD_BY_OPERATOR if key else OPERATOR_LOST)
        elif key == "u":
            self._judge.undo()
        elif key == "s":
            self._judge.declare(self._last)
        elif key.isdecimal() and 0 < int(key) <= self._last:
            self._judge.declare(int(key))
