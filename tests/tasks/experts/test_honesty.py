"""Experts act through the sixteen numbers of the action space, and in no other way; nothing that
they send is clipped.

They may read the simulator, and they run in the process that owns it. So whatever the engine holds,
model and data, is compared before and after every call of an expert, bit for bit.
"""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from duobench.core.types import CONTROL_HZ, SIDES, Array
from duobench.envs.duo_env import ROUNDING
from duobench.evaluation import ExpertPolicy
from duobench.tasks import catalog
from duobench.tasks.experts.expert import Expert, find_script
from duobench.tasks.experts.motion import Arms, Script
from duobench.tasks.experts.variety import HUMAN, NONE, Variety
from duobench.world.robot.joints import VELOCITY_LIMITS
from duobench.world.sim.simulation import STATE, Simulation
from tests.envs.tools import arrays, sim_of
from tests.task_harness import marked
from tests.tasks.experts.baseline_episodes import make

SEED, OTHER_SEED = 4, 5
LATE = 60
"""Control step at which something is tampered with: long after the reset."""


def model_bytes(model: mujoco.MjModel) -> bytes:
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def watched(
    sim: Simulation, model: bytes, call: Callable[..., Any], *given: object
) -> tuple[Any, list[str]]:
    """What a call returns, and the names of what it changes in the engine, of such a model."""
    state, before = sim.get_state(), arrays(sim.data)
    result = call(*given)
    after = arrays(sim.data)
    changed = [name for name, value in before.items() if after[name] != value]
    if not np.array_equal(sim.get_state(), state):
        changed.append("state")
    if model_bytes(sim.model) != model:
        changed.append("model")
    return result, changed


def changed_in_episode(env: gym.Env, expert: Expert) -> list[str]:
    """Names of what an expert changes in the engine, up to its success or to the first change.

    Until then it stays within what the real robot obeys.
    """
    sim = sim_of(env).simulation
    fastest = np.tile(np.array(VELOCITY_LIMITS) / CONTROL_HZ, (len(SIDES), 1)) + ROUNDING
    observation, info = env.reset(seed=SEED)
    model = model_bytes(sim.model)
    _, changed = watched(sim, model, expert.reset, info["instruction"], SEED)
    over = False
    while not changed and not over:
        before = sim.duo.command().joints
        chunk, changed = watched(sim, model, expert.act, observation)
        observation, _, terminated, truncated, info = env.step(chunk[0].astype(np.float32))
        if not changed:
            assert not info["clipped"].any()
            assert (np.abs(sim.duo.command().joints - before) <= fastest).all()
        over = terminated or truncated
    assert changed or info["success"]
    return changed


def test_the_state_covers_every_input_of_the_next_step() -> None:
    parts = ("TIME", "QPOS", "QVEL", "ACT", "WARMSTART", "CTRL", "QFRC_APPLIED", "XFRC_APPLIED")
    for part in (*parts, "EQ_ACTIVE", "MOCAP_POS", "MOCAP_QUAT", "USERDATA"):
        flag = int(getattr(mujoco.mjtState, f"mjSTATE_{part}"))
        assert STATE & flag == flag, part


# Human-like experts are sometimes faster than plain ones, and disturbed.
@pytest.mark.parametrize(
    ("name", "variety"),
    [
        *(marked(name, HUMAN, name=f"{name}-human") for name in catalog.names()),
        *(marked(name, NONE, name=f"{name}-none") for name in ("block_balance", "bin_sort")),
    ],
)
def test_an_expert_only_reads_the_simulation_and_keeps_to_the_limits(
    name: str, variety: Variety
) -> None:
    env = make(name)
    simulation = sim_of(env).simulation
    assert changed_in_episode(env, ExpertPolicy(env, variety)) == []
    if not any(prop.choice for prop in simulation.props.values()):
        model = model_bytes(simulation.model)
        env.reset(seed=OTHER_SEED)
        assert model_bytes(simulation.model) == model
    env.close()


@pytest.mark.parametrize(
    ("numbers", "change", "noticed"),
    [
        (lambda sim: sim.data.joint("cube").qpos[2:3], 1e-9, {"state", "qpos"}),
        (lambda sim: sim.data.joint("chest/lid").qvel, 0.1, {"state", "qvel"}),
        (lambda sim: sim.data.body("cube").xfrc_applied[:1], 0.1, {"state", "xfrc_applied"}),
        (lambda sim: sim.data.joint("chest/lid").qfrc_applied, 0.1, {"state", "qfrc_applied"}),
        (lambda sim: sim.data.ctrl[:1], 0.001, {"state", "ctrl"}),
        (lambda sim: sim.data.eq_active[:1], -1.0, {"state", "eq_active"}),
        (lambda sim: sim.data.mocap_pos[:1, :1], 0.001, {"state", "mocap_pos"}),
        (lambda sim: sim.position("cube")[2:], 0.05, {"xpos"}),
        (lambda sim: sim.data.joint("chest/lid").qfrc_bias, 0.1, {"qfrc_bias"}),
        (lambda sim: sim.model.geom("cube:0").friction[:1], 0.01, {"model"}),
        (lambda sim: sim.model.body("cube").mass, -0.001, {"model"}),
        (lambda sim: sim.model.opt.gravity[2:], 0.01, {"model"}),
    ],
)
def test_tampering_late_in_an_episode_is_noticed(
    numbers: Callable[[Simulation], Array], change: float, noticed: set[str]
) -> None:
    env = make("hinge_chest")

    def script(arms: Arms) -> Script:
        honest = find_script("hinge_chest")(arms)
        for _ in range(LATE):
            next(honest)
            yield
        tampered = numbers(arms.sim)
        tampered[...] = tampered.astype(float) + change
        yield from honest

    cheat = Expert(sim_of(env).simulation, script)
    assert set(changed_in_episode(env, cheat)) == noticed
    env.close()
