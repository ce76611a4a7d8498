"""Options: what they make of an environment, and what is refused."""

import ast
import inspect
import json
import re
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, fields, replace
from functools import reduce
from typing import Any

import gymnasium as gym
import msgspec
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import FlattenObservation

import duobench
from duobench import Camera
from duobench.core.errors import (
    DuoBenchError,
    LayoutError,
    OptionError,
    RenderingError,
    UnknownNameError,
)
from duobench.envs import (
    ActionChunks,
    Cameras,
    DuoEnv,
    RandomizedReset,
    RelativeCartesianActions,
    SimEnv,
    TaskStages,
    TimeLimit,
)
from duobench.envs.config import EnvConfig
from duobench.envs.protocol import make_env
from duobench.envs.registration import EnvOptions
from duobench.tasks import Task, catalog
from duobench.world.looks.catalog import look
from tests.envs.number_arms import NumberArms
from tests.envs.tools import TASK, sim_of

SIDE = Camera(name="side", position=(0.5, 1.2, 0.6), look_at=(0.5, 0.0, 0.0))


def test_the_evaluation_protocol() -> None:
    env = gym.make(f"duobench/{TASK}-v1")
    base = f"SimEnv<duobench/{TASK}-v1>"
    assert str(env) == f"<Cameras<TimeLimit<TaskStages<RandomizedReset<{base}>>>>>"
    assert env.action_space.shape == (16,)
    assert set(env.observation_space) == {"agent_pos", "tcp_pose", "pixels"}  # type: ignore[call-overload]
    assert env.get_wrapper_attr("config") == EnvConfig() == EnvConfig.from_options({})


def test_everything_at_once_keeps_its_place() -> None:
    mode = {"action_mode": "cartesian_relative", "binary_gripper": True, "chunk": 30}
    env = make_env(TASK, cameras="head", object_state=True, **mode)
    assert str(env) == (
        "<Cameras<ObjectStates<ActionChunks<BinaryGripper<RelativeCartesianActions<"
        "CartesianActions<TimeLimit<TaskStages<RandomizedReset<SimEnv instance" + ">" * 10
    )
    assert env.action_space.shape == (30, 14)


@pytest.mark.parametrize(
    ("options", "shape"),
    [
        ({}, (224, 224, 3)),
        ({"image_size": 64}, (64, 64, 3)),
        ({"image_size": (48, 64)}, (48, 64, 3)),
        ({"image_size": [720, 1280]}, (720, 1280, 3)),
        ({"image_size": np.int64(64)}, (64, 64, 3)),
        ({"image_size": tuple(np.array([48, 64]))}, (48, 64, 3)),
        *(({"cameras": none}, None) for none in (False, (), [])),
    ],
)
def test_image_sizes_and_none_without_cameras(
    options: dict[str, Any], shape: tuple[int, ...] | None
) -> None:
    space: Any = make_env(TASK, **{"cameras": ("left_wrist",), **options}).observation_space
    assert ("pixels" in space.spaces) == (shape is not None)
    assert shape is None or space["pixels"]["left_wrist"].shape == shape


@pytest.mark.parametrize("task", [TASK, catalog.get(TASK)], ids=["id", "task"])
def test_cameras_may_be_any_iterable(task: str | Task) -> None:
    names = {"head": 0, "left_wrist": 1}
    for cameras in ((name for name in names), names.keys()):
        env = duobench.make(task, cameras=cameras, depth=iter(names))
        for made in (env, gym.make(env.spec)):
            assert made.get_wrapper_attr("config").cameras == ("head", "left_wrist")
            assert made.get_wrapper_attr("config").depth == ("head", "left_wrist")


def test_cameras_and_fields_of_one_may_be_numpys_and_are_kept_as_pythons() -> None:
    side = {"name": "side", "position": np.array([0.5, 1.2, 0.6]), "look_at": [0.5, 0, 0]}
    config = EnvConfig.from_options({"cameras": side | {"fovy_deg": np.float32(50), "size": 64}})
    placed = {"position": (0.5, 1.2, 0.6), "look_at": (0.5, 0, 0)}
    assert config.cameras == (Camera(name="side", fovy_deg=50, size=(64, 64), **placed),)
    config = EnvConfig.from_options({"cameras": np.array(["head"]), "depth": np.str_("head")})
    assert msgspec.json.encode([config.cameras, config.depth]) == b'[["head"],["head"]]'


def test_cameras_of_ones_own_are_kept_by_specs() -> None:
    env = duobench.make(TASK, cameras=("head", SIDE), depth="side")
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.observation_space == env.observation_space
    assert again.get_wrapper_attr("config") == sim_of(env).config
    assert sim_of(env).config.cameras == ("head", SIDE)


