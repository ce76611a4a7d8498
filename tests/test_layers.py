"""Imports point down: every wing of the package may use the wings below it and none above, and
folders never import each other in a circle.

The rules are data (`FLOORS`, `FORBIDDEN`); `violations` reads the source of a package, never runs
it, and so sees imports inside functions and under `TYPE_CHECKING` as well.
"""

import ast
import shutil
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import duobench

# Floor of each wing. A wing may import itself and those on lower floors; wings of one floor are
# siblings, which never import each other.
FLOORS = {
    "core": 0,
    "world": 1,
    "tasks": 2,
    "envs": 3,
    "web": 3,
    "policy": 4,
    "data": 4,
    "printing": 4,
    "results": 5,
    "evaluation": 6,
    "teleop": 6,
    "real": 7,
    "cli": 8,
    "__main__": 9,
}

# Modules that a wing may not name, apart from what the floors already say.
EVERYWHERE = (
    "torch",
    "jax",
    "tensorflow",
    "lerobot",
    "ray",
    "rclpy",
    "rospy",
    "vla_eval",
    "vlagents",
    "rpyc",
    "franky",
    "pymodbus",
    "serial",
    "pyrealsense2",
    "cv2",
)
# Rooms that exist for the sake of one of them; they are imported when it is asked for.
AT_HOME = {
    "duobench.policy.lerobot_model": ("torch", "lerobot"),
    "duobench.teleop.leaders.lerobot_source": ("lerobot",),
    "duobench.real": ("franky", "pymodbus", "serial", "pyrealsense2", "cv2"),
    "duobench.evaluation.runners.ray_cluster": ("ray",),
    "duobench.evaluation.runners.ray_process": ("ray",),
    "duobench.evaluation.interop.vlagents_bridge": ("vlagents",),
}
GYMNASIUM = ("gymnasium", "gym")
FORBIDDEN = {
    "duobench.core": ("mujoco", *GYMNASIUM),
    "duobench.world": GYMNASIUM,
    "duobench.world.robot": ("mujoco",),
    "duobench.world.looks": ("mujoco",),
    "duobench.world.scene": ("mujoco.mj_step", "mujoco.mj_step1", "mujoco.mj_step2"),
    "duobench.tasks": GYMNASIUM,
    "duobench.tasks.stages": (
        "duobench.core.randomness",
        "duobench.world.sim.rendering",
        "numpy.random",
        "random",
        "mujoco.Renderer",
    ),
    "duobench.tasks.experts": ("mujoco",),
    "duobench.tasks.shifts": ("mujoco",),
    "duobench.envs": (
        "http",
        "pathlib",
        "requests",
        "shutil",
        "socket",
        "tempfile",
        "urllib",
        "websockets",
    ),
    "duobench.policy": ("mujoco",),
    "duobench.printing": (
        "mujoco",
        *GYMNASIUM,
        "duobench.envs",
        "duobench.world.sim.simulation",
    ),
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


def objection(module: str, name: str) -> str | None:
    """Say why a module may not name something, or None where it may."""
    at_home = any(
        names_one_of(module, (home,)) and names_one_of(name, guests)
        for home, guests in AT_HOME.items()
    )
    if names_one_of(name, EVERYWHERE) and not at_home:
        return "is no dependency of the core"
    for place, forbidden in FORBIDDEN.items():
        if names_one_of(module, (place,)) and names_one_of(name, forbidden):
            return f"is forbidden in {place}"
    if not names_one_of(name, ("duobench",)):
        return None
    wing = module.split(".")[1]
    other = name.split(".")[1] if "." in name else name
    if other not in FLOORS:
        return "is no wing, and the package itself stands above every wing"
    if other != wing and FLOORS[other] >= FLOORS[wing]:
        is_sibling = FLOORS[other] == FLOORS[wing]
        return f"is a sibling of {wing}" if is_sibling else f"lies above {wing}"
    return None


@cache
def names_in(source: str, module: str, is_package: bool) -> list[str]:
    """What the source of a module names; a copy of the package is read no second time."""
    return list(named(ast.parse(source), module, is_package=is_package))


def modules_of(package: Path) -> dict[str, tuple[bool, list[str]]]:
    """The modules under a package folder but itself: whether each is a package, what it names."""
    found = {}
    for path in sorted(package.rglob("*.py")):
        parts = [package.name, *path.relative_to(package).with_suffix("").parts]
        is_package = parts[-1] == "__init__"
        module = ".".join(parts[:-1] if is_package else parts)
        found[module] = is_package, names_in(path.read_text(encoding="utf-8"), module, is_package)
    found.pop(package.name, None)
    return found


def violations(package: Path) -> set[str]:
    """Return one sentence for every import under a package folder that breaks a rule."""
    found = set()
    for module, (_, names) in modules_of(package).items():
        wing = module.split(".")[1]
        if wing not in FLOORS:
            found.add(f"{module}: {wing} has no floor")
            continue
        for name in names:
            reason = objection(module, name)
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
    assert len(list(package.rglob("*.py"))) > len(FLOORS), "the package was not found"
    assert violations(package) == set()


@pytest.mark.parametrize(
    ("path", "source", "complaint"),
    [
        ("world/sim/a.py", "from duobench.tasks import catalog", "tasks.catalog lies above world"),
        ("world/a.py", "from ..envs.spaces import x", "duobench.envs.spaces.x lies above world"),
        ("world/__init__.py", "from ..envs import x", "duobench.envs.x lies above world"),
        ("envs/deep/a.py", "from ...cli import x", "duobench.cli.x lies above envs"),
        ("core/a.py", "from duobench.world import objects", "world.objects lies above core"),
        ("policy/a.py", "from duobench.data import x", "duobench.data.x is a sibling of policy"),
        ("teleop/a.py", "import duobench.evaluation", "duobench.evaluation is a sibling of teleop"),
        ("results/a.py", "from duobench.evaluation import x", "lies above results"),
        ("results/a.py", "from duobench.real.clock import x", "lies above results"),
        ("core/randomness.py", "import mujoco", "mujoco is forbidden in duobench.core"),
        ("world/a.py", "def f():\n    import gymnasium.spaces", "gymnasium.spaces is forbidden"),
        ("tasks/a.py", "if TYPE_CHECKING:\n    import gymnasium", "gymnasium is forbidden"),
        ("world/scene/a.py", "import mujoco as mj\nmj.mj_step(m, d)", "mj_step is forbidden"),
        ("world/scene/a.py", "import mujoco.viewer\nmujoco.mj_step(m, d)", "mj_step is forbidden"),
        ("tasks/stages/a.py", "import numpy as np\nnp.random.rand()", "rand is forbidden"),
        ("tasks/stages/a.py", "from duobench.world.sim import rendering", "sim.rendering is forb"),
        ("envs/a.py", "import urllib.request", "urllib.request is forbidden in duobench.envs"),
        ("tasks/experts/a.py", "import mujoco", "mujoco is forbidden in duobench.tasks.experts"),
        ("tasks/experts/a.py", "from gymnasium import Env", "gymnasium.Env is forbidden"),
        ("cli/a.py", "import torch.nn", "torch.nn is no dependency of the core"),
        ("cli/a.py", "import_module('torch')", "torch is no dependency of the core"),
        ("policy/a.py", "import lerobot", "lerobot is no dependency of the core"),
        ("policy/lerobot_model.py", "import jax", "jax is no dependency of the core"),
        ("policy/a.py", "import vla_eval.specs", "vla_eval.specs is no dependency of the core"),
        ("policy/a.py", "import rpyc", "rpyc is no dependency of the core"),
        ("world/a.py", "import duobench", "duobench is no wing"),
        ("world/a.py", "from duobench import __version__", "duobench.__version__ is no wing"),
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
        ("world/sim/a.py", "from duobench.world.scene import x\nfrom . import b\nimport mujoco"),
        ("world/a.py", "import duobench.core.errors\nraise duobench.core.errors.LayoutError"),
        ("envs/a.py", "import gymnasium\nfrom ..tasks.task import Task"),
        ("evaluation/a.py", "from duobench.tasks.experts import x\nfrom duobench.policy import y"),
        ("world/scene/a.py", "import mujoco\nmujoco.mj_stepping_stone"),
        ("tasks/stages/a.py", "import numpy as np\nnp.randomly"),
        ("policy/lerobot_model.py", "import torch\nfrom lerobot import policies"),
        ("evaluation/interop/vlagents_bridge.py", "from vlagents.client import x"),
        ("real/a.py", "from duobench.teleop import x\nfrom duobench.results import y"),
    ],
)
def test_what_is_allowed_is_not_reported(tmp_path: Path, path: str, source: str) -> None:
    module = tmp_path / "duobench" / path
    module.parent.mkdir(parents=True, exist_ok=True)
    module.write_text(source)
    assert violations(tmp_path / "duobench") == set()


def test_folders_are_walls() -> None:
    """Every folder can be imported one way; a sub-folder is a wall as well."""
    assert circles(Path(duobench.__file__).parent) == set()


def test_a_circle_of_folders_is_found(tmp_path: Path) -> None:
    copy = tmp_path / "duobench"
    shutil.copytree(
        Path(duobench.__file__).parent, copy, ignore=shutil.ignore_patterns("*.pyc", "assets")
    )
    sim = copy / "world" / "sim"
    (sim / "lower").mkdir()
    (sim / "lower" / "__init__.py").write_text("")
    (sim / "lower" / "a.py").write_text("import duobench.world.sim.simulation\n")
    with (sim / "simulation.py").open("a") as file:
        file.write("\n\ndef late():\n    from duobench.world.sim.lower import a\n")
    assert {"duobench.world.sim", "duobench.world.sim.lower"} <= circles(copy)
