"""How this package is installed: what messages and pages tell people to type.

The name on the package index is not that of the import: `duobench` there is the package of the
paper's authors.
"""

from __future__ import annotations

import sys

DISTRIBUTION = "duobench-fr3"
"""What pip calls this package."""
OPENGL_PACKAGES = "libegl1 libopengl0 libgl1 libgl1-mesa-dri"
"""Packages of Debian and Ubuntu with which EGL renders offscreen, on a processor too."""
OSMESA_PACKAGES = "libosmesa6"
"""The same for OSMesa, which always renders on the processor."""
FIRST_PYTHON = {"lerobot": (3, 12)}
"""The oldest Python that can have an extra, where it is not that of the package."""


def install_extra(extra: str) -> str:
    """The sentence that says how to install an extra in the Python that is running.

    Args:
        extra: Its name, such as "serve".
    """
    first = FIRST_PYTHON.get(extra, (0, 0))
    if sys.version_info[:2] < first:
        running = f"{sys.version_info.major}.{sys.version_info.minor}"
        return (
            f"This is Python {running}, and the extra {extra} needs Python {first[0]}.{first[1]} "
            f"or newer; there: pip install '{DISTRIBUTION}[{extra}]'."
        )
    return f"Install it: pip install '{DISTRIBUTION}[{extra}]'."