def test_what_images_there_are_follows_from_the_options() -> None:
    def wanted(**options: Any) -> Any:
        return EnvConfig.from_options({"image_size": 32, **options}).wanted

    three = dict.fromkeys(("head", "left_wrist", "right_wrist"), (32, 32))
    assert wanted() == {"rgb": three}
    assert wanted(depth=True, segmentation=np.True_) == dict.fromkeys(
        ("rgb", "depth", "segmentation"), three
    )
    head = {"head": (32, 32)}
    assert wanted(cameras="head", depth=True) == {"rgb": head, "depth": head}
    assert wanted(cameras=False, depth="head") == {"depth": {"head": (32, 32)}}
    assert wanted(cameras=False, segmentation=True) == {"segmentation": three}
    assert wanted(cameras=False) == wanted(cameras=(), depth=False, segmentation=()) == {}
    given = {"head": (12, 16), "left_wrist": 64, "right_wrist": None}
    sizes = {"head": (12, 16), "left_wrist": (64, 64), "right_wrist": (32, 32)}
    assert wanted(cameras=given, depth=("left_wrist", "head")) == {
        "rgb": sizes,
        "depth": {"left_wrist": (64, 64), "head": (12, 16)},
    }
    assert wanted(cameras=given, image_sizes={"right_wrist": 8})["rgb"]["right_wrist"] == (8, 8)
    own, small = SIDE, replace(SIDE, name="small", size=(20, 30))
    assert wanted(cameras=("head", own, small), depth="small") == {
        "rgb": {"head": (32, 32), own: (32, 32), small: (20, 30)},
        "depth": {small: (20, 30)},
    }
    assert wanted(cameras={own: 9, small: None}) == {
        "rgb": {replace(own, size=(9, 9)): (9, 9), small: (20, 30)}
    }


