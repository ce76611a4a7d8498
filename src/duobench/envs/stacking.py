"""The wrappers between judged arms and a policy, the same for simulated and real arms.

From the inside out: the horizon, the action mode, binary grippers, action chunks, object states,
cameras. Nothing here loads the simulation before it is asked for.
"""

from __future__ import annotations

from duobench.envs import action_modes
from duobench.envs.config import EnvConfig
from duobench.envs.wrappers.action_chunks import ActionChunks
from duobench.envs.wrappers.base import DuoWrapper
from duobench.envs.wrappers.binary_gripper import BinaryGripper
from duobench.envs.wrappers.cameras import Cameras
from duobench.envs.wrappers.object_states import ObjectStates
from duobench.envs.wrappers.task_stages import TaskStages
from duobench.envs.wrappers.time_limit import TimeLimit
from duobench.references import load


def stack_on(judged: TaskStages, config: EnvConfig, horizon: int | None) -> DuoWrapper:
    """Put the wrappers of a configuration around judged arms.

    Args:
        judged: The arms, with stages.
        config: What was chosen about the environment.
        horizon: Control steps after which an episode is cut off; None leaves it open.

    Raises:
        TypeError: Object states are asked for, and there is no simulation.
    """
    stack: DuoWrapper = judged
    if horizon is not None:
        stack = TimeLimit(stack, horizon)
    for path in action_modes.get(config.action_mode).wrappers:
        stack = load(path, "wrapper", callable)(stack)
    if config.binary_gripper:
        stack = BinaryGripper(stack)
    if config.chunk is not None:
        stack = ActionChunks(stack, config.chunk)
    if config.object_state:
        stack = ObjectStates(stack)
    if config.cameras:
        stack = Cameras(stack, config.cameras, config.image_size)
    return stack
