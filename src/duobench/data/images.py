"""Images of recorded states, and the numbers of their objects."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from duobench.backend import Image
from duobench.data.recording import Recording
from duobench.envs.config import IMAGE_SIZE
from duobench.errors import DataError, DuoBenchError
from duobench.looks.catalog import DEFAULT, as_look
from duobench.looks.look import Look
from duobench.sim.backend import SimBackend
from duobench.sim.layout import Layout
from duobench.sim.simulation import Simulation
from duobench.tasks import catalog
from duobench.tasks.object_state import ObjectState
from duobench.tasks.task import Task
from duobench.types import POLICY_CAMERAS


class ImageSource:
    """Shows recorded states of one task: as images, and as the numbers of its objects.

    Args:
        task: The task, its id, or its import path.
        cameras: Which cameras to render.
        size: Height and width of the images in pixels.
        look: How the images look, whatever they looked like while recording.

    Raises:
        UnknownNameError: There is no such task or look.
    """

    def __init__(
        self,
        task: str | Task,
        *,
        cameras: Sequence[str] = POLICY_CAMERAS,
        size: tuple[int, int] = IMAGE_SIZE,
        look: str | Look = DEFAULT,
    ) -> None:
        definition = catalog.get(task)
        self.object_state: ObjectState = definition.object_state
        self.simulation = Simulation(definition.props, definition.overview)
        """The physics, in the state that was shown last."""
        self._backend = SimBackend(self.simulation)
        self._backend.set_look(as_look(look))
        self._cameras, self._size = tuple(cameras), size
        self._layout: dict[str, Any] | None = None

    def show(self, recording: Recording, row: int) -> None:
        """Bring the simulation into the state of a row of a recording.

        Raises:
            DataError: The state does not fit the task.
        """
        try:
            if recording.info.layout != self._layout:
                self._layout = None
                self.simulation.apply(Layout.from_json(recording.info.layout))
                self._layout = recording.info.layout
            self.simulation.set_state(recording.state[row])
        except DuoBenchError as error:
            raise DataError(
                f"Row {row} of an episode of {recording.info.task} cannot be shown: {error}"
            ) from error

    def images(self, recording: Recording, row: int) -> dict[str, Image]:
        """Images (height, width, 3) of a row by camera, as the environment gave them.

        Raises:
            DataError: The state does not fit the task.
            RenderingError: Nothing can be rendered.
        """
        self.show(recording, row)
        return self._backend.images(self._cameras, self._size)

    def objects(self, recording: Recording, row: int) -> NDArray[np.float32]:
        """The numbers (n,) of `object_state` at a row, as the environment gave them on request.

        Raises:
            DataError: The state does not fit the task.
        """
        self.show(recording, row)
        return self.object_state.read(self.simulation)

    def close(self) -> None:
        """Free the renderer."""
        self._backend.close()
