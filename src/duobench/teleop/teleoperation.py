"""A session of teleoperation: one episode after the other, led by an operator.

The environment judges, and says when the task is solved.
"""

import math
from collections.abc import Callable, Collection
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Any, Self, cast

import numpy as np

from duobench.core.errors import (
    BackendError,
    DuoBenchError,
    OptionError,
    PolicyError,
)
from duobench.core.randomness import TRAIN, episode_seed
from duobench.core.types import (
    CONTROL_HZ,
    SIDES,
    DuoState,
    Side,
)
from duobench.data import Actor, DataSet, Recorder
from duobench.data.attempts import SKIPPED, Attempt
from duobench.data.recorder import UNDECIDED
from duobench.data.schema import AFTER_SUCCESS_S
from duobench.envs.action_modes import CARTESIAN
from duobench.envs.config import INSTRUCTION, SPLIT
from duobench.envs.duo_env import Info
from duobench.envs.protocol import make_env
from duobench.envs.sim_env import SimEnv
from duobench.policy import PolicyMetadata
from duobench.results.run import needed_options
from duobench.tasks.stages.progress import ProgressState
from duobench.tasks.task import Task
from duobench.teleop.hands import DISCARD, KEEP, ButtonPresses
from duobench.teleop.intent import Intent, TeleopDevice
from duobench.teleop.messages import (
    Alone,
    Discard,
    GoOn,
    Hands,
    Hold,
    Inbox,
    Instruction,
    Keep,
    Message,
    Operator,
    Restore,
)
from duobench.teleop.pace import Pace
from duobench.teleop.panel import (
    LEAD,
    SOLVED,
    Button,
    Panel,
)
from duobench.teleop.plan import MOST_EPISODES, TaskProgress
from duobench.teleop.policy_leader import PolicyLeader, SharedControl
from duobench.teleop.session_episodes import SessionEpisodes
from duobench.web.messages import SelectItem
from duobench.world.looks.catalog import DEFAULT
from duobench.world.looks.look import Look
from duobench.world.robot.gripper import DEFAULT_GRIPPER

TIME_LIMIT_S = 600.0
"""Seconds that an episode may be led: over twenty times the horizon of every task. Thinking is not
counted, so that only a clutch that was forgotten comes to its end."""
WARNED_S = 10.0
"""Seconds before that end in which it is said."""
ARM_REST = 0.02
"""Joint speed in rad/s below which an arm is at rest."""
STILL = 0.2
"""Share of the speeds at the end of a reset, 5 mm/s and 0.1 rad/s, below which objects are: a door
that falls shut slowly is not; what rests on the table or in a hand moves by a thirtieth of them."""
TOUCH, LIMIT, LOSS = (0.4, 40), (0.8, 80), (1.0, 200)
"""Strength, 0 to 1, and length in ms of the pulse when fingers touch something, when an arm is kept
from where its hand wants it, and when a hand lets go, or is lost."""
RETREAT = "Solved: open the hands and retreat."
UNSOLVED = "The task is not solved yet; discard ends the episode."
ASKED_LATER = "Episode {} is asked about once this one is over, and kept or discarded."
LATER = "The new instruction is that of the next episode."
NEXT_TASK = "The task that was chosen comes next."
KEPT = "Kept. The next layout is prepared."
DISCARDED = "Discarded."
"""Reason why an episode is not kept."""
AWAY = "No operator drives: the recording waits until one does."
ENDING = "{:.0f} s are left of the {:.0f} s that this episode may be led."
HOLDING = "Space bar and this button: both hands let go, and everything stands still."
HELD = "Held: nothing moves. Let go and squeeze again, or press Go on."
TITLES = {
    "making_ready": "Getting ready",
    "preparing": "The next layout is prepared",
    "waiting": "Waiting for the first move",
    "recording": "Recording",
    "success": "Success",
    "paused": "Paused",
    "held": "Held",
    "decide": "Keep or discard?",
    "over": "Over",
}
"""States in words."""


