"""What a real robot needs runs in a process that cannot import the simulator."""

import json
from pathlib import Path

import pytest

import duobench
from tests.children import printed

ENGINES = ("mujoco", "manifold3d", "mink")
BLOCKED = f"import sys\nsys.modules.update(dict.fromkeys({ENGINES}))\n"
"""As where they are not installed: importing one of them is an error."""
MOST = 59
"""Modules of the package that may load MuJoCo when they are imported."""

# Wings and folders that load no engine, whatever of them is imported, but for some modules.
ROOMS = (
    "cli",
    "core",
    "envs",
    "policy",
    "printing",
    "real",
    "results",
    "tasks",
    "world.kinematics",
    "world.looks",
    "world.objects",
    "world.robot",
)
NEEDS_AN_ENGINE = (
    "duobench.policy.lerobot_model",  # that of LeRobot
    "duobench.envs.batch_env",
    "duobench.envs.sim_env",
    "duobench.real.rehearsal",
    "duobench.real.drivers.rehearsal",
    "duobench.real.sessions",
)

IMPORT_ALL = """
import importlib
for name in sys.argv[1:]:
    importlib.import_module(name)
import gc
from duobench.world.objects import Shape, Solid
from duobench.tasks import catalog
for name in catalog.names():
    catalog.get(name)
print([type(one).__name__ for one in gc.get_objects() if isinstance(one, (Shape, Solid))])
"""

PLAY = """
import json
from pathlib import Path
from tests.real_episode import play, refusal
recording, results = play(Path(sys.argv[1]))
(record,) = results.tasks[0].records
print(json.dumps({
    "stages": recording.stage.tolist(),
    "states": recording.state.shape,
    "is_real": recording.info.is_real,
    "mode": recording.info.action_mode,
    "success": record.success,
    "stage_changes": record.stage_changes,
    "layout": record.layout,
    "successes": results.overall.successes,
    "object states": refusal(),
    "engines": [name for name in %r if sys.modules[name] is not None],
}))
"""

REAL = """
from pathlib import Path
import numpy as np
from duobench.real.clock import VirtualClock
from duobench.real.env import make_real_env
from duobench.real.opening import open_rig
from tests.real.simulated import simulated_rig
simulated_rig().write(Path(sys.argv[1]))
duo = open_rig(sys.argv[1], VirtualClock(), guard=False)
env = make_real_env(duo, "bin_sort", action_mode="joint_relative", image_size=(24, 32), chunk=2)
duo.supervisor.confirm()
observation, info = env.reset(seed=0)
env.get_wrapper_attr("judge").declare(1)
observation, reward, terminated, truncated, info = env.step(np.full((2, 16), 0.01))
duo.arms["left"].fail("joint_reflex")
*_, ended, last = env.step(np.zeros((2, 16)))
env.close()
print(info["stage"], observation["pixels"]["head"].shape, ended, last["fault_kind"])
print([name for name in %r if sys.modules[name] is not None])
"""

LIST = """
import importlib
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except ImportError as error:  # another engine, or a library of an optional extra
        if error.name == "mujoco":
            print(name)
"""


def modules() -> list[str]:
    """Every module of the package but its entry point."""
    folder = Path(duobench.__file__).parent
    paths = (path.relative_to(folder.parent).with_suffix("") for path in folder.rglob("*.py"))
    names = {".".join(path.parts).removesuffix(".__init__") for path in paths}
    return sorted(name for name in names if not name.endswith("__main__"))


def inside(place: str) -> set[str]:
    """A module, and those of a folder of that name."""
    return {name for name in modules() if f"{name}.".startswith(f"{place}.")}


@pytest.mark.slow
def test_rooms_below_the_simulation_load_no_engine_and_tasks_no_geometry() -> None:
    chosen = set()
    for room in ROOMS:
        found = inside(f"duobench.{room}")
        assert found, room
        chosen |= found
    for name in NEEDS_AN_ENGINE:
        chosen -= inside(name)
    assert printed(BLOCKED + IMPORT_ALL, *sorted(chosen)) == "[]\n"


def test_an_episode_on_arms_without_a_simulation_is_played_recorded_and_reported(
    tmp_path: Path,
) -> None:
    found = json.loads(printed(BLOCKED + PLAY % (ENGINES,), str(tmp_path)))
    assert found == {
        "stages": [0, 0, 1, 1, 1, 3, 3, 3, 5],
        "states": [9, 0],
        "is_real": True,
        "mode": "joint_relative",
        "success": True,
        "stage_changes": [[2, 1], [5, 3], [8, 5]],
        "layout": {},
        "successes": 1,
        "object states": (
            "Object states are read from a simulation, and there is none in a DuoEnv."
        ),
        "engines": [],
    }
    assert (tmp_path / "run" / "index.html").read_text().count("Bin-Sort")


def test_an_episode_on_drivers_of_ones_own_needs_no_engine_without_guard(tmp_path: Path) -> None:
    said = printed(BLOCKED + REAL % (ENGINES,), str(tmp_path / "rig.json"))
    assert said == "1 (24, 32, 3) True contact\n[]\n"


@pytest.mark.slow
def test_few_modules_load_mujoco() -> None:
    loading = printed(BLOCKED + LIST, *modules()).split()
    assert "duobench.world.sim.simulation" in loading
    assert len(loading) <= MOST, loading
