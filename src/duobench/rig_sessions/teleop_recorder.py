"""The environment of a session: a task that is recorded while an operator leads it."""

from __future__ import annotations

from pathlib import Path

from duobench.data import Actor, DataSet, Recorder
from duobench.data.schema import AFTER_SUCCESS_S
from duobench.envs.action_modes import CARTESIAN
from duobench.envs.protocol import make_env
from duobench.errors import OptionError
from duobench.looks.catalog import DEFAULT
from duobench.looks.look import Look
from duobench.randomness import TRAIN
from duobench.tasks.task import Task
from duobench.types import CONTROL_HZ

TIME_LIMIT_S = 180.0
"""Simulated seconds that an episode may take: with a mouse, a person needs several times as long
as an expert, and as the horizon of an evaluation."""


def make_recorder(
    task: str | Task,
    data: DataSet | str | Path | None,
    actor: Actor,
    *,
    action_mode: str = CARTESIAN.name,
    time_limit_s: float = TIME_LIMIT_S,
    after_success: float = AFTER_SUCCESS_S,
    look: str | Look = DEFAULT,
) -> Recorder:
    """An environment on layouts of the split `train`, recorded with clutches and reviewed.

    Nothing is rendered: images follow from the recorded states.

    Args:
        task: A task, its id, or its import path "module:ATTRIBUTE".
        data: Data set that episodes are added to, or its folder; None keeps each in memory.
        actor: Who leads, and with which device.
        action_mode: That of the device.
        time_limit_s: Simulated seconds after which an episode is truncated.
        after_success: Seconds that a recording goes on after success.
        look: How images of the episodes look, unless they are rendered with another one.

    Raises:
        UnknownNameError: There is no such task, action mode or look.
        OptionError: A number of seconds is none.
        OtherRunError: The folder holds something else.
    """
    horizon = round(time_limit_s * CONTROL_HZ)
    if horizon < 1:
        raise OptionError(f"An episode takes at least one control step, got {time_limit_s} s.")
    env = make_env(
        task, cameras=False, split=TRAIN, action_mode=action_mode, horizon=horizon, look=look
    )
    return Recorder(
        env, data, actor, after_success=after_success, is_reviewed=True, has_clutch=True
    )
