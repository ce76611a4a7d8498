"""The version of this package, and those of what a score depends on, of which nothing is loaded."""

import platform
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

__version__ = "1.0.0rc1"
"""Version of the software; a build reads it from this line."""
_PACKAGES = ("mujoco", "numpy", "mink")
"""The engine, the arithmetic, and the inverse kinematics."""
_DECIDING = ("mujoco", "numpy")
"""What decides the bits of a replay of joint targets."""
_SAME_EVERYWHERE = "x86_64"
"""The architecture whose processors with AVX2 give the same bits."""


def package_versions() -> dict[str, str]:
    """Versions that must not change within a run: the benchmark's and those of its engine."""
    from importlib.metadata import version  # half of the time of `import duobench`

    return {"duobench": __version__, **{name: version(name) for name in _PACKAGES}}


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
    """What Linux says about the first processor; None where it says nothing."""
    with suppress(OSError):
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
        if found := re.search(rf"^{what}\s*:\s*(\S.*)$", text, re.MULTILINE):
            return found[1].strip()
    return None


def differing_arithmetic(versions: Mapping[str, str | None]) -> list[str]:
    """Why a replay here need not have the bits of an episode with those `record_versions`.

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
