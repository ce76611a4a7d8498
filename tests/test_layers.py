"""Imports point down: every room of the package may use the rooms below it and none above, and
folders never import each other in a circle.

The rules are data (`FLOORS`, `FORBIDDEN`); `violations` reads the source of a package, never runs
it, and so sees imports inside functions and under `TYPE_CHECKING` as well.
"""

import ast
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

import duobench

# Rooms from the ground up. A room may import the rooms of every line above its own here, and
# itself; rooms of one line are siblings, which never import each other.
FLOORS = (
    ("errors",),
    (
        *("types", "randomness", "files", "machine", "references", "versions", "pages"),
        *("lerobot_keys", "serving_thread", "settings", "sheets"),
    ),
    ("spatial", "backend", "video"),
    ("robot",),
    ("looks", "objects"),
    ("scene",),
    ("kinematics", "sim"),
    ("stages",),
    ("tasks",),
    ("shifts",),
    ("envs",),
    ("experts", "data", "policy", "hardware", "fabrication", "training", "web"),
    ("results",),
    ("evaluation", "teleop", "interop"),
    ("replay",),
    ("runners", "rig_sessions"),
    ("cli",),
    ("__main__",),
)
RANK = {room: rank for rank, rooms in enumerate(FLOORS) for room in rooms}
BASE = tuple(room for rooms in FLOORS[:3] for room in rooms)

# Modules that a room may not name, apart from what the floors already say.
EVERYWHERE = (
    *("torch", "jax", "tensorflow", "lerobot", "ray", "rclpy", "rospy"),
    *("vla_eval", "vlagents", "rpyc"),
    *("franky", "pymodbus", "serial", "pyrealsense2", "cv2"),
)
# Rooms inside rooms that exist for the sake of one of them; they are imported when it is asked for.
AT_HOME = {
    "duobench.policy.lerobot_model": ("torch", "lerobot"),
    "duobench.teleop.leaders.lerobot_source": ("lerobot",),
    "duobench.hardware": ("franky", "pymodbus", "serial", "pyrealsense2", "cv2"),
    "duobench.runners.ray_cluster": ("ray",),
    "duobench.runners.ray_process": ("ray",),
    "duobench.interop.vla_eval": ("vla_eval",),
    "duobench.interop.vlagents_bridge": ("vlagents",),
}
GYMNASIUM = ("gymnasium", "gym")
FORBIDDEN = {
    **dict.fromkeys((*BASE, "robot", "looks"), ("mujoco", *GYMNASIUM)),
    "objects": GYMNASIUM,
    "kinematics": GYMNASIUM,
    "scene": (*GYMNASIUM, "mujoco.mj_step", "mujoco.mj_step1", "mujoco.mj_step2"),
    "sim": GYMNASIUM,
    "stages": (
        *GYMNASIUM,
        "duobench.randomness",
        "duobench.sim.rendering",
        "numpy.random",
        "random",
        "mujoco.Renderer",
    ),
    "tasks": ("mujoco", *GYMNASIUM),
    "shifts": ("mujoco", *GYMNASIUM),
    "envs": ("http", "pathlib", "requests", "shutil", "socket", "tempfile", "urllib", "websockets"),
    "experts": ("mujoco", *GYMNASIUM),
    "policy": ("mujoco",),
    "training": ("mujoco", *GYMNASIUM),
    "fabrication": ("mujoco", *GYMNASIUM, "duobench.envs", "duobench.sim.simulation"),
}


def imports(node: ast.AST, package: list[str]) -> Iterator[tuple[str, str, str]]:
    """Yield (imported name, local name, what that is bound to) for one import statement."""
    if isinstance(node, ast.Import):
        for alias in node.names:
            root = alias.name.split(".")[0]
            yield (alias.name, alias.asname or root, alias.name if alias.asname else root)
    elif isinstance(node, ast.ImportFrom):
        above = package[: len(package) - node.level + 1] if node.level else []
        origin = ".".join([*above, *([node.module] if node.module else [])])
        for alias in node.names:
            name = f"{origin}.{alias.name}"
            yield name, alias.asname or alias.name, name


def named(tree: ast.Module, module: str, *, is_package: bool) -> Iterator[str]:
    """Yield the dotted name of everything that a module imports or reaches by attribute."""
    package = module.split(".") if is_package else module.split(".")[:-1]
    bound = {}
    for node in ast.walk(tree):
        for name, local, target in imports(node, package):
            bound[local] = target
            yield name
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            start, _, rest = ast.unparse(node).partition(".")
            if start in bound:
                yield f"{bound[start]}.{rest}"
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            yield from (str(a.value) for a in node.args[:1] if isinstance(a, ast.Constant))


