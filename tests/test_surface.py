"""The public surface: what may be imported from where, and what a policy's server needs."""

import ast
import importlib
import inspect
import pkgutil
import re
from pathlib import Path

import pytest

from tests.children import printed

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "duobench"
SURFACE = {
    "duobench": "Camera DuoBenchError __version__ make make_vec point_cloud register task_ids",
    "duobench.data": """
        ActionSource Actor ActorKind DataSet EpisodeInfo ExportOptions Exported
        ImageSource Outcome Pairing Problem Recorder Recording RowChoice Summary
        Transitions VideoCodec
        export_lerobot find_problems merge split summarize transitions write_page
    """,
    "duobench.envs": """
        ACTION_MODES ActionChunks BatchEnv BinaryGripper Cameras CartesianActions ClosedEnvError
        DuoEnv DuoWrapper EnvConfig EpisodeState FlatObservations ObjectStates RandomizedReset
        RelativeCartesianActions RelativeJointActions ResetNeededError SimEnv StateError TaskStages
        TimeLimit base_of env_id make make_env register sim_of
    """,
    "duobench.evaluation": """
        ExpertPolicy Job Observer PolicyChoice PolicySource Step VideoRecorder Watcher rollout
        source
    """,
    "duobench.results": """
        Episode Record Results Run RunFolder Score Suite TaskInfo TaskResult TimeLimits compare
        find_tasks open_source read_results summarize wilson_interval write_bundle
        write_comparison write_report
    """,
    "duobench.printing": """
        Foot Paper PrintChoice PrintJob PrintedPart Recipe Spot job_of lay_out
        layout_sheet neutral_layout outlines_of placing_jig recipe_of stl_bytes threemf_bytes
        write_prints
    """,
    "duobench.world.looks": "names",
    "duobench.world.objects": """
        BLACK CHARCOAL CUBE_EDGE Colour Hinge Image LONG_BLOCK MassProperties PALE Part Piece Prop
        RED Shape Solid Mesh Variant WHITE WOOD YELLOW block box circle corner_points cube cylinder
        hull images_of long_block mass_properties mesh_object mesh_of mjcf_object
        pieces_of printable prism ring_wall sphere
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
        ANY_YAW BLACK BoxRegion CHARCOAL CUBE_EDGE Carriage Category Choice Colour
        CylinderRegion Handover Hinge Hole Image Joining LONG_BLOCK Layout Mesh PALE Part
        Passage Piece Placement Port Pouring Predicate Prop RED Region Rolling SE3 SIDES Shape
        Side Solid Stage StateView Support TABLE Task Uniform Variant View WHITE WOOD YELLOW
        all_of any_of arm_touches around at_least block box carriage circle corner_points cube
        cylinder get grasped grasped_apart handover held_for hinge_open hull inserted inside
        joining lifted lifted_by_any long_block low_over mesh_object mjcf_object
        names off_table passage placed pouring
        prism put raised released rests_on ring_wall rolling since sphere still support touches
        touching upright variant
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


def test_a_name_stays_what_it_is_when_every_module_is_imported() -> None:
    """No module of a package is called as a public function or class of it."""
    for package in SURFACE:
        module = importlib.import_module(package)
        modules = {found.name for found in pkgutil.iter_modules(module.__path__)}
        assert not modules & {*module.__all__}, package


@pytest.mark.parametrize(
    "path", sorted(SOURCE.rglob("__init__.py")), ids=lambda path: path.parent.name
)
def test_type_checkers_see_the_names_that_a_package_has(path: Path) -> None:
    package = ".".join(path.parent.relative_to(SOURCE.parent).parts)
    blocks = [one for one in ast.parse(path.read_text()).body if isinstance(one, ast.If)]
    seen = {
        (alias.asname, node.module)
        for block in blocks
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    module = importlib.import_module(package)
    if not hasattr(module, "__getattr__"):
        assert not seen
        return
    assert {name for name, _ in seen} == {*module.__all__}
    for name, origin in seen:
        assert getattr(module, name) is getattr(importlib.import_module(origin), name)


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
    duobench.envs.state_labels
    duobench.envs.duo_env
    duobench.envs.execution
    duobench.envs.observation_wrappers
    duobench.envs.protocol
    duobench.envs.sim_env
    duobench.envs.spaces
    duobench.policy.policy
    duobench.policy.serving.message_format
    duobench.policy.serving.vla_eval
    duobench.real.calibration.views
    duobench.real.clock
    duobench.real.duo
    duobench.real.env
    duobench.real.opening
    duobench.real.rig
    duobench.results.run
    duobench.results.scores
    duobench.tasks.experts.expert
    duobench.tasks.experts.handling
    duobench.tasks.experts.motion
    duobench.tasks.object_state
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
    duobench.world.robot.camera_geometry
    duobench.world.robot.cameras
    duobench.world.robot.frames
    duobench.world.robot.gripper
    duobench.world.robot.joints
    duobench.world.robot.mounts
    duobench.world.sim.backend
    duobench.world.sim.simulation
"""
"""Modules beside those packages that docs, examples and plugins may import from; every other one is
private, whatever its name."""


def test_docs_examples_and_plugins_import_what_is_public() -> None:
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    code = [*(ROOT / "examples").rglob("*.py"), *(ROOT / "plugins").rglob("*.py")]
    beside = {path.stem for path in code}
    used = {
        found[1]
        for path in [*pages, *code]
        for found in re.finditer(r"^\s*from (duobench[\w.]*) import", path.read_text(), re.M)
    }
    assert used - SURFACE.keys() - beside == set(OFFERED.split())
