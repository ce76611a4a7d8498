from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from duobench.core.errors import LeaderError, UnknownNameError
from duobench.teleop.leaders.gello import (
    COUNTS_A_TURN,
    GelloArm,
    GelloConfig,
    GelloSource,
    joints_of,
)
from duobench.world.robot.joints import JOINT_RANGES
from duobench.world.robot.mounts import HOME_JOINTS
from tests.teleop.leaders.servos import Servos
from tests.web.pages import wait_until

COUNT = 2 * math.pi / COUNTS_A_TURN
OFFSETS = (1.0, -2.0, 3.0, 0.5, -0.5, 6.5, 0.0)
SIGNS = (1, -1, 1, 1, -1, 1, -1)
IDS = (*range(1, 8), 8)
Pair = tuple[Servos, Servos]


def arm(port: str) -> GelloArm:
    return GelloArm(port=port, offsets=OFFSETS, signs=SIGNS, gripper_open=3.4, gripper_closed=2.6)


def shown(joints: np.ndarray, opening: float) -> dict[int, int]:
    """What servos show at joint positions (7,) and an opening, in counts by their ids."""
    angles = [*(joints / SIGNS + OFFSETS), 2.6 + opening * 0.8]
    return dict(zip(IDS, (round(angle / COUNT) for angle in angles), strict=True))


@pytest.fixture
def turns() -> Iterator[None]:
    """Let threads take turns often: the library waits for answers without a pause, and the servos,
    which would be devices of their own, answer in time only if they are let."""
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-4)
    yield
    sys.setswitchinterval(usual)


@pytest.fixture
def servos(turns: None) -> Iterator[Pair]:  # noqa: ARG001
    left, right = (Servos(shown(row, opening=1.0)) for row in HOME_JOINTS)
    yield left, right
    left.close()
    right.close()


@pytest.fixture
def source(servos: Pair) -> Iterator[GelloSource]:
    made = GelloSource(GelloConfig(left=arm(servos[0].port), right=arm(servos[1].port)))
    yield made
    made.close()


def newest(source: GelloSource, condition: Callable[[np.ndarray], bool] = np.any) -> np.ndarray:
    """The first sample that meets a condition."""
    samples: list[np.ndarray] = []

    def is_there() -> bool:
        sample = source.read()
        if sample is not None and condition(sample):
            samples.append(sample)
        return bool(samples)

    wait_until(is_there)
    return samples[0]


def test_servos_become_joints_and_openings(source: GelloSource, servos: Pair) -> None:
    assert source.read() is None
    source.connect()
    rows = newest(source).reshape(2, 8)
    np.testing.assert_allclose(rows[:, :7], HOME_JOINTS, atol=COUNT)
    np.testing.assert_allclose(rows[:, 7], 1.0, atol=2 * COUNT)
    turned = np.append(np.array(HOME_JOINTS[1]) + 0.2, 0.25)
    servos[1].counts |= shown(turned[:7], opening=turned[7])
    # The servos answer one after another: the first sample may hold some from before.
    newest(source, lambda now: np.allclose(now[8:], turned, atol=2 * COUNT))


def test_a_count_that_looks_like_a_header_is_read(source: GelloSource, servos: Pair) -> None:
    servos[0].counts[1] = int.from_bytes(b"\xff\xff\xfd\x00", "little")
    source.connect()
    sample = newest(source)
    expected = joints_of(arm("x"), list(servos[0].counts.values()))
    np.testing.assert_allclose(sample[:8], expected)


def test_arms_that_fall_silent_are_lost_and_come_back(source: GelloSource, servos: Pair) -> None:
    source.connect()
    wait_until(lambda: source.read() is not None)
    servos[1].is_silent = True
    wait_until(lambda: source.read() is None)
    servos[1].is_silent = False
    wait_until(lambda: source.read() is not None)


def test_a_servo_that_is_missing_is_named(source: GelloSource, servos: Pair) -> None:
    del servos[1].counts[5]
    with pytest.raises(LeaderError, match=f"Servo 5 at {servos[1].port} does not answer"):
        source.connect()
    assert source.read() is None
    with pytest.raises(LeaderError, match="Cannot open /dev/nothing"):
        GelloSource(GelloConfig(left=arm("/dev/nothing"), right=arm("/dev/no"))).connect()


def test_whole_turns_of_a_servo_do_not_matter() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        joints = rng.uniform(*np.transpose(JOINT_RANGES))
        counts = list(shown(joints, opening=0.5).values())
        turned = [count + COUNTS_A_TURN * int(rng.integers(-2, 3)) for count in counts[:7]]
        unsigned = [number % 2**32 for number in (*turned, counts[7])]
        np.testing.assert_allclose(joints_of(arm("x"), unsigned)[:7], joints, atol=COUNT)


FILE = """
[left]
port = "/dev/a"
offsets = [0.0, 1.5, 0, 0, 0, 0, 0]
signs = [1, -1, 1, 1, 1, 1, 1]
gripper_open = 3.4
gripper_closed = 2.6

[right]
port = "/dev/b"
offsets = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
signs = [1, 1, 1, 1, 1, 1, 1]
ids = [11, 12, 13, 14, 15, 16, 17]
gripper_id = 18
gripper_open = 1.0
gripper_closed = 2.0
"""


def test_a_file_says_what_the_arms_are(tmp_path: Path) -> None:
    path = tmp_path / "gello.toml"
    path.write_text(FILE)
    config = GelloConfig.read(path)
    assert (config.baud, config.left.ids, config.right.gripper_id) == (57_600, IDS[:7], 18)
    assert config.left.offsets[1] == 1.5
    for bad, error, words in (
        (FILE.replace("gripper_open", "gripper_opem", 1), UnknownNameError, "gripper_open"),
        (FILE.replace("[1, -1", "[1, -2"), LeaderError, "signs are 1 or -1"),
        (FILE.replace("[0.0, 1.5,", "[1.5,"), LeaderError, "offsets are 7 numbers"),
        (FILE.replace("/dev/b", "/dev/a"), LeaderError, "port of its own"),
        (FILE.replace("3.4", '"wide"'), LeaderError, "gripper_open"),
        (FILE.replace("[right]", "[rihgt]"), UnknownNameError, "right"),
        ("left = [", LeaderError, "Cannot read"),
    ):
        path.write_text(bad)
        with pytest.raises(error, match=words):
            GelloConfig.read(path)


def test_servos_have_ids_of_their_own() -> None:
    with pytest.raises(LeaderError, match="different ids"):
        replace(arm("x"), gripper_id=3)
