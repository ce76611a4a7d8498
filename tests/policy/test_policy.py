from contextlib import nullcontext
from typing import Any

import gymnasium as gym
import msgspec
import numpy as np
import pytest

import duobench
from duobench.core.errors import PolicyError
from duobench.envs import ACTION_MODES
from duobench.envs.config import EnvConfig
from duobench.envs.sim_env import SimEnv
from duobench.policy import PolicyMetadata, as_chunk, check_fits
from duobench.results.run import needed_options
from duobench.tasks import catalog
from duobench.world.robot.cameras import POLICY_CAMERAS, Camera

SIDE: dict[str, Any] = {"name": "side", "position": (0.5, 1.2, 0.5), "look_at": (0.5, 0.0, 0.0)}


def test_chunk_is_a_copy_as_float32() -> None:
    chunk = as_chunk([[0] * 16, [1] * 16])
    assert (chunk.shape, chunk.dtype) == ((2, 16), np.float32)
    actions = np.zeros((1, 16), np.float32)
    chunk = as_chunk(actions)
    actions[:] = 1
    assert not chunk.any()


@pytest.mark.parametrize("shape", [(16,), (0, 16), (1, 15), (1, 1, 16), ()])
def test_wrong_shape_is_refused_with_the_right_one(shape: tuple[int, ...]) -> None:
    with pytest.raises(PolicyError, match=r"\(H, 16\).*actions\[None, :\]"):
        as_chunk(np.zeros(shape))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_number_that_is_not_finite_is_refused_with_its_place(bad: float) -> None:
    actions = np.zeros((3, 16))
    actions[2, 5] = bad
    with pytest.raises(PolicyError, match="action 2 of its chunk, number 5"):
        as_chunk(actions)


@pytest.mark.parametrize(
    "nonsense",
    [
        "left",
        None,
        [[0] * 16, [0] * 3],
        {"a": 1},
        [[10**309]],
        np.zeros((1, 16), dtype=complex),
        [["1"] * 16],
        np.zeros((1, 16), dtype="timedelta64[s]"),
        np.ma.masked_equal(np.zeros((1, 16)), 0.0),
    ],
    ids=str,
)
def test_what_is_no_array_is_refused(nonsense: object) -> None:
    with pytest.raises(PolicyError):
        as_chunk(nonsense)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("name", ["name", "version", "dtype", "device"])
def test_text_that_cannot_be_written_down_is_refused_as_given(name: str) -> None:
    message = rf"The {name} of a policy is printable text, got 'w\\udcff'"
    with pytest.raises(PolicyError, match=message):
        PolicyMetadata(**{"name": "mine", name: "w\udcff"})


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("image_size", [(0, 224), (224,), 0, True, "32", (224.5, 224)]),
        ("version", [3, "v" * 1001]),
        ("name", [3]),
        ("action_mode", [None]),
        (
            "cameras",
            [None, (1,), {"head": "big"}, {"head", "left_wrist"}, [{"position": (0, 0, 1)}]],
        ),
        ("cameras", [{**SIDE, "on": "ceiling"}, [{**SIDE, "look_at": (0.5, 1.2, 0.5)}]]),
        ("depth", [None, 3, {"head"}, Camera(**SIDE)]),
        ("segmentation", [None, (1,)]),
        ("image_sizes", [None, {"head": 0}, {"head": "32"}]),
        ("horizon", [1.5, "3", 0]),
    ],
)
def test_metadata_that_no_environment_meets_is_refused(field: str, values: list[Any]) -> None:
    for value in values:
        with pytest.raises(PolicyError):
            PolicyMetadata(**{"name": "mine", field: value})


@pytest.mark.parametrize(
    ("fields", "same"),
    [
        ({"cameras": "head"}, {"cameras": ("head",)}),
        ({"image_size": np.array([48, 64])}, {"image_size": (48, 64)}),
        ({"image_size": 32}, {"image_size": (32, 32)}),
        ({"image_size": np.int64(32)}, {"image_size": (32, 32)}),
        ({"horizon": np.int64(3)}, {"horizon": 3}),
        ({"object_state": np.True_}, {"object_state": True}),
        ({"batch_invariant": np.False_}, {"batch_invariant": False}),
        ({"cameras": [SIDE]}, {"cameras": (Camera(**SIDE),)}),
        ({"cameras": SIDE}, {"cameras": (Camera(**SIDE),)}),
        ({"cameras": Camera(**SIDE), "depth": True}, {"cameras": SIDE, "depth": ("side",)}),
        ({"depth": True}, {"depth": POLICY_CAMERAS}),
        (
            {"cameras": (), "segmentation": np.True_},
            {"cameras": (), "segmentation": POLICY_CAMERAS},
        ),
        ({"depth": "head", "segmentation": False}, {"depth": ("head",), "segmentation": ()}),
        (
            {"cameras": {"head": 32, "left_wrist": (24, 48)}},
            {
                "cameras": ("head", "left_wrist"),
                "image_sizes": {"head": (32, 32), "left_wrist": (24, 48)},
            },
        ),
    ],
)
def test_metadata_of_numpy_and_one_for_all_can_be_written_down(
    fields: dict[str, Any], same: dict[str, Any]
) -> None:
    given = PolicyMetadata(**{"name": "mine", **fields})
    assert given == PolicyMetadata(**{"name": "mine", **same})
    assert msgspec.json.decode(msgspec.json.encode(given), type=PolicyMetadata) == given