class TeleopState(StrEnum):
    """State of an episode."""

    MAKING_READY = "making_ready"
    """The arms of a rig are made ready, step by step; nothing is recorded."""
    WAITING = "waiting"
    """Everything is in its place; nothing moves and nothing is recorded before the operator
    begins."""
    RECORDING = "recording"
    """The operator leads: every step is recorded, and none is made while nothing is led and all
    is at rest."""
    SUCCESS = "success"
    """The task is solved; the recording goes on for a moment."""
    PAUSED = "paused"
    """The operator is away: nothing moves and nothing is recorded until one is back."""
    HELD = "held"
    """A visitor said hold: nothing moves and nothing is recorded until the operator goes on."""
    DECIDE = "decide"
    """The episode is over, and the operator says whether to keep it."""
    PREPARING = "preparing"
    """The next layout is prepared."""
    OVER = "over"
    """The wanted number of episodes is kept."""


_RUNNING = (TeleopState.RECORDING, TeleopState.SUCCESS)
"""States in which control steps are made and recorded, as long as the world runs."""
_UNBEGUN = (TeleopState.MAKING_READY, TeleopState.WAITING)
"""States before an episode begins."""
_LED = (*_RUNNING, TeleopState.PAUSED, TeleopState.HELD)
"""States of an episode that a person leads."""
_DISCARDED = (*_LED, TeleopState.DECIDE)
"""States in which an episode may be discarded."""


