"""The version of this package, and those of what a score depends on, of which nothing is loaded."""

from __future__ import annotations

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

    Args:
        renderer: What renders the policy's images; None for a policy that sees none.
    """
    return {
        **package_versions(),
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "processor": processor(),
        "renderer": renderer,
    }


def processor() -> str | None:
    """Model of the processor, as Linux names it; None if it has no name."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    named = re.search(r"^model name\s*:\s*(\S.*)$", text, re.MULTILINE)
    return named[1].strip() if named else None


def differing_arithmetic(versions: Mapping[str, str | None]) -> list[str]:
    """Why a replay in this process need not have the bits of an episode; nothing if it must.

    Args:
        versions: What `record_versions` noted about the episode.

    Returns:
        One phrase a difference: "mujoco 4.0.0 instead of 4.0.1".
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
    with suppress(OSError):
        flags = re.search(r"^flags\s*:(.*)", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
        return flags is not None and {"avx2", "fma"} <= set(flags[1].split())
    return False
