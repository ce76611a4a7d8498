"""Teleoperation on a rig: the session and the page of the simulation, on real arms.

Who leads says that the task is solved, by keeping the episode while it runs. The page shows the
arms where they are measured, and the objects where the layout asks for them, as a picture made by
the simulation with open grippers; what is really on the table the images of the rig's cameras show,
see `cameras.CameraFeed`.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np

from duobench.core.errors import BackendError, DuoBenchError, MessageError
from duobench.core.randomness import TRAIN, episode_seed
from duobench.core.types import DuoCommand
from duobench.data import Actor, DataSet, Recorder
from duobench.data.rig import placement
from duobench.data.schema import AFTER_SUCCESS_S
from duobench.envs.action_modes import CARTESIAN
from duobench.envs.config import LAYOUT
from duobench.envs.duo_env import TRUNCATION_REASON, Info
from duobench.policy import PolicyMetadata
from duobench.real.duo import FrankaDuo
from duobench.real.env import RealEnv, make_real_env
from duobench.real.sessions import messages
from duobench.real.sessions.operator import QUIT, Operator, hold_by_key
from duobench.real.sessions.policy_runner import make_rig_recorder
from duobench.real.sessions.preparing import (
    HOME_BUTTON,
    PLACED,
    PLACED_BUTTON,
    STEPS,
    TO_HOME,
    TO_PLACE,
    clear,
    find_hindrance,
)
from duobench.real.sessions.session import (
    CONNECTION_LOST,
    HELD_BY_OPERATOR,
    STOPPED,
    TAKEN_OVER,
)
from duobench.real.sessions.status_page import SILENCE_S
from duobench.results.run import needed_options
from duobench.tasks.task import Task
from duobench.teleop.intent import TeleopDevice
from duobench.teleop.messages import (
    Discard,
    Hands,
    Hold,
    Keep,
    Message,
)
from duobench.teleop.panel import (
    LEAD,
    SOLVED as SOLVED_STEP,
    Button,
    Panel,
)
from duobench.teleop.plumb import PlumbLines
from duobench.teleop.teleop_page import LEADING_VIEW, TeleopPage
from duobench.teleop.teleoperation import (
    TIME_LIMIT_S,
    TITLES,
    Teleoperation,
    TeleopState,
    horizon_of,
)
from duobench.web.geometry import Geometry
from duobench.web.messages import PageMessage
from duobench.web.server import PageServer
from duobench.world.sim.simulation import Simulation

SOLVED = "Solved, as you said: open the hands and retreat. It will be kept; undo takes it back."
ENDED = "The operator ended the session."
MOVING = "The arms move: stay away from them. Space holds them."
PLACES = "Objects:"
ENDS = f"{QUIT}: end"
HOME_AGAIN = "Send the arms home again."
NOT_NOW = "Not now: the session is in the state {!r}."

_CLEARING = (messages.Activate, messages.Open, messages.Recover)
_PREPARING = (*_CLEARING, messages.Home, messages.Placed)
_JUDGED = (
    TeleopState.RECORDING,
    TeleopState.SUCCESS,
    TeleopState.PAUSED,
    TeleopState.DECIDE,
)
"""States in which stages are declared."""


def make_real_recorder(
    duo: FrankaDuo,
    task: str | Task,
    data: DataSet | str | Path,
    actor: Actor,
    *,
    action_mode: str = CARTESIAN.name,
    metadata: PolicyMetadata | None = None,
    time_limit_s: float = TIME_LIMIT_S,
    after_success: float = AFTER_SUCCESS_S,
) -> Recorder:
    """An environment on a rig, recorded with clutches, videos and review.

    The rig belongs to the environment from now on. For the rest see `teleoperation.make_recorder`.
    """
    needed = {"cameras": (), "action_mode": action_mode}
    if metadata is not None:
        needed = needed_options(metadata)
    env = make_real_env(
        duo,
        task,
        **needed,
        horizon=horizon_of(time_limit_s),
    )
    return make_rig_recorder(
        env, duo, data, actor, after_success=after_success, has_clutch=True
    )


class RigTeleoperation(Teleoperation):
    """A session on a rig, in which the operator says which stages are reached.

    Before each episode the arms are made ready step by step: at the page or the terminal, wherever
    a button is pressed first. A hold that comes before the episode begins costs none: the arms go
    home again.
    """

    keeps = (TeleopState.RECORDING, *Teleoperation.keeps)

    def __init__(
        self, env: Recorder, device: TeleopDevice, operator: Operator, **options: Any
    ) -> None:
        self._operator, self._real = operator, cast("RealEnv", env.base)
        self._is_home = self._is_moving = self._has_ended = False
        self._is_stopped = False
        self._told = ""
        self.on_moving: Callable[[], object] = lambda: None
        """Called before arms or fingers move at the operator's word."""
        self.is_led_by_page = False
        """Whether the latest word that moves something came from the page."""
        super().__init__(env, device, **options)
        operator.listen(self._press_key)

    # --- from any thread -------------------------------------------------------------------------

    def receive(
        self,
        message: PageMessage,
        now_s: float,
    ) -> None:
        """Take a message; a hold and the word that a stage is reached act at once.

        Raises:
            DuoBenchError: The message is not for this state.
        """
        rig = self._real.rig
        match message:
            case Hold():
                rig.hold(HELD_BY_OPERATOR)
                self._inbox.forget(*_PREPARING)
            case messages.Stage() | messages.Undo():
                self._check_state(*_JUDGED)
                stage = message.stage if isinstance(message, messages.Stage) else None
                self._judge.declare(stage)
            case messages.Home() | messages.Placed():
                self._check_state(TeleopState.MAKING_READY)
                # From now on, so that a hold that is pressed later takes it back.
                with suppress(BackendError):  # it is said once it is tried
                    rig.supervisor.confirm()
            case messages.Activate() | messages.Open() | messages.Recover():
                self._check_state(TeleopState.MAKING_READY)
            case _:
                pass
        super().receive(cast("Message", message), now_s)

    def stop(self) -> None:
        """Hold the arms, and go home no more; from any thread and for signal handlers."""
        self._is_stopped = True
        self._real.rig.hold(STOPPED)

    @property
    def is_moving(self) -> bool:
        """Whether arms or fingers move at the operator's word, before an episode."""
        return self._is_moving

    def _check_state(self, *states: TeleopState) -> None:
        """Reject a message that is for other states."""
        if self.state not in states or self._is_moving:
            raise MessageError(NOT_NOW.format(str(self.state)))

    def _press_key(self, key: str) -> None:
        """Take a key of the terminal."""
        if hold_by_key(self._real.rig, key):
            self._inbox.forget(*_PREPARING)
            self._has_ended = self._has_ended or not key
            return
        button = self.panel.pressable.get(key)
        with suppress(DuoBenchError):  # such a key says nothing now
            if key == QUIT and self.state is TeleopState.MAKING_READY:
                self._has_ended = True
            elif button is not None:
                self.is_led_by_page = False
                self.receive(button.message, time.monotonic())
            elif key == "u":
                self.receive(messages.Undo(), time.monotonic())
            elif key in "123456789":
                self.receive(messages.Stage(stage=int(key)), time.monotonic())

    # --- what is shown ---------------------------------------------------------------------------

    @property
    def panel(self) -> Panel:
        """Steps of the session, and what may be pressed now."""
        state, lead = self.state, len(STEPS)
        steps = (*STEPS, LEAD, SOLVED_STEP)
        if state is not TeleopState.MAKING_READY:
            return Panel(
                steps=steps,
                now=self._step_of(state, lead),
                title=TITLES[state],
                todo=self._said(),
                buttons=self._buttons(state),
                can_hold=state not in {TeleopState.DECIDE, TeleopState.OVER},
            )
        now, todo, buttons = self._preparation()
        return Panel(
            steps=steps,
            now=now,
            title=steps[now] if not self._is_moving else "The arms move",
            todo=MOVING if self._is_moving else f"{self._said()} {todo}".strip(),
            buttons=() if self._is_moving else buttons,
            can_hold=True,
        )

    def _preparation(self) -> tuple[int, str, tuple[Button, ...]]:
        """Index of the step before an episode, what is to be done, and its buttons."""
        hindrance = find_hindrance(self._real.rig)
        if hindrance is not None:
            home = replace(HOME_BUTTON, why_not=hindrance.why_not)
            return 0, hindrance.todo, (*hindrance.buttons, home)
        if not self._is_home:
            return 1, TO_HOME, (replace(HOME_BUTTON, is_next=True),)
        return 2, TO_PLACE, (replace(PLACED_BUTTON, is_next=True), HOME_BUTTON)

    def _buttons(self, state: TeleopState) -> tuple[Button, ...]:
        """Buttons of a state; solved has a key of its own, since it is said while it runs."""
        found = super()._buttons(state)
        if state is not TeleopState.RECORDING:
            return found
        return tuple(
            replace(each, key="s") if each.id == "keep" else each for each in found
        )

    def status(self) -> dict[str, Any]:
        """Return the fields of the page's message `status`, with what was pressed."""
        labels = self._judge.labels
        more = {"stage": labels.stage, "presses": labels.all, "says_stages": True}
        return {**super().status(), **more, "note": self.panel.todo}

    def _tell(self) -> None:
        """Say at the terminal what has changed."""
        panel = self.panel
        text = panel.text
        if self.state is TeleopState.MAKING_READY and not self._is_moving:
            text += f"; {ENDS}"
        elif self.state is TeleopState.RECORDING:
            text += f"; 1 to {self._judge.max_stage}: this stage is reached; u: undo; space: hold"
        if text == self._told:
            return
        self._told = text
        if panel.now == STEPS.index(PLACED):
            text = f"{placement(self.layout)}\n{text}"
        self._operator.say(text)

    # --- from the session's own thread -----------------------------------------------------------

    def advance(self, now_s: float) -> bool:
        """Advance as in simulation; arms that were held before an episode begins go home again."""
        held = None if self._is_stopped else self._real.rig.held
        if held is not None and self._is_at_home:
            self.env.discard()
            self._reset()
            self.note = f"{held} {HOME_AGAIN}"
        elif held is not None and self._is_solved:
            self._accept()
            self._next()
        if self._has_ended and self._state is TeleopState.MAKING_READY:
            self.env.discard()
            self._state, self.note = TeleopState.OVER, ENDED
        self._tell()
        has_stepped = super().advance(now_s)
        if self._state is TeleopState.RECORDING:
            self._tell()
        return has_stepped

    @property
    def _is_at_home(self) -> bool:
        """Whether the arms wait at home for an episode to begin."""
        is_placing = self._state is TeleopState.MAKING_READY and self._is_home
        return is_placing or self._state is TeleopState.WAITING

    def _obey(self, message: PageMessage) -> None:
        """Do what a message says that has no hands in it, also those of a rig."""
        match message:
            case Hold():  # the arms were held at once
                self.device.let_go()
            case messages.Stage() | messages.Undo():
                self._follow_judge()
            case _ if isinstance(message, _PREPARING):
                self._make_ready(message)
            case _:
                super()._obey(cast("Message", message))

    def _follow_judge(self) -> None:
        """Take over what the operator said about the stages."""
        stage = self._judge.labels.stage
        is_solved = stage == self._judge.max_stage
        self._is_kept = self._is_kept and is_solved
        if self._state is TeleopState.DECIDE:
            self._info = {**self._info, "stage": stage, "success": is_solved}

    def _make_ready(self, message: PageMessage) -> None:
        """Do a step of making ready; the note says what hinders it."""
        if self._state is not TeleopState.MAKING_READY:
            return
        rig = self._real.rig
        self.note, self._is_moving = "", True
        self.on_moving()
        try:
            match message:
                case messages.Home(with_object=with_object):
                    self._go_home(with_object)
                case messages.Placed():
                    self._place()
                case _:
                    clear(rig, message)
        except BackendError as error:
            rig.supervisor.revoke()
            self.note = str(error)
        finally:
            self._is_moving = False
        # Pressed while something moved, they were for what was before.
        self._inbox.forget(
            Keep, Discard, *_PREPARING, *(() if self.lockstep else (Hands,))
        )

    def _go_home(self, with_object: bool) -> None:
        """Send the arms home, with the layout of the episode."""
        self._is_home = False
        try:
            if with_object:
                self._real.rig.home(with_object=True)
            super()._reset()
        finally:
            self._state = TeleopState.MAKING_READY
        self._real.rig.supervisor.revoke()  # people's hands are among the objects now
        self._is_home = True

    def _place(self) -> None:
        """Begin with the objects in their places."""
        rig = self._real.rig
        rig.supervisor.check_confirmed()
        if not self._is_home:
            raise BackendError(HOME_AGAIN)
        rig.hands.check_active()
        rig.place(self._real.definition, self.layout)
        self._state = TeleopState.WAITING

    def _reset(self) -> None:
        """Begin with the next layout: the arms are made ready for it first."""
        task = self._real.definition
        seed = episode_seed(self.env.task, self._layout, TRAIN)
        self.layout = next(task.layouts(seed, TRAIN))
        """Layout of the episode, by which objects are placed."""
        self._state, self._is_kept = TeleopState.MAKING_READY, False
        self._is_home = self._is_paused = self._is_held = False
        self._info = {
            "instruction": self._instruction or task.instruct(self.layout),
            "current_subinstruction": None,
            "stage": 0,
            "max_stage": task.max_stage,
            "success": False,
        }
        self._steps, self._stage_changes, self.note = 0, [], ""
        self._limited = (False, False)
        self.pace.begin()
        self._judge.begin()

    def _reset_options(self, seed: int) -> dict[str, Any]:
        """Options of the reset, with the layout by which objects are placed."""
        return {**super()._reset_options(seed), LAYOUT: self.layout}

    def _instruct(self, text: str) -> None:
        """Take an instruction, for this episode as long as the arms are not at home."""
        if self._state is TeleopState.MAKING_READY and not self._is_home:
            self._instruction = text
            self._reset()
        else:
            super()._instruct(text)

    def _discard(self) -> None:
        """Discard the episode, if there is one yet."""
        if self.state is not TeleopState.MAKING_READY:  # there is nothing yet
            super()._discard()

    def _stand(self) -> bool:
        """Keep both arms where they are, under control and unrecorded.

        Not where they are held, or where a person has just said that a stage is reached: that
        counts from the next control step on.
        """
        if self._judge.labels.stage != self._judge.stage:
            return False
        self.env.pause()
        rig = self._real.rig
        rig.command(rig.last_command)
        self._seen = rig.read()
        return rig.held is None

    def _keep(self) -> None:
        if self.state is TeleopState.RECORDING:
            self._judge.declare(self._judge.max_stage)
            self._is_kept, self.note = True, SOLVED
        else:
            super()._keep()

    def _end(self, note: str) -> None:
        """End the episode, and what is said about its stages."""
        self._judge.end()
        super()._end(note)

    def _accept(self) -> None:
        """Keep the episode, with its stages as the operator has corrected them."""
        self.env.finish()
        labels = self._judge.labels
        # What was taken back, or pressed after the end, counts in all rows.
        if labels.all:
            self.env.correct(labels.changes(), holds=True)
        super()._accept()

    def _why_over(self, info: Info) -> str:
        return info.get(TRUNCATION_REASON) or super()._why_over(info)