class Teleoperation:
    """Records episodes of one task that an operator leads.

    Messages may come from any thread, with `receive`. Everything else belongs to one thread, which
    calls `advance` thirty times a second, or once for each message; see `teleop_page.run`.

    Args:
        env: Environment that records, with review and clutch; see `make_recorder`.
        device: Device that the operator leads with.
        episodes: How many layouts are wanted, those of earlier sessions in the same data set
            counted; or which ones.
        times: How many episodes of each are wanted.
        tasks: Ids of tasks of which the operator may choose the next one, see `chosen`.
        instruction: Instruction of the operator; empty for the task's own.
        lockstep: Whether each message of hands is one turn, and nothing moves between.
        policy: Policy that leads until the operator takes over, in whose action mode the
            environment is.

    Raises:
        OptionError: The number is less than one, or the environment takes other actions.
        LeaderError: The operator cannot let go of the device, so that no policy can lead.
    """

    keeps = (TeleopState.SUCCESS, TeleopState.DECIDE)
    """States in which the operator may say that an episode is to be kept."""

    def __init__(
        self,
        env: Recorder,
        device: TeleopDevice,
        *,
        episodes: int | range = 10,
        times: int = 1,
        tasks: Collection[str] = (),
        instruction: str = "",
        lockstep: bool = False,
        policy: PolicyLeader | None = None,
    ) -> None:
        count = episodes if isinstance(episodes, int) else len(episodes)
        if not 1 <= count <= MOST_EPISODES:
            raise OptionError(
                f"A session records 1 to {MOST_EPISODES:,} episodes, got {count}."
            )
        mode = env.get_wrapper_attr("action_mode")
        if policy is None and mode != device.action_mode:
            raise OptionError(
                f"The device gives actions of the mode {device.action_mode!r}, and the environment "
                f"takes those of {mode!r}; make the environment with that action mode."
            )
        self.env = env
        self.device = device
        self.lockstep = lockstep
        self.note = ""
        """A sentence for the operator."""
        self.haptics = Haptics(env)
        self.leading = SharedControl(env, device, policy)
        """Who leads: the operator or a policy."""
        self.chosen = ""
        """Id of the task that the operator wants to lead next, where the session ends for it."""
        self.before_reset: Callable[[], object] = lambda: None
        """Called before the next layout is prepared, which takes a while."""
        self.pace = Pace()
        """Decides in each turn of an episode whether the world runs."""
        self._tasks, self._instruction = tasks, instruction
        self._inbox, self._presses = Inbox(), ButtonPresses()
        self._is_held = False
        data = env.data
        self._episodes = None if data is None else SessionEpisodes(env, data)
        self._is_settled = False
        """Whether the episode that is over was kept or discarded."""
        self._progress = TaskProgress(data, env.task, episodes, times)
        self.number = 0 if self._episodes is None else self._episodes.next_number
        """Number of the episode, which is the name of its file."""
        layout = self._progress.next_layout()
        self._layout = layout or 0
        self._reset()
        if layout is None:
            self._end_session()

    # --- from any thread ---------------------------------------------------------------------

    def receive(self, message: Message, now_s: float) -> None:
        """Take a message of the operator, which arrived at a time on the clock of `advance`."""
        self._inbox.put(message, now_s)

    def leave(self, now_s: float) -> None:
        """The operator has gone, or the connection is lost: both hands let go, and time stops."""
        self._inbox.put(None, now_s)

    # --- from the session's own thread ---------------------------------------------------------

    def wait(self, timeout_s: float) -> None:
        """Wait for a message, or for so many seconds."""
        self._inbox.wait(timeout_s)

    def advance(self, now_s: float) -> bool:
        """Do what the messages say, and a control step if an episode and the world run.

        In lockstep that is at most one step for one message of hands, and none without.

        Args:
            now_s: The time in seconds, on any clock that never goes back.

        Returns:
            Whether a control step was made.

        Raises:
            OutputError: An episode cannot be written.
        """
        has_hands = self._handle()
        if self._is_held and self.device.is_squeezed_anew(now_s):
            self._is_held = False
        self._is_paused = self._state in _RUNNING and self.device.is_away(now_s)
        if self._is_paused or self._is_held:
            self.env.pause()
        waits_for_hands = self.lockstep and not has_hands
        if self._is_paused or self._is_held or self._question or waits_for_hands:
            return False
        if self._state is TeleopState.WAITING:
            prompt = self.device.prompt(now_s)
            if prompt is not None:
                self.note = prompt
                return False
            self._state, self.note = TeleopState.RECORDING, ""
            self.leading.start()
            self._note_attempt(UNDECIDED)  # a kill leaves this
        if self._state not in _RUNNING:
            return False
        intent = self._intent(now_s)
        if intent is None:
            if self._stand():
                return False
            intent = self.leading.rest()
        runs = self.pace.runs(
            intent,
            self._seen,
            ends=self._state is TeleopState.SUCCESS,
        )
        if not runs and self._stand():
            return False
        self._step(intent)
        return True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close(forget=kind is None)

    def close(self, *, forget: bool = True) -> None:
        """End the session.

        An episode that has begun is written as one that is not meant to be used, unless it is to
        be kept already; one that waits for the operator is forgotten.

        Args:
            forget: Whether what was discarded is removed; after an error, the next session can
                restore it.
        """
        if self._state in _UNBEGUN:
            self.env.discard()
        elif self._is_solved:
            self._accept()
        elif self._state is not TeleopState.OVER and not self._is_settled:
            self._note_attempt(UNDECIDED)
        self.leading.close()
        self.env.close()
        if self._episodes is not None:
            self._episodes.close(forget=forget)

    @property
    def state(self) -> TeleopState:
        """State of the episode; `DECIDE` too while the operator is asked about a restored one."""
        if self._question:
            return TeleopState.DECIDE
        if self._is_held:
            return TeleopState.HELD
        return TeleopState.PAUSED if self._is_paused else self._state

    @property
    def panel(self) -> Panel:
        """Steps of the session, and what may be pressed now."""
        state = self.state
        return Panel(
            steps=(LEAD, SOLVED),
            now=self._step_of(state, 0),
            title=TITLES[state],
            todo=self._said(),
            buttons=self._buttons(state),
            holding=HOLDING,
            can_hold=state in _LED,
        )

    def _step_of(
        self,
        state: TeleopState,
        lead: int,
    ) -> int:
        """Index of the step of a state, from that of leading."""
        if state is TeleopState.OVER:
            return lead + 2
        return lead + int(state in self.keeps and state is not TeleopState.RECORDING)

    def _buttons(self, state: TeleopState) -> tuple[Button, ...]:
        """Buttons that may be pressed in a state."""
        found: list[Button] = []
        if self._is_held:
            found.append(
                Button(
                    id="go_on",
                    words="Go on",
                    message=GoOn(),
                    is_next=True,
                )
            )
        if state in self.keeps:
            words = "Solved" if state is TeleopState.RECORDING else "Keep"
            is_next = state is TeleopState.DECIDE
            found.append(
                Button(
                    id="keep",
                    words=words,
                    message=Keep(),
                    key="k",
                    is_next=is_next,
                )
            )
        if state in _DISCARDED:
            found.append(
                Button(
                    id="discard",
                    words="Discard",
                    message=Discard(),
                    key="d",
                )
            )
        if self._episodes is not None and self._episodes.discarded:
            words = "Restore the last discarded"
            found.append(
                Button(
                    id="restore",
                    words=words,
                    message=Restore(),
                )
            )
        return tuple(found)

    @property
    def kept(self) -> int:
        """Number of kept episodes that are wanted, with those of earlier sessions."""
        return self._progress.kept

    @property
    def _question(self) -> str:
        """The question about a restored episode; empty while another one runs or is decided."""
        episodes = self._episodes
        is_open = self._state in _UNBEGUN or self._is_settled
        if episodes is None or not episodes.restored or not is_open:
            return ""
        return f"Keep {next(iter(episodes.restored.values()))}, or discard it again?"

    def status(self) -> dict[str, Any]:
        """Return the fields of the page's message `status`."""
        task, info = self.env.base.definition, self._info
        return {
            "title": task.title,
            "task": task.id,
            "instruction": info["instruction"],
            "wording": self._instruction,
            "operator": self.env.actor.name,
            "operators": sorted(filter(None, self._progress.operators)),
            "next": info["current_subinstruction"],
            "stage": info["stage"],
            "max_stage": info["max_stage"],
            "stages": [stage.name for stage in task.stages],
            "step": self._steps,
            "led_s": round(self.led_s, 1),
            "limit_s": self._limit_s,
            "pace": str(self.pace.phase),
            "alone": self.pace.is_alone,
            "steps": self.env.get_wrapper_attr("_max_episode_steps"),
            "state": str(self.state),
            "panel": self.panel.to_json(),
            "success": bool(info["success"]),
            "count": self.number,
            "kept": self.kept,
            "discarded": 0 if self._episodes is None else len(self._episodes.discarded),
            "wanted": self._progress.wanted,
            "lost": self.device.dropped,
            "clutch": dict(zip(map(str, SIDES), self.device.clutch, strict=True)),
            "limited": {
                str(side): self._limited[side.index] and self.device.clutch[side.index]
                for side in SIDES
            },
            "stage_changes": [list(change) for change in self._stage_changes],
            "policy": self.leading.status,
            "note": self._said(),
        }

    @property
    def led_s(self) -> float:
        """Seconds of the episode in which the world ran."""
        return self._steps / CONTROL_HZ

    @property
    def _limit_s(self) -> float:
        """Seconds that the episode may be led."""
        return self.env.get_wrapper_attr("_max_episode_steps") / CONTROL_HZ

    def _said(self) -> str:
        """Return the sentence for the operator."""
        if self._is_held:
            return HELD
        if self._is_paused:
            return AWAY
        if self._question:
            return self._question
        left_s = self._limit_s - self.led_s
        if self._state is TeleopState.RECORDING and left_s <= WARNED_S:
            ending = ENDING.format(np.ceil(left_s), self._limit_s)
            return f"{ending} {self.note}".strip()
        return self.note

    def _handle(self) -> bool:
        """Do what the messages say; in lockstep, those up to the first one of hands."""
        for message, arrival_s in self._inbox:
            if message is None:
                self.device.lose()
                continue
            self.device.take(message, arrival_s)
            if isinstance(message, Hands):
                self._press(message)
                if self.lockstep:
                    return True
            elif not self.leading.take(message):
                self._obey(message)
        return False

    def _obey(self, message: Message) -> None:
        """Do what a message says that has no hands in it."""
        match message:
            case Keep():
                self._keep()
            case Discard():
                self._discard()
            case Restore():
                self._restore()
            case Hold():
                self.device.let_go()
                self._is_held = self._is_held or self.state in _LED
            case GoOn():
                self._is_held = False
            case Alone():
                is_running = self._state in _RUNNING
                self.pace.is_alone = is_running and not self.pace.is_alone
            case Instruction() | Operator() | SelectItem():
                self._arrange(message)
            case _:
                pass

    def _press(self, hands: Hands) -> None:
        asked = {KEEP: self._keep, DISCARD: self._discard}
        for name in self._presses.new(hands):
            asked.get(name, self._restore)()

    def _intent(self, now_s: float) -> Intent | None:
        """The next action; None while a policy thinks, is paused, or has failed."""
        intent = None
        failure = ""
        try:
            intent = self.leading.next(now_s, self._seen)
        except PolicyError as error:
            failure = f"The policy failed, and is paused: {error}"
        self.note = failure or self.leading.note or self.note
        self.leading.note = ""
        return intent

    def _stand(self) -> bool:
        """Let the world stand still in this turn; whether it can."""
        return True

    def _is_at_rest(self, before: ProgressState) -> bool:
        """Whether arms and objects are at rest, and no clock of a stage counts since a state.

        Never on real arms: what the objects do is not known, so that it is recorded for a while.
        """
        if not hasattr(self.env.base, "simulation"):
            return False
        base = cast("SimEnv", self.env.base)
        speeds = np.abs(base.backend.joint_velocities())
        is_still = base.simulation.is_settled(STILL) and bool((speeds < ARM_REST).all())
        return is_still and not self._judge.counts_since(before)

    @property
    def _judge(self) -> Any:
        """Judge of the environment, which counts the stages."""
        return self.env.get_wrapper_attr("judge")

    def _step(self, intent: Intent) -> None:
        """Make a control step, and say what has come of it."""
        before = self._judge.get_state()
        self.env.clutch = intent.clutch
        self.env.device = self.device.led_by or None
        self._limited = intent.limited
        try:
            _, _, terminated, truncated, info = self.env.step(intent.action)
        except BackendError as error:
            self._end(str(error))
            return
        self._steps += 1
        if info["stage"] != self._info["stage"]:
            self._stage_changes.append([self._steps, int(info["stage"])])
        self._info, self._seen = info, self.env.base.backend.read()
        self.pace.note_step(is_at_rest=self._is_at_rest(before))
        self.haptics.update(intent)
        if terminated or truncated:
            self._end(self._why_over(info))
        elif self._state is TeleopState.SUCCESS and not info["success"]:
            # It was taken back, and with it the word that it is kept.
            self._state, self.note = TeleopState.RECORDING, ""
            self._is_kept = False
        elif info["success"] and self._state is TeleopState.RECORDING:
            self._state, self.note = TeleopState.SUCCESS, RETREAT

    def _why_over(self, info: Info) -> str:
        return "Solved." if info["success"] else "Time is up."

    def _end(self, note: str) -> None:
        self._state = TeleopState.DECIDE
        self.note = f"{note} Keep the episode or discard it."
        if self._is_kept:
            self._keep()

    def _keep(self) -> None:
        if self._question:
            self._keep_restored()
        elif self._state is TeleopState.SUCCESS:
            self._is_kept, self.note = True, "Solved; it will be kept."
        elif self._state is TeleopState.RECORDING:
            self.note = UNSOLVED
        elif self._state is TeleopState.DECIDE:
            self._accept()
            self._next()

    @property
    def _is_solved(self) -> bool:
        """Whether the episode is to be kept, and only goes on for a moment."""
        return self._is_kept and self._state in _RUNNING and bool(self._info["success"])

    def _accept(self) -> None:
        """Keep the episode, which ends here if it has not."""
        self.env.finish()
        self.env.keep()
        self._note_attempt(None)
        self.note = KEPT

    def _discard(self) -> None:
        if self._state is TeleopState.OVER:
            return
        if self._question and self._episodes is not None:
            self._episodes.discard_asked()
            self._go_on()
            return
        has_begun = self._state is not TeleopState.WAITING
        if has_begun and self._episodes is not None:
            self._episodes.set_aside()
        else:
            self.env.discard()
        self._note_attempt(DISCARDED if has_begun else SKIPPED)
        self.note = DISCARDED if has_begun else SKIPPED
        self._next()

    def _restore(self) -> None:
        """Ask again about what was discarded last: now, or once what runs is over and decided."""
        if self._episodes is None or self._state is TeleopState.OVER:
            return
        try:
            name = self._episodes.restore()
        except DuoBenchError as error:
            self.note = str(error)
            return
        if not self._question:
            self.note = ASKED_LATER.format(name)

    def _keep_restored(self) -> None:
        """Keep the restored episode that is asked about, and go on."""
        if self._episodes is None:
            return
        try:
            name = self._episodes.keep_asked()
            self._progress.refresh()
            said = f"Episode {name} is restored, and kept."
        except DuoBenchError as error:
            said = str(error)
        self._go_on()
        self.note = said if self._state is not TeleopState.OVER else self.note

    def _go_on(self) -> None:
        """Go on after an answer about a restored episode, unless another one is asked about."""
        if self._question:
            return
        if self._is_settled:
            self._next()
        elif self.chosen or not self._progress.wants(self._layout):
            self.env.discard()
            self._prepare()

    def _note_attempt(self, reason: str | None) -> None:
        """Note how the episode goes: why it is not kept, or None where it is."""
        if self._episodes is not None:
            self._episodes.note(self._attempt(reason))
        self._progress.note(self._layout, kept=reason is None)

    def _attempt(self, reason: str | None) -> Attempt:
        """The attempt at the layout as it stands."""
        success = bool(self._info["success"])
        actor = replace(self.env.actor, device=self.env.device or self.env.actor.device)
        return Attempt(
            task=self.env.task,
            episode=self.number,
            success=success,
            stage=int(self._info["stage"]),
            steps=self._stage_changes[-1][0] if success else self._steps,
            kept=reason is None,
            error=reason,
            layout=self._layout,
            actor=actor if self.leading.status is None else None,
        )

    def _arrange(self, message: Instruction | Operator | SelectItem) -> None:
        """Take a word of the operator about what comes next."""
        match message:
            case Instruction(text=text):
                self._instruct(text.strip())
            case Operator(name=name):
                self._change_operator(name.strip())
            case SelectItem(id=task):
                self._choose(task)

    def _instruct(self, text: str) -> None:
        self._instruction = text
        if self._state is TeleopState.WAITING:
            self.env.discard()
            self._reset()
        else:
            self.note = LATER

    def _change_operator(self, name: str) -> None:
        """Record a pseudonym from the next control step on."""
        if name == self.env.actor.name:
            return
        self.env.actor = replace(self.env.actor, name=name)
        if self._state in (TeleopState.WAITING, *_RUNNING):
            self.env.leader = self.env.actor

    def _choose(self, task: str) -> None:
        """Let the session end for another task, at once or after the episode that runs."""
        if task not in self._tasks:
            return
        self.chosen = "" if task == self.env.task else task
        if self.chosen and self._state is TeleopState.WAITING and not self._question:
            self.env.discard()
            self._end_session()
        elif self.chosen:
            self.note = NEXT_TASK

    def _next(self) -> None:
        """Begin the next episode, or end; restored ones are asked about before."""
        self._is_settled = True
        if self._question:
            self._state = TeleopState.DECIDE
            return
        self._is_settled = False
        self.number += 1
        self._prepare()

    def _prepare(self) -> None:
        """Prepare the next layout, unless there is none or another task was chosen."""
        layout = self._progress.next_layout()
        if layout is None or self.chosen:
            self._end_session()
            return
        self._layout, self._state = layout, TeleopState.PREPARING
        self.before_reset()
        self._reset()

    def _end_session(self) -> None:
        self._state = TeleopState.OVER
        self.note = NEXT_TASK if self.chosen else "All episodes are recorded."

    def _reset(self) -> None:
        env, task = self.env, self.env.task
        seed = episode_seed(task, self._layout, TRAIN)
        # Also if arms do not get home.
        self._state, self._is_kept = TeleopState.WAITING, False
        env.next_name = f"{self.number:05d}"
        self._info: Info = env.reset(seed=seed, options=self._reset_options(seed))[1]
        self._seen: DuoState = env.base.backend.read()
        self._steps = 0
        self._stage_changes: list[list[int]] = []
        self._limited = (False, False)
        self._is_paused, self._is_held, self.note = False, False, ""
        self.pace.begin()
        self.device.begin(env.base.backend.last_command)
        self.leading.begin(self._info)
        self.haptics.begin()

    def _reset_options(self, seed: int) -> dict[str, Any]:  # noqa: ARG002 - real arms need it
        return {SPLIT: TRAIN, INSTRUCTION: self._instruction or None}


