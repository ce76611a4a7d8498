"""Versions of this package and of everything else that a score depends on; nothing is loaded.

A version number does not tell two checkouts apart: hashes of the source do.
"""

import hashlib
import platform
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from duobench.core.errors import DuoBenchError, escaped

__version__ = "1.0.0rc1"
"""Version of the software; a build reads it from this line."""
ENGINE = "4.0"
"""Minor version of MuJoCo whose runs are comparable: scores depend on the engine."""
_PACKAGES = ("mujoco", "numpy", "mink", "daqp", "scipy", "manifold3d")
"""The engine, the arithmetic, the inverse kinematics with its solver, and what cuts shapes."""
_DECIDING = ("mujoco", "numpy", "manifold3d")
"""Packages that decide the bits of a replay of joint targets."""
SOURCES = (
    "core/backend.py",
    "core/randomness.py",
    "core/settings.py",
    "core/spatial.py",
    "core/types.py",
    "world/robot",
    "world/looks",
    "world/objects",
    "world/scene",
    "world/kinematics",
    "world/sim",
    "tasks",
    "tasks/stages",
    "tasks/shifts",
    "envs",
    "evaluation/rollouts.py",
    "evaluation/recorder.py",
)
"""Parts of the package that decide what an episode is, and what a record says of it. A folder that
is a part of its own does not belong to the part that contains it."""
SCRIPTED = ("tasks/experts", "policy/baselines.py")
"""Parts that decide what a scripted policy does, which has no version of its own."""
_PACKAGE = Path(__file__).parents[1]
_KINDS = frozenset((".py", ".toml", ".npz", ".js", ".css", ".html", ".j2"))
"""Endings of files of the package; other files, such as those of editors, are ignored."""
_SAME_EVERYWHERE = "x86_64"
"""The architecture whose processors with AVX2 give the same bits."""


def package_versions() -> dict[str, str]:
    """Versions that must not change within a run: the benchmark's and those of its engine."""
    from importlib.metadata import version  # half of the time of `import duobench`

    return {"duobench": __version__, **{name: version(name) for name in _PACKAGES}}


def other_engine(versions: Mapping[str, str | None]) -> str:
    """Note on versions with another MuJoCo than the benchmark's; empty where it is the same."""
    version = versions.get("mujoco")
    is_ours = version is None or version == ENGINE or version.startswith(f"{ENGINE}.")
    return "" if is_ours else f"MuJoCo {escaped(str(version))} instead of {ENGINE}"


def source_hashes(
    modules: Iterable[str] = (), *, is_scripted: bool = False
) -> dict[str, str]:
    """SHA-256 of each part of the source that decides what an episode is, by its name.

    Args:
        modules: Modules of tasks that are not of the benchmark, each of which is a part too.
        is_scripted: Whether the policy is one of the package, which is then a part too.
    """
    parts = (*SOURCES, *SCRIPTED) if is_scripted else SOURCES
    found = {part.removesuffix(".py"): part_hash(_PACKAGE, part) for part in parts}
    for name in modules:
        spec = find_spec(name)
        if spec is not None and spec.has_location and spec.origin is not None:
            found[name] = _digest(Path(spec.origin))
    return found


def part_hash(package: Path, part: str) -> str:
    """SHA-256 of a part of the source in a package's folder; a `DuoBenchError` if it is missing."""
    inside = {other for other in (*SOURCES, *SCRIPTED) if other.startswith(f"{part}/")}
    return _digest(package / part, frozenset(package / other for other in inside))


def package_source() -> str:
    """SHA-256 of all of the package's source and data."""
    return _digest(_PACKAGE)


@cache
def _digest(path: Path, without: frozenset[Path] = frozenset()) -> str:
    """SHA-256 of a file, or of all in a folder but for some folders in it, with their names."""
    if not path.exists():
        raise DuoBenchError(
            f"The package is not whole: {path} is missing. Install it again."
        )
    digest = hashlib.sha256()
    for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
        name = file.relative_to(path)
        is_hidden = any(
            part.startswith(".") for part in name.parts
        )  # as copies of a notebook
        is_other = not without.isdisjoint(file.parents)
        if file.is_file() and file.suffix in _KINDS and not is_hidden and not is_other:
            content = file.read_bytes()
            digest.update(f"{name.as_posix()}\n{len(content)}\n".encode())
            digest.update(content)
    return digest.hexdigest()


def record_versions(renderer: str | None) -> dict[str, str | None]:
    """Everything that a record notes about where it was made.

    The renderer is that of the policy's images; None for a policy that sees none.
    """
    return {
        **package_versions(),
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "processor": _about_processor("model name"),
        "renderer": renderer,
    }


def _about_processor(what: str) -> str | None:
    """Property of the first processor as Linux reports it; None where it is missing."""
    with suppress(OSError):
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
        found = re.search(rf"^{what}\s*:\s*(\S.*)$", text, re.MULTILINE)
        if found:
            return found[1].strip()
    return None


def differing_arithmetic(versions: Mapping[str, str | None]) -> list[str]:
    """Reasons why a replay here may differ in bits from an episode with those `record_versions`.

    One phrase a difference, such as "mujoco 4.0.0 instead of 4.0.1"; nothing if it must have them.
    """
    here = package_versions()
    found = [
        f"{name} {here[name]} instead of {versions.get(name)}"
        for name in _DECIDING
        if versions.get(name) != here[name]
    ]
    if not str(versions.get("platform")).endswith(_SAME_EVERYWHERE):
        found.append(f"not made on {_SAME_EVERYWHERE}")
    if platform.machine() != _SAME_EVERYWHERE or not has_avx2():
        found.append(f"this processor is no {_SAME_EVERYWHERE} with AVX2 and FMA")
    return found


def has_avx2() -> bool:
    """Whether Linux says that this processor has AVX2 and FMA."""
    return {"avx2", "fma"} <= set((_about_processor("flags") or "").split())
