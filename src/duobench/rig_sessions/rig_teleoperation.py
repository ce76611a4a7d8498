"""Teleoperation on a rig: the session and the page of the simulation, on real arms.

Who leads says that the task is solved, by keeping the episode while it runs. The page shows the
arms where they are measured, and the objects where the layout asks for them, as a picture made by
the simulation with open grippers; what is really on the table the images of the rig's cameras show,
see `cameras.CameraFeed`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np

from duobench.data import Actor, DataSet, Recorder
from duobench.data.rig import placement
from duobench.data.schema import AFTER_SUCCESS_S
from duobench.envs.action_modes import CARTESIAN
from duobench.envs.config import LAYOUT
from duobench.envs.duo_env import TRUNCATION_REASON, Info
from duobench.errors import DuoBenchError
from duobench.hardware.duo import FrankaDuo
from duobench.hardware.env import RealEnv, make_real_env
from duobench.randomness import TRAIN
from duobench.rig_sessions.operator import QUIT, Operator, ask_to_make_ready
from duobench.rig_sessions.policy_runner import make_rig_recorder
from duobench.rig_sessions.teleop_page import TeleopPage
from duobench.rig_sessions.teleoperation import TIME_LIMIT_S, Teleoperation, TeleopState
from duobench.sim.layout import Layout
from duobench.sim.simulation import Simulation
from duobench.tasks.task import Task
from duobench.types import CONTROL_HZ, DuoCommand
from duobench.web.geometry import Geometry
from duobench.web.server import PageServer

SOLVED = "Solved, as you said: open the hands and retreat. It will be kept."
CONNECTION_LOST = "The operator's page lost its connection."
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
    operator: Operator,
    *,
    action_mode: str = CARTESIAN.name,
    after_success: float = AFTER_SUCCESS_S,
) -> Recorder:
    """An environment on a rig, recorded with clutches, videos and review.

    The rig belongs to the environment from now on. The operator confirms that the arms may move: a
    reset raises an `EndedError` where they end the session instead. For the rest see
    `teleoperation.make_recorder`.
    """

    def confirm_homing(options: Mapping[str, Any]) -> None:
        given = options.get(LAYOUT)
        question = CLEAR.format(placement(given if isinstance(given, Layout) else Layout(poses={})))
        is_safe = ask_to_make_ready(duo, operator)
        if not is_safe or operator.ask(question, f"h{QUIT}") == QUIT:
            raise EndedError("The operator ended the session.")
        duo.supervisor.confirm()

    env = make_real_env(
        duo,
        task,
        prepare=confirm_homing,
        cameras=(),
        action_mode=action_mode,
        horizon=round(TIME_LIMIT_S * CONTROL_HZ),
    )
    return make_rig_recorder(env, duo, data, actor, after_success=after_success, has_clutch=True)


class RigTeleoperation(Teleoperation):
    """A session on a rig, in which the operator says that the task is solved."""

    def _reset_options(self, seed: int) -> dict[str, Any]:
        layout = next(self.env.base.definition.layouts(seed, TRAIN))
        return {**super()._reset_options(seed), LAYOUT: layout}

    def _reset(self) -> None:
        super()._reset()
        real = cast("RealEnv", self.env.base)
        real.rig.place(real.definition, real.layout)

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

    def __init__(self, session: Teleoperation, server: PageServer) -> None:
        self._real = cast("RealEnv", session.env.base)
        task = self._real.definition
        self._picture = Simulation(task.props, task.overview)
        super().__init__(session, server)

    def _leave(self) -> None:
        self._real.rig.hold(CONNECTION_LOST)
        super()._leave()

    def _new_geometry(self) -> Geometry:
        layout = self._real.layout
        if layout.poses:
            self._picture.apply(layout)
        return Geometry(self._picture.model)

    def _data(self) -> mujoco.MjData:
        # Linkages of grippers can be shown open only.
        joints = self._real.backend.read().joints
        self._picture.duo.set_configuration(DuoCommand(joints=joints, openings=np.ones(2)))
        self._picture.forward()
        return self._picture.data