def names_one_of(name: str, prefixes: tuple[str, ...]) -> bool:
    return any(name == prefix or name.startswith(prefix + ".") for prefix in prefixes)


def objection(room: str, name: str, module: str = "") -> str | None:
    """Say why code in a room may not name something, or None where it may."""
    at_home = any(
        names_one_of(module, (home,)) and names_one_of(name, guests)
        for home, guests in AT_HOME.items()
    )
    if names_one_of(name, EVERYWHERE) and not at_home:
        return "is no dependency of the core"
    if names_one_of(name, FORBIDDEN.get(room, ())):
        return f"is forbidden in {room}"
    if not names_one_of(name, ("duobench",)):
        return None
    other = name.split(".")[1] if "." in name else name
    if other not in RANK:
        return "is no room, and the package itself stands above every room"
    if other != room and RANK[other] >= RANK[room]:
        return f"is a sibling of {room}" if RANK[other] == RANK[room] else f"lies above {room}"
    return None


def modules_of(package: Path) -> dict[str, tuple[bool, list[str]]]:
    """The modules under a package folder but itself: whether each is a package, what it names."""
    found = {}
    for path in sorted(package.rglob("*.py")):
        parts = [package.name, *path.relative_to(package).with_suffix("").parts]
        is_package = parts[-1] == "__init__"
        module = ".".join(parts[:-1] if is_package else parts)
        tree = ast.parse(path.read_text(encoding="utf-8"))
        found[module] = is_package, list(named(tree, module, is_package=is_package))
    found.pop(package.name, None)
    return found


def violations(package: Path) -> set[str]:
    """Return one sentence for every import under a package folder that breaks a rule."""
    found = set()
    for module, (_, names) in modules_of(package).items():
        room = module.split(".")[1]
        if room not in RANK:
            found.add(f"{module}: {room} has no floor")
            continue
        for name in names:
            reason = objection(room, name, module)
            if reason is not None:
                found.add(f"{module}: {name} {reason}")
    return found


def folder_of(module: str, modules: set[str]) -> str:
    """The folder that a module lies in; a module beside the package's own face is its own."""
    is_folder = any(other.startswith(module + ".") for other in modules)
    return module if is_folder or module.count(".") == 1 else module.rpartition(".")[0]


def circles(package: Path) -> set[str]:
    """Return the folders under a package that import each other, straight or through others.

    A package's face, its `__init__`, belongs to its folder; it may offer what lies in its own
    sub-folders, which is loaded when it is asked for.
    """
    modules = modules_of(package)
    folders = {module: folder_of(module, set(modules)) for module in modules}
    graph: dict[str, set[str]] = {}
    for module, (is_package, names) in modules.items():
        for name in names:
            target = next((each for each in (name, name.rpartition(".")[0]) if each in modules), "")
            is_offered = is_package and name.startswith(module + ".")
            if target and not is_offered and folders[target] != folders[module]:
                graph.setdefault(folders[module], set()).add(folders[target])

    def reached(start: str) -> set[str]:
        found: set[str] = set()
        left = list(graph.get(start, ()))
        while left:
            if (folder := left.pop()) not in found:
                found.add(folder)
                left += graph.get(folder, ())
        return found

    return {folder for folder in graph if folder in reached(folder)}


def test_imports_of_the_package_point_down() -> None:
    package = Path(duobench.__file__).parent
    assert len(list(package.rglob("*.py"))) > len(RANK) / 2, "the package was not found"
    assert violations(package) == set()


