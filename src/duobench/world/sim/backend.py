"""The simulated robot behind the same interface as the real one."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from duobench.core.backend import (
    RGB,
    SEGMENTATION,
    AnyCamera,
    CameraGeometry,
    DuoLimits,
    Image,
    Sizes,
    Wanted,
)
from duobench.core.spatial import SE3, rotation_by
from duobench.core.types import CONTROL_HZ, Array, DuoCommand, DuoState
from duobench.world.looks.look import Look
from duobench.world.objects.segmentation import segmentation_ids
from duobench.world.robot.camera_geometry import geometries
from duobench.world.robot.frames import Robot
from duobench.world.robot.joints import RANGE_MARGIN, SERVO_LAG, duo_limits
from duobench.world.sim.appearance import Appearance
from duobench.world.sim.rendering import Renderer
from duobench.world.sim.segmentation import labels_of
from duobench.world.sim.simulation import Simulation


class SimBackend:
    """A `DuoBackend` over a simulation, of which nothing breaks and no image grows old.

    Args:
        simulation: The simulation.
        speed_fraction: Part of the joints' speed limits that the arms use; below 1 they keep
            the limits of real arms.
    """

    def __init__(self, simulation: Simulation, speed_fraction: float = 1.0) -> None:
        self.simulation = simulation
        slower = duo_limits((speed_fraction, speed_fraction), RANGE_MARGIN, SERVO_LAG)
        self._slower = None if speed_fraction == 1.0 else slower
        self._held: str | None = None
        self._look = Look()
        self._labels: NDArray[np.int32] | None = None
        self._renderers: dict[tuple[int, int], Renderer] = {}
        self.rendering_s = 0.0
        """Seconds that rendering has taken so far."""

    def start(self) -> None:
        """Do nothing: simulated time stands still between commands."""

    def stop(self) -> None:
        """Do nothing: simulated time stands still between commands."""

    def home(self) -> None:
        """Reset the simulation to time zero, with the arms at home and the grippers open."""
        self._held = None
        self.simulation.reset_data()
        self.simulation.forward()

    def hold(self, reason: str) -> None:
        """Hold both arms at the last command until `home`."""
        self._held = self._held or reason

    @property
    def held(self) -> str | None:
        """Reason why the arms are held; None while they follow commands."""
        return self._held

    def health(self) -> None:
        """Return nothing: only the physics of a simulation can fail, and `command` raises that."""

    def image_ages(self) -> dict[str, float]:
        """Return no ages: images are rendered on demand."""
        return {}

    @property
    def robot(self) -> Robot:
        """Description of the arms."""
        return self.simulation.robot

    @property
    def limits(self) -> DuoLimits:
        """Limits of the arms."""
        return self.simulation.duo.limits

    @property
    def last_command(self) -> DuoCommand:
        """The last command, as the actuators hold it."""
        return self.simulation.duo.command()

    @property
    def time(self) -> float:
        """Simulated seconds since the objects came to rest at the reset."""
        return self.simulation.data.time

    def read(self) -> DuoState:
        """State after the last physics step."""
        return self.simulation.duo.read()

    def joint_velocities(self) -> Array:
        """Joint velocities (2, 7) in rad/s after the last physics step."""
        return self.simulation.duo.joint_velocities()

    def command(self, command: DuoCommand) -> DuoCommand:
        """Advance one control step towards a command, limited where the arms keep slower limits.

        While the arms are held, they stay at the last one. Between the steps in which grippers
        take a target they keep theirs, though another one was sent.
        """
        if self._held is not None:
            command = self.last_command
        elif self._slower is not None:
            duo = self.simulation.duo
            command = DuoCommand.from_flat(duo.clipped(command.flat, self._slower))
        openings = command.openings
        if not self.robot.gripper.takes_target(round(self.time * CONTROL_HZ)):
            openings = self.last_command.openings
        self.simulation.advance(DuoCommand(joints=command.joints, openings=openings))
        return command

    @property
    def look(self) -> Look:
        """Look of the images."""
        return self._look

    def set_look(self, look: Look) -> None:
        """Give images in another look from now on; physics and model stay as they are."""
        if look == self._look:
            return
        Appearance(
            self.simulation.model, look
        )  # rejects it before anything has changed
        self._look = look

    def images(
        self, cameras: Sequence[str | AnyCamera], shape: tuple[int, int]
    ) -> dict[str, Image]:
        """Render the current state; see `DuoBackend.images`."""
        return self.images_by_kind({RGB: dict.fromkeys(cameras, shape)}).get(RGB, {})

    def images_by_kind(self, wanted: Wanted) -> dict[str, dict[str, Any]]:
        """Render the current state; see `DuoBackend.images_by_kind`."""
        start = time.perf_counter()
        sizes = [size for each in wanted.values() for size in each.values()]
        if not sizes:
            return {}
        shape = max(h for h, _ in sizes), max(w for _, w in sizes)
        if shape not in self._renderers:
            height, width = shape
            self._renderers[shape] = Renderer(
                self.simulation.model, height=height, width=width
            )
        renderer = self._renderers[shape]
        renderer.set_look(self._look)
        images = renderer.render_kinds(self.simulation.data, wanted)
        if SEGMENTATION in images:
            if self._labels is None:
                ids = segmentation_ids(self.simulation.props.values())
                self._labels = labels_of(self.simulation.model, ids)
            geoms = images[SEGMENTATION]
            images[SEGMENTATION] = {
                name: self._labels[each] for name, each in geoms.items()
            }
        self.rendering_s += time.perf_counter() - start
        return images

    def camera_geometry(self, sizes: Sizes) -> dict[str, CameraGeometry]:
        """Lens and present place of some cameras, where the look has them; by name."""
        offsets = {
            name: (
                SE3(rotation_by(offset.rotation), np.array(offset.position)),
                offset.field_of_view,
            )
            for name, offset in self._look.cameras.items()
        }
        return geometries(sizes, self.read().tcp_poses, self.robot.gripper, offsets)

    def close(self) -> None:
        """Free the renderers."""
        for renderer in self._renderers.values():
            renderer.close()