class RigTeleopPage(TeleopPage):
    """Shows a session of a rig on a page, as the simulation would look with the arms like that.

    A lost page holds both arms; so does one that said that they may move, and then gives no sign.
    """

    kinds = (
        Message
        | messages.Activate
        | messages.Open
        | messages.Recover
        | messages.Home
        | messages.Placed
        | messages.Stage
        | messages.Undo
    )

    def __init__(
        self,
        session: RigTeleoperation,
        server: PageServer,
        silence_s: float = SILENCE_S,
    ) -> None:
        self._rig_session, self._silence = session, silence_s
        self._real = cast("RealEnv", session.env.base)
        self._heard = time.monotonic()
        task = self._real.definition
        self._picture = Simulation(task.props, task.overview, self._real.rig.robot)
        super().__init__(session, server)
        session.on_moving = self.show
        self._real.rig.watch_person(self._look)

    def stop(self) -> None:
        """Let `run` return, with the arms held, also where they go home."""
        super().stop()
        self._rig_session.stop()

    def _take(self, message: PageMessage) -> None:
        """Take a message of the driver, which is a sign of the page too."""
        if not isinstance(message, Hold):  # perhaps of one who watches
            self._heard = time.monotonic()
        if isinstance(message, _PREPARING):
            self._rig_session.is_led_by_page = True
        super()._take(cast("Message", message))

    def _leave(self, gives_way: bool) -> None:
        self._real.rig.hold(TAKEN_OVER if gives_way else CONNECTION_LOST)
        super()._leave(gives_way)

    def _look(self) -> None:
        """Hold the arms if the page that lets them move gives no sign."""
        session, silent = self._rig_session, time.monotonic() - self._heard
        if session.is_moving and session.is_led_by_page and silent > self._silence:
            self._real.rig.hold(f"The operator's page gave no sign for {silent:.1f} s.")

    def _new_geometry(self) -> Geometry:
        layout = self._rig_session.layout
        if layout.poses:
            self._picture.apply(layout)
        return Geometry(self._picture.model, view=LEADING_VIEW)

    def _new_lines(self) -> PlumbLines:
        """Lines to the table: where objects really are is not known."""
        return PlumbLines(self._picture, has_objects=False)

    def _data(self) -> mujoco.MjData:
        # Linkages of grippers can be shown open only.
        joints = self._real.backend.read().joints
        self._picture.duo.set_configuration(
            DuoCommand(joints=joints, openings=np.ones(2))
        )
        self._picture.forward()
        return self._picture.data