# Those whose words are promised are in tests/promised_errors.py.
@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"camera": "head"}, UnknownNameError, "argument 'camera'.*Did you mean 'cameras'"),
        ({"sead": 3}, UnknownNameError, "argument 'sead'.*Known: action_mode, binary_gripper,"),
        ({"seed": 3}, UnknownNameError, r"argument 'seed'.*env\.reset\(seed=0\)"),
        ({"num_envs": 4}, UnknownNameError, r'duobench\.make_vec\("bin_sort", num_envs=4\)'),
        ({"n_envs": 4}, UnknownNameError, r'duobench\.make_vec\("bin_sort", num_envs=4\)'),
        ({"headless": True}, UnknownNameError, "rendered offscreen"),
        ({"max_steps": 9}, UnknownNameError, "horizon=300"),
        ({"cameras": "overview"}, UnknownNameError, "Known: head, left_wrist, right_wrist"),
        ({"cameras": None}, OptionError, "cameras is True, False.*None"),
        ({"cameras": 3}, OptionError, "cameras is True, False.*3"),
        ({"cameras": {"head"}}, OptionError, "cameras is True, False, a camera, a list of them"),
        ({"cameras": b"head"}, OptionError, "sizes by name, such as {'head': .128, 128.}"),
        ({"cameras": {"hed": 64}}, UnknownNameError, "camera 'hed'.*Did you mean 'head'"),
        ({"cameras": {"head": 721}}, OptionError, "size of camera 'head'.*720.*721"),
        ({"cameras": {"head": (64,)}}, OptionError, "size of camera 'head'"),
        *(
            ({"cameras": {"head": 64}, "image_sizes": sizes}, OptionError, "image_sizes is sizes")
            for sizes in (5, None)
        ),
        ({"cameras": {SIDE: 0}}, OptionError, "size of camera 'side'"),
        ({"cameras": {"name": "side"}}, OptionError, "position, look_at is missing"),
        ({"cameras": (SIDE, SIDE)}, OptionError, "Two cameras are called 'side'.*'side_2'"),
        ({"cameras": (SIDE, "sid")}, UnknownNameError, "camera 'sid'.*Did you mean 'side'"),
        ({"cameras": [{"name": "a"}]}, OptionError, "camera.*position"),
        ({"cameras": [{**asdict(SIDE), "fovy": 3}]}, UnknownNameError, "'fovy'.*'fovy_deg'"),
        ({"cameras": [{**asdict(SIDE), "name": "head"}]}, OptionError, "has a camera 'head'"),
        ({"image_sizes": {"side": 64}}, UnknownNameError, "camera 'side'"),
        ({"image_sizes": 64}, OptionError, "image_sizes is sizes by the name of a camera"),
        ({"image_sizes": {"head": 0}}, OptionError, "size of camera 'head'"),
        ({"depth": "hed"}, UnknownNameError, "camera 'hed'.*Did you mean 'head'"),
        ({"depth": "side"}, UnknownNameError, "camera 'side'"),
        ({"depth": None}, OptionError, "depth is True, False, the name of a camera.*None"),
        ({"depth": SIDE}, OptionError, "depth takes names.*stands in cameras"),
        ({"depth": [SIDE]}, OptionError, "depth takes names.*stands in cameras"),
        ({"depth": {"head": 64}}, OptionError, "depth is True, False"),
        ({"segmentation": 3}, OptionError, "segmentation is True, False.*3"),
        ({"image_size": {"head": 128}}, OptionError, "image_size is .height, width"),
        ({"image_size": {128: 1, 64: 2}}, OptionError, "image_size is .height, width"),
        ({"image_size": {128, 64}}, OptionError, "image_size is .height, width"),
        ({"image_size": b"@@"}, OptionError, "image_size is .height, width"),
        ({"image_size": np.array(3.5)}, OptionError, "image_size is .height, width"),
        ({"object_state": "yes"}, OptionError, "object_state is True or False, got 'yes'"),
        ({"flat_obs": "yes"}, OptionError, "flat_obs is True or False, got 'yes'"),
        ({"binary_gripper": 3}, OptionError, "binary_gripper is True or False, got 3"),
        ({"binary_gripper": np.array([1, 2])}, OptionError, "binary_gripper is True or False"),
        ({"cameras": (3,)}, UnknownNameError, "camera 3"),
        ({"action_mode": ["joint"]}, UnknownNameError, r"action mode \['joint'\]"),
        ({"render_mode": "human"}, UnknownNameError, "render mode 'human'.*rgb_array"),
        ({"image_size": 721}, OptionError, "image_size.*720.*721"),
        ({"image_size": (224, 224, 3)}, OptionError, "height, width"),
        ({"image_size": 0}, OptionError, "image_size"),
        ({"image_size": True}, OptionError, "image_size"),
        ({"image_size": 224.0}, OptionError, "image_size"),
        ({"render_size": (720, 1281)}, OptionError, "render_size"),
        ({"chunk": 2.5}, OptionError, "chunk"),
        ({"chunk": True}, OptionError, "chunk"),
        ({"horizon": -1}, OptionError, "horizon"),
        ({"instructions": "varied."}, UnknownNameError, "kind of instructions.*'varied'"),
    ],
    ids=str,
)
def test_what_cannot_be_is_refused(
    options: dict[str, Any], error: type[DuoBenchError], words: str
) -> None:
    with pytest.raises(error, match=words):
        duobench.make(TASK, **options)
    with pytest.raises(error, match=words):
        gym.make(f"duobench/{TASK}-v1", **options)


def test_the_options_of_one_environment_do_not_reach_another() -> None:
    make_env(TASK, cameras=False, horizon=3)
    assert sim_of(make_env(TASK, cameras=False)).definition is catalog.get(TASK)


def test_attributes_are_found_on_the_outermost_environment() -> None:
    env: Any = duobench.make(TASK, cameras="head", chunk=2)
    env.reset(seed=0)
    task = catalog.get(TASK)
    expected = {"task": TASK, "task_description": task.instruction}
    for name, value in (expected | {"_max_episode_steps": task.horizon}).items():
        assert [getattr(env, name), env.get_wrapper_attr(name)] == [value] * 2
        assert getattr(env.unwrapped, name) == value


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"cameras": (name for name in ("head", "left_wrist")), "image_size": np.int32(48)},
        {"cameras": False, "chunk": np.int64(3), "horizon": 9, "action_mode": "cartesian"},
        {"binary_gripper": True, "render_mode": "rgb_array", "render_size": [48, 64]},
        {"look": "random:3"},
        {"flat_obs": True, "object_state": 1},
        {"look": look("side_light")},
        {"cameras": {"head": (128, 96), "left_wrist": np.int64(64)}, "depth": True},
        {"cameras": ("head", SIDE), "depth": "side", "segmentation": True},
        {"cameras": SIDE, "image_size": 32},
        {"cameras": [asdict(SIDE)], "segmentation": ["side"]},
        {"cameras": {SIDE: 40}},
        {"cameras": False, "depth": "head", "image_sizes": {"head": [30, 40]}},
        {"cameras": False, "segmentation": 1},
    ],
    ids=lambda options: ", ".join(options) or "defaults",
)
def test_configuration_survives_its_text_and_makes_the_same_environment(
    options: dict[str, Any],
) -> None:
    config = EnvConfig.from_options(options)
    text = json.dumps(msgspec.to_builtins(config))
    assert msgspec.json.decode(text, type=EnvConfig) == config
    assert make_env(TASK, **asdict(config)).get_wrapper_attr("config") == config


