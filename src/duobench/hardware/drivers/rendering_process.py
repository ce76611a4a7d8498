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
    from duobench.backend import Image
    from duobench.hardware.rehearsal import RehearsalWorld

ANSWER_S = 60.0
"""Seconds that images may take: the first of a model, on a processor that has other work too."""
END_S = 3.0
"""Seconds that the process has to end."""
_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from duobench.hardware.drivers.rendering_process import serve; serve(int(sys.argv[2]))"
)
_MODEL = "model.mjb"


class RenderingProcess:
    """Renders what a world looks like, for any thread."""

    def __init__(self) -> None:
        self._connection, theirs = Pipe()
        command = [sys.executable, "-c", _START, json.dumps(sys.path), str(theirs.fileno())]
        # In a session of its own: Ctrl-C is for the one who leads the arms.
        self.process = subprocess.Popen(
            command, pass_fds=(theirs.fileno(),), start_new_session=True
        )
        theirs.close()
        self._lock = threading.Lock()
        self._model: Any = None

    def images(
        self, world: RehearsalWorld, shapes: Mapping[str, tuple[int, int]]
    ) -> dict[str, Image]:
        """The image of each camera, whose height and width are given.

        Raises:
            BackendError: There is none; the process has ended, or cannot render.
        """
        import mujoco

        try:
            with self._lock:
                model, moved = world.scene()
                packed = None
                if model is not self._model:
                    packed = np.empty(mujoco.mj_sizeModel(model), dtype=np.uint8)
                    mujoco.mj_saveModel(model, None, packed)
                self._connection.send((packed, moved, dict(shapes)))
                self._model = model
                if not self._connection.poll(ANSWER_S):
                    self.process.kill()  # a late answer would be taken for a later one
                    raise BackendError(f"No image was rendered in {ANSWER_S:g} s.")
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
            self.process.wait(END_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


def serve(descriptor: int) -> None:
    """Render what comes over a connection until it ends: the process itself."""
    connection, scene = Connection(descriptor), _Scene()
    with suppress(EOFError, OSError, KeyboardInterrupt):
        while True:
            asked = connection.recv()
            try:
                connection.send(scene.images(*asked))
            except DuoBenchError as error:
                connection.send(str(error))
    os._exit(0)  # drivers have crashed while a process that had rendered was taken down


class _Scene:
    """The scene in the process that renders it."""

    def __init__(self) -> None:
        self._model: Any = None
        self._data: Any = None
        self._renderers: dict[tuple[int, int], Any] = {}

    def images(self, packed: Any, moved: Any, shapes: dict[str, Any]) -> dict[str, Image]:
        import mujoco

        from duobench.sim.rendering import Renderer

        if packed is not None:
            for renderer in self._renderers.values():
                renderer.close()
            self._renderers = {}
            self._model = mujoco.MjModel.from_binary_path(_MODEL, {_MODEL: packed.tobytes()})
            self._data = mujoco.MjData(self._model)
        model, data = self._model, self._data
        data.qpos[:], data.mocap_pos[:], data.mocap_quat[:], model.geom_rgba[:] = moved
        for bring_up_to_date in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_camlight):
            bring_up_to_date(model, data)
        images: dict[str, Image] = {}
        for shape in set(shapes.values()):
            if shape not in self._renderers:
                self._renderers[shape] = Renderer(model, height=shape[0], width=shape[1])
            names = [name for name, each in shapes.items() if each == shape]
            images |= self._renderers[shape].render_all(data, names)
        return images
