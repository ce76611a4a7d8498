"""Programs of MuJoCo take the model and the data of an environment."""

import copy
import os

import mujoco
import mujoco_warp
import numpy as np
import pytest

from duobench.envs import sim_of
from duobench.tasks import catalog
from tests.children import ran
from tests.ecosystem.tools import STATES
from tests.envs.tools import make_small

VIEWER = f"""
import mujoco.viewer
import duobench

env = duobench.make("bin_sort", **{STATES!r})
env.reset(seed=0)
simulation = env.unwrapped.simulation
with mujoco.viewer.launch_passive(simulation.model, simulation.data) as viewer:
    viewer.sync()
    print(viewer.is_running())
"""


def test_the_viewer_shows_it_or_says_that_there_is_no_display() -> None:
    """`duobench view` needs no display."""
    done = ran("-c", VIEWER, env={**os.environ, "MUJOCO_GL": ""})
    if os.environ.get("DISPLAY"):
        assert (done.returncode, done.stdout) == (0, "True\n"), done.stderr
    else:
        assert done.returncode == 1
        assert "could not initialize GLFW" in done.stderr + done.stdout


@pytest.mark.parametrize("task", catalog.names())
def test_warp_takes_a_copy_that_resets_by_itself(task: str) -> None:
    env = make_small(task)
    env.reset(seed=0)
    simulation = sim_of(env).simulation
    with pytest.raises(NotImplementedError, match="mjDSBL_AUTORESET is unsupported"):
        mujoco_warp.put_model(simulation.model)
    model = copy.copy(simulation.model)
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    there = mujoco_warp.put_model(model)
    data = mujoco_warp.put_data(model, simulation.data)
    mujoco_warp.kinematics(there, data)
    np.testing.assert_allclose(data.xpos.numpy()[0], simulation.data.xpos, atol=1e-6)
