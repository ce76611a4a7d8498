"""Teleoperation on a rig: the session and the page of the simulation, on real arms.

Who leads says that the task is solved, by keeping the episode while it runs. The page shows the
arms where they are measured, and the objects where the layout asks for them, as a picture made by
the simulation with open grippers; what is really on the table the images of the rig's cameras show,
see `cameras.CameraFeed`.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np

from duobench.core.errors import BackendError, DuoBenchError
from duobench.core.randomness import TRAIN
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
from duobench.real.sessions.operator import QUIT, Operator, ask_to_make_ready
from duobench.real.sessions.policy_runner import make_rig_recorder
from duobench.real.sessions.session import CONNECTION_LOST, STOPPED, TAKEN_OVER
from duobench.results.run import needed_options
from duobench.tasks.stages.progress import ProgressState
from duobench.tasks.task import Task
from duobench.teleop.intent import TeleopDevice
from duobench.teleop.messages import Discard, Hands, Keep
from duobench.teleop.plumb import PlumbLines
from duobench.teleop.teleop_page import TeleopPage
from duobench.teleop.teleoperation import (
    TIME_LIMIT_S,
    Teleoperation,
    TeleopState,
    horizon_of,
)
from duobench.web.geometry import Geometry
from duobench.web.server import PageServer
from duobench.world.sim.layout import Layout
from duobench.world.sim.simulation import Simulation

SOLVED = "Solved, as you said: open the hands and retreat. It will be kept."
ENDED = "The operator ended the session."
AT_TERMINAL = "The terminal asks whether the arms may go home."
CLEAR = (
    "The arms go home slowly, and open their grippers. Clear their space, then place the objects "
    "once they are there:\n{}\nh: go home; q: end."
)


class EndedError(DuoBenchError):
    """The operator ended the session."""


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
    """A session on a rig, in which the operator says that the task is solved.

    The operator beside the arms confirms each time that they may go home: a session raises an
    `EndedError` where they end it instead. What keeps the arms from getting there is said, and
    asked again.
    """

    keeps = (TeleopState.RECORDING, *Teleoperation.keeps)

    def __init__(
        self, env: Recorder, device: TeleopDevice, operator: Operator, **options: Any
    ) -> None:
        self._operator, self._is_stopped = operator, False
        self.on_homing: Callable[[], object] = lambda: None
        """Called before the operator is asked whether the arms may go home."""
        self._real = cast("RealEnv", env.base)
        self._real.prepare = self._confirm_homing
        super().__init__(env, device, **options)

    def stop(self) -> None:
        """Hold the arms, and go home no more; from any thread and for signal handlers."""
        self._is_stopped = True
        self._real.rig.hold(STOPPED)

    def advance(self, now_s: float) -> bool:
        """Advance as in simulation; arms that were held before an episode begins go home again."""
        held = None if self._is_stopped else self._real.rig.held
        if held is not None and self._state is TeleopState.WAITING:
            self._operator.say(held)
            self.env.discard()
            self._reset()
        elif held is not None and self._is_solved:
            self._accept()
            self._next()
        return super().advance(now_s)

    def _reset_options(self, seed: int) -> dict[str, Any]:
        layout = next(self.env.base.definition.layouts(seed, TRAIN))
        return {**super()._reset_options(seed), LAYOUT: layout}

    def _reset(self) -> None:
        real = self._real
        while True:
            try:
                super()._reset()
                real.rig.place(real.definition, real.layout)
            except BackendError as error:
                self._operator.say(str(error))
            else:
                break
        # Pressed while the arms went home, they were for the episode before.
        self._inbox.forget(Keep, Discard, *(() if self.lockstep else (Hands,)))

    def _confirm_homing(self, options: Mapping[str, Any]) -> None:
        rig, given = self._real.rig, options.get(LAYOUT)
        self.note = f"{rig.held or ''} {AT_TERMINAL}".strip()
        self.on_homing()
        question = CLEAR.format(
            placement(given if isinstance(given, Layout) else Layout(poses={}))
        )
        is_over = self._is_stopped or not ask_to_make_ready(rig, self._operator)
        is_over = is_over or self._operator.ask(question, f"h{QUIT}") == QUIT
        if is_over or self._is_stopped:  # perhaps while it was asked
            raise EndedError(ENDED)
        rig.supervisor.confirm()

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

    def _is_at_rest(self, before: ProgressState) -> bool:  # noqa: ARG002
        """Never: what the objects do is not known, so that the recording goes on for a while."""
        return False

    def _keep(self) -> None:
        if self.state is TeleopState.RECORDING:
            judge = self.env.get_wrapper_attr("judge")
            judge.declare(self.env.base.definition.max_stage)
            self._is_kept, self.note = True, SOLVED
        else:
            super()._keep()

    def _why_over(self, info: Info) -> str:
        return info.get(TRUNCATION_REASON) or super()._why_over(info)


class RigTeleopPage(TeleopPage):
    """Shows a session of a rig on a page, as the simulation would look with the arms like that.

    A lost page holds both arms.
    """

    def __init__(self, session: RigTeleoperation, server: PageServer) -> None:
        self._rig_session = session
        self._real = cast("RealEnv", session.env.base)
        task = self._real.definition
        self._picture = Simulation(task.props, task.overview)
        super().__init__(session, server)
        session.on_homing = self.show

    def stop(self) -> None:
        """Let `run` return, with the arms held, also where they go home."""
        super().stop()
        self._rig_session.stop()

    def _leave(self, gives_way: bool) -> None:
        self._real.rig.hold(TAKEN_OVER if gives_way else CONNECTION_LOST)
        super()._leave(gives_way)

    def _new_geometry(self) -> Geometry:
        layout = self._real.layout
        if layout.poses:
            self._picture.apply(layout)
        return Geometry(self._picture.model)

    def _new_lines(self) -> PlumbLines:
        return PlumbLines(self._picture, has_objects=False)

    def _data(self) -> mujoco.MjData:
        # Linkages of grippers can be shown open only.
        joints = self._real.backend.read().joints
        self._picture.duo.set_configuration(
            DuoCommand(joints=joints, openings=np.ones(2))
        )
        self._picture.forward()
        return self._picture.data