def test_a_policy_of_depth_and_a_camera_of_its_own_fits_what_shows_them() -> None:
    wanted = {"cameras": ("head", SIDE), "depth": ("side",), "segmentation": "head"}
    sees = metadata(**wanted, image_sizes={"head": 32})
    options = needed_options(sees)
    check_fits(sees, duobench.make(TASK, **options))
    moved = {**SIDE, "fovy_deg": 40.0}
    other = duobench.make(TASK, cameras=("head", moved), depth="head", image_size=48)
    with pytest.raises(PolicyError) as raised:
        check_fits(sees, other)
    for words in (
        "it sees camera 'side', the environment shows head, side, elsewhere or with another lens",
        "it sees depth of camera 'side', the environment shows depth of head",
        "it sees segmentation of camera 'head', the environment shows segmentation of none",
        "it sees images of (32, 32), the environment's are (48, 48) (head)",
        "depth=('side',), segmentation=('head',), image_sizes={'head': (32, 32)}",
    ):
        assert words in str(raised.value)


@pytest.mark.parametrize(
    ("sees", "shown", "fits"),
    [
        ({"cameras": "head"}, {"cameras": {"head": 64, "left_wrist": 32}}, True),
        ({"cameras": "head"}, {"cameras": {"head": 32}, "image_size": 64}, False),
        ({"depth": "head"}, {"cameras": False, "depth": "head", "image_size": 64}, True),
        ({"depth": "head"}, {"cameras": False, "depth": "head", "image_size": 32}, False),
        ({"cameras": {**SIDE, "size": 32}}, {"cameras": {**SIDE, "size": 32}}, True),
    ],
    ids=str,
)
def test_sizes_are_compared_of_each_camera_that_a_policy_sees(
    sees: dict[str, Any], shown: dict[str, Any], *, fits: bool
) -> None:
    env = duobench.make(TASK, **shown)
    with nullcontext() if fits else pytest.raises(PolicyError, match=r"of .64, 64.*32.*head"):
        check_fits(metadata(**sees, image_size=64), env)


def test_a_first_policy_sees_what_an_environment_shows_by_default() -> None:
    assert PolicyMetadata(name="mine").cameras == EnvConfig().cameras == POLICY_CAMERAS


TASK = "bin_sort"


def metadata(**fields: Any) -> PolicyMetadata:
    return PolicyMetadata(**{"name": "mine", "cameras": ()} | fields)


@pytest.mark.parametrize("mode", ACTION_MODES)
def test_action_modes_are_told_apart(mode: str) -> None:
    env = gym.Wrapper(duobench.make(TASK, cameras=False, action_mode=mode, binary_gripper=True))
    check_fits(metadata(action_mode=mode), env)
    for other in {*ACTION_MODES} - {mode}:
        with pytest.raises(PolicyError, match=f"'{other}', the environment's '{mode}'"):
            check_fits(metadata(action_mode=other), env)


def test_images_must_be_there_and_of_the_size() -> None:
    env = duobench.make(TASK, cameras=("head", "left_wrist"), image_size=(48, 64))
    check_fits(metadata(cameras=("head",)), env)
    check_fits(metadata(cameras=("left_wrist", "head"), image_size=(48, 64)), env)
    with pytest.raises(PolicyError, match="'right_wrist', the environment shows head, left_wrist"):
        check_fits(metadata(cameras=("right_wrist",)), env)
    with pytest.raises(PolicyError, match=r"of \(64, 48\), the environment's are \(48, 64\)"):
        check_fits(metadata(cameras=("head",), image_size=(64, 48)), env)


def test_every_problem_is_listed_with_an_environment_that_fits() -> None:
    wanted = {"cameras": ("head",), "image_size": (48, 64), "object_state": True}
    wanted |= {"action_mode": "cartesian"}
    other = duobench.make(TASK, cameras=False, chunk=4)
    with pytest.raises(PolicyError) as refused:
        check_fits(metadata(**wanted), other)
    assert str(refused.value) == (
        "Policy 'mine' does not fit the environment: it sees camera 'head', the environment shows "
        "none; it reads the state of the objects, which the environment does not show; its "
        "actions are 'cartesian', the environment's 'joint'; it gives chunks of any length, the "
        "environment takes chunks of one length. One that fits: duobench.make(task,"
        " cameras=('head',), image_size=(48, 64), object_state=True, action_mode='cartesian')."
    )
    env = duobench.make(TASK, **wanted)  # as the advice says
    check_fits(metadata(**wanted), env)
    check_fits(metadata(**wanted | {"object_state": False}), env)


@pytest.mark.parametrize("env", [SimEnv(catalog.get(TASK)), gym.make("CartPole-v1")])
def test_environment_without_a_configuration_is_refused(env: gym.Env) -> None:
    with pytest.raises(PolicyError, match=r"no configuration.*duobench\.make"):
        check_fits(metadata(), env)