@pytest.mark.parametrize(
    "fields",
    [
        {"cameras": "head"},
        {"cameras": ["head"]},
        {"image_size": 224},
        {"image_size": [224, 224]},
        {"render_size": (np.int64(48), 64)},
        {"binary_gripper": 1},
        {"chunk": np.int64(3)},
        {"look": {}},
        {"depth": True},
        {"depth": "head"},
        {"segmentation": ["head"]},
        {"image_sizes": {"head": 64}},
    ],
    ids=str,
)
def test_a_configuration_holds_plain_values_only(fields: dict[str, Any]) -> None:
    with pytest.raises(OptionError):
        EnvConfig(**fields)
    config = EnvConfig.from_options(fields)
    assert msgspec.json.decode(msgspec.json.encode(config), type=EnvConfig) == config


SEEDS = (1.5, "5", "a", -1, True, [3])
LAYOUTS = ("x", 5, [], {"poses": 5})


@pytest.mark.parametrize(
    ("asked", "error", "words"),
    [
        *(({"seed": seed}, OptionError, "whole number from 0 on, got") for seed in SEEDS),
        *(({"options": {"layout": x}}, LayoutError, "This is no layout") for x in LAYOUTS),
        ({"options": "x"}, OptionError, "options of a reset are a dict, got 'x'"),
        ({"options": {"nonsense": 1}}, UnknownNameError, "'nonsense'. Known: instruction, layout"),
        ({"options": {3: 1}}, UnknownNameError, "option of a reset 3. Known: instruction, layout"),
        ({"options": {"seed": 1}}, UnknownNameError, r"env\.reset\(seed=0\)"),
    ],
    ids=str,
)
def test_a_reset_refuses_what_is_no_seed_layout_or_dict(
    asked: dict[str, Any], error: type[DuoBenchError], words: str
) -> None:
    for env in (make_env(TASK, cameras=False), sim_of(make_env(TASK, cameras=False))):
        with pytest.raises(error, match=words):
            env.reset(**asked)


def test_what_people_look_for_on_the_outermost_environment() -> None:
    env: Any = make_env(TASK, cameras=False)
    env.reset(seed=0)
    simulation = env.unwrapped.simulation
    for name, value in (
        ("sim", simulation),
        ("model", simulation.model),
        ("data", simulation.data),
    ):
        with pytest.raises(
            AttributeError, match=f"no attribute '{name}'; try env.unwrapped."
        ) as no:
            getattr(env, name)
        place = str(no.value).partition("try env.")[2].removesuffix(".")
        assert reduce(getattr, place.split("."), env) is value
    assert env.config is env.get_wrapper_attr("config")
    for name, words in (
        ("_running", r"; try env\.get_wrapper_attr\('_running'\)\.$"),
        ("judg", r"no attribute 'judg'\.$"),
        ("seed", r"; try env\.reset\(seed=0\)\.$"),
        ("horizon", r"; try env\.spec\.max_episode_steps\.$"),
    ):
        with pytest.raises(AttributeError, match=words):
            getattr(env, name)
    assert env.get_wrapper_attr("_running")
    made: Any = gym.make(f"duobench/{TASK}-v1", cameras=False)
    assert made.spec.max_episode_steps == env._max_episode_steps


@pytest.mark.parametrize("options", [{}, {"cameras": False}, {"object_state": True, "chunk": 2}])
def test_arguments_of_a_reset_have_names(options: dict[str, Any]) -> None:
    env: Any = make_env(TASK, **{"cameras": False, **options})
    with pytest.raises(OptionError, match=r"by name: reset\(seed=3\)"):
        env.reset(3)
    assert list(inspect.signature(env.reset).parameters) == ["seed", "options"]


