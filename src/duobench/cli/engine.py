"""Loading MuJoCo, which opens the OpenGL library that `MUJOCO_GL` names while it is imported."""

from __future__ import annotations

import os
from importlib import import_module

from duobench.errors import RenderingError

_ASKED = "MUJOCO_GL"


def load_engine() -> None:
    """Import MuJoCo.

    Raises:
        RenderingError: `MUJOCO_GL` names something that MuJoCo does not know or cannot load.
    """
    try:
        import_module("mujoco")
    except (RuntimeError, AttributeError, ImportError, OSError) as error:
        asked = os.environ.get(_ASKED)
        if not asked:
            raise
        raise RenderingError(
            f"MuJoCo cannot load what {_ASKED}={asked} stands for ({error}). Set {_ASKED} to egl, "
            "osmesa or glfw, whichever is installed, or unset it: then one that works is found."
        ) from error
