"""The public surface: what may be imported from where, and what a policy's server needs."""

import importlib
import inspect
import re
from pathlib import Path

import pytest

from tests.children import printed

ROOT = Path(__file__).parents[1]
SURFACE = {
    "duobench": "DuoBenchError __version__ make make_vec register task_ids",
    "duobench.data": """
        ActionSource Actor ActorKind DataSet EpisodeInfo ExportOptions Exported
        ImageSource Outcome Pairing Problem Recorder Recording Summary
        export_lerobot find_problems merge split summarize write_page
    """,
    "duobench.envs": """
        ACTION_MODES ActionChunks BatchEnv BinaryGripper Cameras CartesianActions ClosedEnvError
        DuoEnv DuoWrapper EnvConfig EpisodeState FlatObservations ObjectStates RandomizedReset
        RelativeCartesianActions RelativeJointActions ResetNeededError SimEnv StateError TaskStages
        TimeLimit base_of env_id make make_env register sim_of
    """,
    "duobench.evaluation": """
        Episode EpisodeRecord ExpertPolicy Job Observer PolicyChoice PolicySource Results Run
        RunFolder Score Step Suite TaskInfo TaskResult TimeLimits VideoRecorder Watcher find_tasks
        open_source read_results rollout source summarize wilson_interval write_bundle write_report
    """,
    "duobench.printing": """
        Foot Paper PrintChoice PrintJob PrintedPart Recipe Spot fit_coupon job_of lay_out
        layout_sheet neutral_layout outlines_of placing_jig recipe_of stl_bytes threemf_bytes
        write_prints
    """,
    "duobench.world.looks": "names",
    "duobench.world.objects": """
        BLACK CHARCOAL CUBE_EDGE Colour Hinge Image LONG_BLOCK MassProperties PALE Part Piece Prop
        RED Shape Solid Mesh Variant WHITE WOOD YELLOW block box circle corner_points cube cylinder
        hull images_of long_block mass_properties mesh_of pieces_of printable prism ring_wall sphere
    """,
    "duobench.policy": """
        BASELINES BatchPolicy Batching HoldPolicy Policy PolicyMetadata RandomPolicy Session
        SessionPolicy ZeroPolicy as_chunk check_fits make noise
    """,
    "duobench.evaluation.replay": """
        Divergence Finding Verdict Verification replay verify
    """,
    "duobench.evaluation.runners": """
        Attempt Executor LocalExecutor ProcessExecutor evaluate record
    """,
    "duobench.tasks": """
        ANY_YAW BoxRegion Carriage Category Choice CylinderRegion Handover Hole Joining Layout
        Passage Placement Port Pouring Predicate Region Rolling SE3 SIDES Side Stage StateView
        Support TABLE Task Uniform View all_of any_of arm_touches around at_least carriage get
        grasped grasped_apart handover held_for hinge_open inserted inside joining lifted
        lifted_by_any low_over names off_table passage placed pouring put raised released rests_on
        rolling since still support touches touching upright variant
    """,
}
"""Public names by package; a change here is a change for users, and goes into CHANGELOG.md."""

SERVER = """
import sys
from pathlib import Path
for name in ("gymnasium", "mujoco", "msgspec", "trimesh", "manifold3d", "mink"):
    sys.modules[name] = None  # as where it is not installed
import numpy as np
from duobench.policy import Batching, PolicyMetadata, as_chunk, make
observation = {"agent_pos": np.zeros(16, dtype=np.float32)}
for name in ("hold", "random", "zero"):
    policy = make(name)
    policy.reset("Do it.", seed=0)
    print(as_chunk(policy.act(observation)).shape)
del sys.modules["msgspec"]  # a server needs it, and websockets
from duobench.policy.serving.host import make_served
make_served("hold", Batching())
"""


@pytest.mark.parametrize("package", SURFACE)
def test_the_public_names_are_the_written_ones(package: str) -> None:
    module = importlib.import_module(package)
    assert sorted(module.__all__) == sorted(SURFACE[package].split())
    assert set(module.__all__) <= set(dir(module))


@pytest.mark.parametrize("package", SURFACE)
def test_every_public_name_is_there_and_described(package: str) -> None:
    module = importlib.import_module(package)
    for name in module.__all__:
        value = getattr(module, name)
        assert not inspect.ismodule(value), name
        if inspect.isclass(value) or inspect.isfunction(value):
            assert inspect.getdoc(value), name
            assert value.__module__.startswith("duobench."), name


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match=r"'duobench\.tasks' has no attribute 'Tsak'"):
        importlib.import_module("duobench.tasks").Tsak  # noqa: B018 - looking is the point


@pytest.mark.parametrize("name", ["duobench.tasks", "duobench.world.looks"])
def test_a_package_that_is_called_says_what_lists_its_names(name: str) -> None:
    package = importlib.import_module(name)
    with pytest.raises(TypeError, match=rf"a package; {name}\.names\(\)"):
        package()
    assert package.names()


def test_a_module_does_not_hide_the_function_of_its_name() -> None:
    code = (
        "import duobench.evaluation.rollout, duobench.evaluation.runners.evaluate\n"
        "from duobench.evaluation import rollout\n"
        "from duobench.evaluation.runners import evaluate\n"
        "print(callable(evaluate), callable(rollout))"
    )
    assert printed(code) == "True True\n"


def test_a_policy_needs_numpy_only() -> None:
    assert printed(SERVER) == "(1, 16)\n" * 3


OFFERED = """
    duobench.cli.shared.page
    duobench.core.errors
    duobench.core.lerobot_keys
    duobench.core.randomness
    duobench.core.spatial
    duobench.core.types
    duobench.envs.action_labels
    duobench.envs.duo_env
    duobench.envs.observation_wrappers
    duobench.envs.protocol
    duobench.envs.sim_env
    duobench.envs.spaces
    duobench.real.calibration.views
    duobench.real.clock
    duobench.real.duo
    duobench.real.env
    duobench.real.opening
    duobench.real.rig
    duobench.results.folder
    duobench.results.scores
    duobench.results.suite
    duobench.tasks.experts.expert
    duobench.tasks.experts.handling
    duobench.tasks.experts.motion
    duobench.teleop.hands
    duobench.teleop.leaders.device
    duobench.teleop.leaders.lerobot_source
    duobench.teleop.messages
    duobench.teleop.teleop_page
    duobench.teleop.teleoperation
    duobench.web.geometry
    duobench.web.messages
    duobench.world.kinematics.inverse
    duobench.world.looks.look
    duobench.world.robot.frames
    duobench.world.robot.joints
    duobench.world.sim.simulation
"""
"""Modules beside those packages that docs, examples and plugins may import from; every other one is
private, whatever its name."""


def test_docs_examples_and_plugins_import_what_is_public() -> None:
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    code = [*(ROOT / "examples").rglob("*.py"), *(ROOT / "plugins").rglob("*.py")]
    used = {
        found[1]
        for path in [*pages, *code]
        for found in re.finditer(r"^\s*from (duobench[\w.]*) import", path.read_text(), re.M)
    }
    assert used - SURFACE.keys() == set(OFFERED.split())
