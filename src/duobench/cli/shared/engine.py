"""Loading MuJoCo, whose import opens an OpenGL library."""

from __future__ import annotations

import os
from importlib import import_module

from duobench.errors import RenderingError

ASKED = "MUJOCO_GL"
"""Environment variable that names an OpenGL library."""


def load_engine() -> None:
    """Import MuJoCo, which opens the OpenGL library that `MUJOCO_GL` names.

    Raises:
        RenderingError: `MUJOCO_GL` names something that MuJoCo does not know or cannot load.
    """
    try:
        import_module("mujoco")
    except (RuntimeError, AttributeError, ImportError, OSError) as error:
        asked = os.environ.get(ASKED)
        if not asked:
            raise
        raise RenderingError(
            f"MuJoCo cannot load what {ASKED}={asked} stands for ({error}). Set {ASKED} to egl, "
            "osmesa or glfw, whichever is installed, or unset it: then one that works is found."
        ) from error