@pytest.mark.parametrize(
    ("path", "source", "complaint"),
    [
        ("sim/a.py", "from duobench.tasks import catalog", "duobench.tasks.catalog lies above sim"),
        ("sim/a.py", "from ..envs.spaces import x", "duobench.envs.spaces.x lies above sim"),
        ("sim/__init__.py", "from ..envs import x", "duobench.envs.x lies above sim"),
        ("envs/deep/a.py", "from ...cli import x", "duobench.cli.x lies above envs"),
        ("errors.py", "import duobench.spatial", "duobench.spatial lies above errors"),
        ("spatial.py", "from duobench import objects", "duobench.objects lies above spatial"),
        ("experts/a.py", "import duobench.policy", "duobench.policy is a sibling of experts"),
        ("policy/a.py", "from duobench.experts import x", "duobench.experts.x is a sibling"),
        ("types.py", "from duobench.randomness import x", "duobench.randomness.x is a sibling"),
        ("randomness.py", "import mujoco", "mujoco is forbidden in randomness"),
        ("sim/a.py", "def f():\n    import gymnasium.spaces", "gymnasium.spaces is forbidden"),
        ("tasks/a.py", "if TYPE_CHECKING:\n    import gymnasium", "gymnasium is forbidden"),
        ("scene/a.py", "import mujoco as mj\nmj.mj_step(m, d)", "mujoco.mj_step is forbidden"),
        ("scene/a.py", "import mujoco.viewer\nmujoco.mj_step(m, d)", "mujoco.mj_step is forbidden"),
        ("stages/a.py", "import numpy as np\nnp.random.rand()", "numpy.random.rand is forbidden"),
        ("stages/a.py", "from duobench.sim import rendering", "sim.rendering is forbidden"),
        ("envs/a.py", "import urllib.request", "urllib.request is forbidden in envs"),
        ("experts/a.py", "import mujoco", "mujoco is forbidden in experts"),
        ("experts/a.py", "from gymnasium import Env", "gymnasium.Env is forbidden in experts"),
        ("cli/a.py", "import torch.nn", "torch.nn is no dependency of the core"),
        ("cli/a.py", "import_module('torch')", "torch is no dependency of the core"),
        ("policy/a.py", "import lerobot", "lerobot is no dependency of the core"),
        ("policy/lerobot_model.py", "import jax", "jax is no dependency of the core"),
        ("policy/a.py", "import vla_eval.specs", "vla_eval.specs is no dependency of the core"),
        ("policy/a.py", "import rpyc", "rpyc is no dependency of the core"),
        ("interop/a.py", "from duobench.evaluation import x", "is a sibling of interop"),
        ("results/a.py", "from duobench.evaluation import x", "lies above results"),
        ("sim/a.py", "import duobench", "duobench is no room"),
        ("sim/a.py", "from duobench import __version__", "duobench.__version__ is no room"),
        ("attic/a.py", "", "attic has no floor"),
    ],
)
def test_a_violation_is_found(tmp_path: Path, path: str, source: str, complaint: str) -> None:
    module = tmp_path / "duobench" / path
    module.parent.mkdir(parents=True)
    module.write_text(source)
    found = violations(tmp_path / "duobench")
    assert any(complaint in sentence for sentence in found), found


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("__init__.py", "from duobench.envs import registration"),
        ("sim/a.py", "from duobench.scene import compose\nfrom . import b\nimport mujoco"),
        ("sim/a.py", "import duobench.errors\nraise duobench.errors.LayoutError"),
        ("envs/a.py", "import gymnasium\nfrom ..tasks.task import Task"),
        ("evaluation/a.py", "from duobench.experts import x\nfrom duobench.policy import y"),
        ("scene/a.py", "import mujoco\nmujoco.mj_stepping_stone"),
        ("stages/a.py", "import numpy as np\nnp.randomly"),
        ("policy/lerobot_model.py", "import torch\nfrom lerobot import policies"),
        ("interop/vla_eval.py", "from vla_eval.specs import x\nfrom duobench.policy import y"),
        ("interop/vlagents_bridge.py", "import vlagents\nfrom duobench.policy import y"),
    ],
)
def test_what_is_allowed_is_not_reported(tmp_path: Path, path: str, source: str) -> None:
    module = tmp_path / "duobench" / path
    module.parent.mkdir(parents=True, exist_ok=True)
    module.write_text(source)
    assert violations(tmp_path / "duobench") == set()


def test_folders_are_walls() -> None:
    """Every folder can be imported one way; a sub-folder is a room as well."""
    assert circles(Path(duobench.__file__).parent) == set()


def test_a_circle_of_folders_is_found(tmp_path: Path) -> None:
    copy = tmp_path / "duobench"
    shutil.copytree(
        Path(duobench.__file__).parent, copy, ignore=shutil.ignore_patterns("*.pyc", "assets")
    )
    (copy / "sim" / "lower").mkdir()
    (copy / "sim" / "lower" / "__init__.py").write_text("")
    (copy / "sim" / "lower" / "a.py").write_text("import duobench.sim.simulation\n")
    with (copy / "sim" / "simulation.py").open("a") as file:
        file.write("\n\ndef late():\n    from duobench.sim.lower import a\n")
    assert {"duobench.sim", "duobench.sim.lower"} <= circles(copy)
