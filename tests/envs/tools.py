"""What the tests of environments share: actions, whole episodes, and ways to compare them."""

import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray

import duobench
from duobench.core.types import DuoCommand
from duobench.envs.batch_env import BatchEnv
from duobench.envs.sim_env import sim_of
from duobench.world.robot.mounts import HOME_JOINTS

__all__ = [
    "TASK",
    "Make",
    "arrays",
    "check",
    "equal",
    "make_small",
    "sim_of",
    "vectors",
    "wave",
    "waves",
]

TASK = "bin_sort"

# Two remarks are the checker's opinion of what was asked for: it would rather look at a bare
# environment than at a stack of wrappers, and it recommends actions between -1 and 1, while ours
# are joint angles in radians. Nothing else may be remarked.
REMARKS = (
    r"[\s\S]*is different from the unwrapped version",
    r"[\s\S]*we recommend using a symmetric and normalized space",
)


def wave(number: int) -> NDArray[np.float32]:
    """Joint action: both arms swing about home, the grippers close and open."""
    joints = HOME_JOINTS + 0.2 * math.sin(0.2 * number)
    openings = np.full(2, 0.5 + 0.5 * math.cos(0.3 * number))
    return DuoCommand(joints=joints, openings=openings).flat.astype(np.float32)


def waves(count: int) -> NDArray[np.float32]:
    return np.array([wave(number) for number in range(count)])


Make = Callable[..., Any]


def make_small(task: Any = TASK, **options: Any) -> Any:
    """An environment without cameras unless it is told which, for any process."""
    return duobench.make(task, **{"cameras": False, **options})


def vectors(**usual: Any) -> Iterator[Callable[..., BatchEnv]]:
    """For a fixture: makes vector environments without processes, and closes them at the end."""
    made: list[BatchEnv] = []

    def make(task: Any = TASK, count: int = 2, **options: Any) -> BatchEnv:
        vector = duobench.make_vec(task, count, **{**usual, **options})
        assert isinstance(vector, BatchEnv)
        made.append(vector)
        return vector

    yield make
    for vector in made:
        vector.close()


def equal(one: Any, other: Any) -> bool:
    """Whether two nested structures of arrays and plain values are the same, bit for bit."""
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(equal(one[key], other[key]) for key in one)
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(equal, one, other))
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    return bool(one == other)


def check(env: gym.Env) -> None:
    """Run Gymnasium's checker with warnings as errors, then close the environment."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for remark in REMARKS:
            warnings.filterwarnings("ignore", message=remark)
        check_env(env)
    env.close()


def arrays(engine: mujoco.MjModel | mujoco.MjData) -> dict[str, bytes]:
    """Everything that a model or its data holds."""
    found = {name: getattr(engine, name) for name in dir(engine) if not name.startswith("_")}
    return {name: a.tobytes() for name, a in found.items() if isinstance(a, np.ndarray)}