def test_options_that_editors_complete_are_those_of_the_configuration() -> None:
    known = {field.name for field in fields(EnvConfig)}
    assert set(EnvOptions.__annotations__) == known | {"max_episode_steps"}
    text = inspect.getdoc(duobench.make) or ""
    told = dict(re.findall(r"^ *- `(\w+)` \((.+?)\): ", text, re.MULTILINE))
    assert list(told) == list(EnvOptions.__annotations__)
    assert told.pop("max_episode_steps") == "None"
    assert told.pop("gripper") == "DEFAULT_GRIPPER"  # which alone names its kind
    defaults = {name: ast.literal_eval(text) for name, text in told.items()}
    assert EnvConfig.from_options(defaults) == EnvConfig()
    for function in (duobench.make, duobench.make_vec):
        assert inspect.signature(function).parameters["options"].annotation == "Unpack[EnvOptions]"


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_several_are_made_side_by_side(mode: Any) -> None:
    with closing(duobench.make_vec(TASK, 2, mode, cameras=False)) as several:
        observations, _ = several.reset(seed=[3, 4])
    with closing(duobench.make(TASK, cameras=False)) as alone:
        assert np.array_equal(observations["agent_pos"][1], alone.reset(seed=4)[0]["agent_pos"])


def bare() -> SimEnv:
    return SimEnv(catalog.get(TASK))


def choosing() -> gym.Env:
    return gym.wrappers.TransformAction(bare(), lambda action: action, gym.spaces.Discrete(3))


@pytest.mark.parametrize(
    ("wrap", "error", "words"),
    [
        (
            lambda: RandomizedReset(bare(), "test"),
            UnknownNameError,
            "split 'test'.*eval, train",
        ),
        (lambda: RandomizedReset(DuoEnv(NumberArms(), catalog.get(TASK))), TypeError, "simulated"),
        (lambda: TaskStages(DuoEnv(NumberArms(), catalog.get(TASK))), TypeError, "simulated"),
        (lambda: TaskStages(gym.make("CartPole-v1")), TypeError, "DuoEnv"),
        (lambda: TimeLimit(bare(), horizon=0), ValueError, "at least one"),
        (lambda: ActionChunks(bare(), 0), ValueError, "at least one"),
        (lambda: ActionChunks(choosing(), 2), TypeError, "Box"),
        (lambda: RelativeCartesianActions(bare()), AttributeError, "kinematics"),
        (lambda: Cameras(bare(), ["left_wirst"]), UnknownNameError, "'left_wrist'"),
        (lambda: Cameras(bare(), ["head"], (721, 1280)), RenderingError, "720"),
        (lambda: Cameras(FlattenObservation(bare()), ["head"]), TypeError, "Dict"),
    ],
)
def test_a_wrapper_that_does_not_fit_is_refused(
    wrap: Callable[[], gym.Env], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        wrap()


def test_environments_are_made_where_underflow_is_an_error() -> None:
    with np.errstate(all="raise"):
        make_env(TASK, cameras=False)


@pytest.mark.parametrize("number", [0, -1, 1.5, None])
def test_no_environments_are_not_several(number: Any) -> None:
    with pytest.raises(OptionError, match="num_envs is a whole number from 1 on"):
        duobench.make_vec("bin_sort", num_envs=number)


KINDS: dict[str, Callable[[], Any]] = {
    "usual": lambda: duobench.make(TASK, image_size=32, render_mode="rgb_array"),
    "blind": lambda: duobench.make(TASK, cameras=False, render_mode="rgb_array"),
    "chunks": lambda: duobench.make(
        TASK, cameras=False, render_mode="rgb_array", chunk=3, action_mode="cartesian"
    ),
    "flat and shifted": lambda: duobench.make(
        TASK, image_size=32, render_mode="rgb_array", flat_obs=True, shift="sensing-1"
    ),
    "one after the other": lambda: duobench.make_vec(
        TASK, 2, cameras=False, render_mode="rgb_array"
    ),
    "threads": lambda: duobench.make_vec(
        TASK, 2, threads=2, cameras=False, render_mode="rgb_array"
    ),
}


@pytest.mark.parametrize("is_over", [False, True], ids=["running", "over"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_closed_environment_says_that_it_is_closed(kind: str, is_over: bool) -> None:
    env = KINDS[kind]()
    env.reset(seed=0)
    action = env.action_space.sample()
    calls: dict[str, Callable[[], Any]] = {
        "step": lambda: env.step(action),
        "reset": lambda: env.reset(seed=0),
        "render": env.render,
    }
    if isinstance(env, gym.Env):
        state = env.get_wrapper_attr("save_state")()
        calls |= {
            "save_state": env.get_wrapper_attr("save_state"),
            "restore_state": lambda: env.get_wrapper_attr("restore_state")(state),
            "state_hash": env.get_wrapper_attr("state_hash"),
            "of the base": env.unwrapped.reset,
        }
        if is_over:
            env.get_wrapper_attr("allow_step_after_end")()
            env.step(action)
    env.close()
    env.close()
    for call in calls.values():
        with pytest.raises(DuoBenchError, match="This environment was closed; make a new one"):
            call()
