"""The wrappers that make a base environment a benchmark task; each works on its own."""

from duobench.envs.wrappers.action_chunks import ActionChunks
from duobench.envs.wrappers.binary_gripper import BinaryGripper
from duobench.envs.wrappers.cameras import Cameras
from duobench.envs.wrappers.cartesian import CartesianActions
from duobench.envs.wrappers.randomized_reset import RandomizedReset
from duobench.envs.wrappers.relative import RelativeCartesianActions, RelativeJointActions
from duobench.envs.wrappers.task_stages import TaskStages
from duobench.envs.wrappers.time_limit import TimeLimit

__all__ = [
    "ActionChunks",
    "BinaryGripper",
    "Cameras",
    "CartesianActions",
    "RandomizedReset",
    "RelativeCartesianActions",
    "RelativeJointActions",
    "TaskStages",
    "TimeLimit",
]