class Haptics:
    """Pulses for the operator's hands, one for each time that something begins."""

    def __init__(self, env: Recorder) -> None:
        # Real arms are asked for no contacts: they have none to tell.
        self._sim = (
            cast(SimEnv, env.base).simulation
            if hasattr(env.base, "simulation")
            else None
        )
        self._pulses: list[tuple[Side, float, int]] = []
        self._before: dict[Side, dict[tuple[float, int], bool]] = {}

    def begin(self) -> None:
        """A new episode: nothing is felt yet."""
        self._before.clear()

    def update(self, intent: Intent) -> None:
        """A control step is over."""
        for side in SIDES:
            now = {
                TOUCH: self._touches(side),
                LIMIT: intent.limited[side.index],
                LOSS: not intent.clutch[side.index],
            }
            before = self._before.get(side, now)
            begun = [pulse for pulse in now if now[pulse] and not before[pulse]]
            self._pulses += [(side, *pulse) for pulse in begun]
            self._before[side] = now

    def take(self) -> list[tuple[Side, float, int]]:
        """The pulses since the last call: side, strength from 0 to 1, and length in ms."""
        pulses, self._pulses = self._pulses, []
        return pulses

    def _touches(self, side: Side) -> bool:
        if self._sim is None:
            return False
        contacts = self._sim.contacts
        others = (
            owner for owner in contacts.owners if not owner.startswith(f"{side}/")
        )
        return any(contacts.gripper(side, owner) for owner in others)


