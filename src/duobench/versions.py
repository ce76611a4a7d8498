"""The version of this package, and those of what a score depends on, of which nothing is loaded."""

from __future__ import annotations

import platform
import re
from pathlib import Path

__version__ = "1.0.0rc1"
"""Version of the software; a build reads it from this line."""
_PACKAGES = ("mujoco", "numpy", "mink")
"""The engine, the arithmetic, and the inverse kinematics."""


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
