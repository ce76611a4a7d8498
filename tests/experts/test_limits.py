"""Experts stay within what the real robot obeys: nothing that they send is clipped."""

from __future__ import annotations

import numpy as np
import pytest

from duobench.envs.duo_env import ROUNDING
from duobench.experts.expert import make_expert
from duobench.experts.variety import HUMAN
from duobench.scene.fr3 import VELOCITY_LIMITS
from duobench.tasks import catalog
from duobench.types import CONTROL_HZ, SIDES
from tests.envs.tools import sim_of
from tests.experts.baseline_episodes import make


# Sometimes faster than without variety, and disturbed.
@pytest.mark.parametrize("name", catalog.names())
def test_an_expert_commands_no_joint_faster_than_it_moves(name: str) -> None:
    env = make(name)
    simulation = sim_of(env).simulation
    expert = make_expert(name, simulation, variety=HUMAN)
    observation, info = env.reset(seed=2)
    expert.reset(info["instruction"], 2)
    limits = np.tile(np.array(VELOCITY_LIMITS) / CONTROL_HZ, (len(SIDES), 1))
    before, over = simulation.duo.command().joints, False
    while not over:
        observation, _, terminated, truncated, info = env.step(expert.act(observation)[0])
        assert not info["clipped"].any()
        joints = simulation.duo.command().joints
        assert (np.abs(joints - before) <= limits + ROUNDING).all()
        before, over = joints, terminated or truncated
    env.close()