def horizon_of(time_limit_s: float) -> int:
    """Return the control steps of an episode that may be led for some seconds.

    Raises:
        OptionError: They are not finite, or less than one control step.
    """
    steps = time_limit_s * CONTROL_HZ
    if not (math.isfinite(steps) and round(steps) >= 1):
        raise OptionError(
            f"An episode takes at least one control step, got a limit of {time_limit_s} s."
        )
    return round(steps)


def make_recorder(
    task: str | Task,
    data: DataSet | str | Path | None,
    actor: Actor,
    *,
    action_mode: str = CARTESIAN.name,
    metadata: PolicyMetadata | None = None,
    time_limit_s: float = TIME_LIMIT_S,
    look: str | Look = DEFAULT,
    gripper: str = DEFAULT_GRIPPER,
) -> Recorder:
    """An environment on layouts of the split `train`, recorded with clutches and reviewed.

    Nothing is rendered, but for a policy when it is asked: images follow from the recorded states.

    Args:
        task: A task, its id, or its import path "module:ATTRIBUTE".
        data: Data set that episodes are added to, or its folder; None keeps each in memory.
        actor: Operator who leads, with the device.
        action_mode: That of the device, where no policy plays.
        metadata: Expectations of the policy that plays.
        time_limit_s: Seconds that an episode may be led before it is truncated; see `horizon_of`.
        look: How images of the episodes look, unless they are rendered with another one.
        gripper: Gripper on the arms; see `EnvConfig`.

    Raises:
        UnknownNameError: There is no such task, action mode or look.
        OptionError: A number of seconds is invalid.
        OtherRunError: The folder holds something else.
    """
    needed = {"cameras": False, "action_mode": action_mode}
    if metadata is not None:
        needed = needed_options(metadata)
    env = make_env(
        task,
        **needed,
        split=TRAIN,
        horizon=horizon_of(time_limit_s),
        look=look,
        gripper=gripper,
    )
    return Recorder(
        env,
        data,
        actor,
        after_success=AFTER_SUCCESS_S,
        is_reviewed=True,
        has_clutch=True,
    )
