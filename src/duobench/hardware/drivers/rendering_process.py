"""Images of a simulation from a process of its own: whoever leads arms does not wait for them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

import numpy as np

from duobench.errors import BackendError, DuoBenchError

if TYPE_CHECKING:
    import mujoco

    from duobench.backend import Image
    from duobench.hardware.rehearsal import Scene

FIRST_S = 60.0
"""Seconds that the first images of a model may take, on a processor that has other work too."""
END_S = 3.0
"""Seconds that the process has to end."""
_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from duobench.hardware.drivers.rendering_process import serve; serve(int(sys.argv[2]))"
)
_MODEL = "model.mjb"

Shapes = Mapping[str, tuple[int, int]]
"""Height and width of the image of each camera."""


class RenderingProcess:
    """Renders what it is told; one image at a time is asked for, from any thread."""

    def __init__(self) -> None:
        ours, theirs = Pipe()
        command = [sys.executable, "-c", _START, json.dumps(sys.path), str(theirs.fileno())]
        self._process = subprocess.Popen(command, pass_fds=(theirs.fileno(),))
        theirs.close()
        self._connection = ours
        self._lock = threading.Lock()
        self._model: mujoco.MjModel | None = None

    def images(self, scene: Scene, shapes: Shapes) -> dict[str, Image]:
        """An image of each of some cameras.

        Raises:
            BackendError: There is none; the process has ended, or cannot render.
        """
        try:
            with self._lock:
                is_new = scene.model is not self._model
                self._connection.send((_packed(scene.model) if is_new else None, scene[1:], shapes))
                self._model = scene.model
                if not self._connection.poll(FIRST_S):
                    raise BackendError(f"No image was rendered in {FIRST_S:g} s.")
                answer = self._connection.recv()
        except (OSError, EOFError) as error:
            raise BackendError("The process that renders images has ended.") from error
        if isinstance(answer, str):
            raise BackendError(f"Images cannot be rendered: {answer}")
        return answer

    def close(self) -> None:
        """End the process; twice is harmless."""
        self._connection.close()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def serve(descriptor: int) -> None:
    """Render what comes over a connection until it ends: the process itself."""
    import mujoco

    from duobench.sim.rendering import Renderer

    connection, renderers = Connection(descriptor), dict[tuple[int, int], Renderer]()
    model = data = None
    with suppress(EOFError, OSError, KeyboardInterrupt):
        while True:
            packed, moved, shapes = connection.recv()
            try:
                if packed is not None:
                    for renderer in renderers.values():
                        renderer.close()
                    renderers.clear()
                    model = mujoco.MjModel.from_binary_path(_MODEL, {_MODEL: packed})
                    data = mujoco.MjData(model)
                assert model is not None
                assert data is not None
                data.qpos[:], data.mocap_pos[:], data.mocap_quat[:], model.geom_rgba[:] = moved
                connection.send(_rendered(model, data, renderers, shapes))
            except DuoBenchError as error:
                connection.send(str(error))
    os._exit(0)  # drivers have crashed while a process that had rendered was taken down


def _rendered(
    model: mujoco.MjModel, data: mujoco.MjData, renderers: dict[Any, Any], shapes: Shapes
) -> dict[str, Image]:
    import mujoco

    from duobench.sim.rendering import Renderer

    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    images: dict[str, Image] = {}
    for shape in set(shapes.values()):
        if shape not in renderers:
            renderers[shape] = Renderer(model, height=shape[0], width=shape[1])
        names = [name for name, each in shapes.items() if each == shape]
        images |= renderers[shape].render_all(data, names)
    return images


def _packed(model: mujoco.MjModel) -> bytes:
    import mujoco

    content = np.empty(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return content.tobytes()
