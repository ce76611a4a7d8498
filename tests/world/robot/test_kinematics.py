"""Forward kinematics from link frames and of the inverse, against MuJoCo's."""

import mujoco
import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.core.types import SIDES
from duobench.world.kinematics.inverse import Kinematics
from duobench.world.robot.frames import ROBOT
from duobench.world.robot.joints import JOINT_RANGES
from duobench.world.robot.mounts import HOME_JOINTS
from duobench.world.scene.compose import compose
from duobench.world.sim.duo import Duo


@pytest.fixture(scope="module")
def engine() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = compose(()).compile()
    return model, mujoco.MjData(model)


def test_tool_poses_are_those_of_the_engine(engine: tuple[mujoco.MjModel, mujoco.MjData]) -> None:
    duo, rng, kinematics = Duo(*engine, ROBOT), np.random.default_rng(0), Kinematics(ROBOT)
    low, high = JOINT_RANGES.T
    for joints in (HOME_JOINTS, *rng.uniform(low, high, size=(200, 2, len(low)))):
        engine[1].qpos[duo.joints] = joints
        mujoco.mj_kinematics(*engine)
        found = duo.read().tcp_poses
        np.testing.assert_allclose(ROBOT.tcp_poses(joints), found, rtol=0, atol=1e-9)
        for pose, row in zip(kinematics.forward(joints).values(), found, strict=True):
            assert max(pose.distance(SE3.from_tquat(row))) < 1e-6


def test_the_tool_turns_with_the_last_joint_alone_and_stays_in_place() -> None:
    for side in SIDES:
        before = ROBOT.tool_pose(side, HOME_JOINTS[side.index])
        after = ROBOT.tool_pose(side, HOME_JOINTS[side.index] + [0, 0, 0, 0, 0, 0, 0.3])
        turned = before @ SE3.about((0, 0, 1), 0.3)
        np.testing.assert_allclose(after.rotation, turned.rotation, rtol=0, atol=1e-12)
        np.testing.assert_allclose(after.translation, before.translation, rtol=0, atol=1e-12)
