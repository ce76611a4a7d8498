"""Arms, grippers and cameras of a rehearsal: the drivers' protocols over one simulated world."""

import copy
import threading
from typing import Any

import mujoco

from duobench.core.backend import (
    DEPTH,
    RGB,
    Image,
    Sizes,
)
from duobench.core.errors import BackendError, RenderingError, check_known
from duobench.core.types import SIDES, Array, Side
from duobench.real.clock import (
    Clock,
    SystemClock,
    Ticker,
    VirtualClock,
)
from duobench.real.devices import ArmReading, Depth, Device
from duobench.real.drivers.frames import TickedCamera
from duobench.real.rehearsal import RELEASE, RehearsalWorld, gripper_driver
from duobench.real.rig import ArmConfig, CameraConfig, GripperConfig
from duobench.world.robot.frames import Robot
from duobench.world.sim.rendering import Renderer

RENDER_S = 0.1
"""Seconds from one rendering of all cameras to the next."""


class RehearsalArm:
    """The arm of the world that stands on the mount which the rig's address names."""

    def __init__(
        self,
        config: ArmConfig,
        clock: Clock,
        world: RehearsalWorld,
    ) -> None:
        self._config = config
        self._clock = clock
        self._world = world
        self.mount = _side(config.address, "address")
        """The mount on which it stands."""
        self._arm = world.arms[self.mount]

    def connect(self) -> None:
        """Reach the arm."""
        self._world.set_gains(self.mount, self._config)
        self._world.enter(self)

    def close(self) -> None:
        """Stop."""
        self.stop()
        self._world.leave(self)

    def read(self) -> ArmReading:
        """The latest physics step, which is as new as a reading can be."""
        arm = self._arm
        return ArmReading(
            time_s=self._clock.now(),
            joints=arm.joints.copy(),
            velocities=arm.velocities.copy(),
            torques=arm.torques.copy(),
            is_tracking=arm.is_tracking,
            fault=arm.fault,
            state={
                "q": arm.joints.copy(),
                "dq": arm.velocities.copy(),
                "tau_J": arm.torques.copy(),
                "tau_ext_hat_filtered": arm.external.copy(),
                "O_F_ext_hat_K": arm.wrench.copy(),
            },
        )

    def start(self) -> None:
        """Hold the measured joints and follow commands."""
        if self._arm.fault is not None:
            raise BackendError(f"The arm cannot start: {self._arm.fault.text}")
        with self._world.lock:
            self._arm.stop()
            self._arm.is_tracking = True

    def command(self, joints: Array, velocities: Array) -> None:
        """Track a point of a path; nothing is said if it cannot, as with the real one."""
        if self._arm.is_tracking:
            self._arm.target, self._arm.speed = joints.copy(), velocities.copy()

    def stop(self) -> None:
        """Come to rest where it is."""
        with self._world.lock:
            self._arm.stop()

    def recover(self) -> None:
        """Clear a fault; not while the emergency stop is pressed."""
        if self._world.is_stopped:
            raise BackendError(RELEASE)
        self._arm.fault = None


class RehearsalViews:
    """Images of all cameras of the world, ten times a second, by a process of its own."""

    def __init__(self, clock: Clock, world: RehearsalWorld) -> None:
        self._clock, self._world = clock, world
        self._shapes: dict[str, tuple[int, int]] = {}
        self._with_depth: set[str] = set()
        self._lock = threading.Lock()
        self._scene: tuple[Any, mujoco.MjModel, mujoco.MjData] | None = None
        self._renderers: dict[tuple[int, int], Renderer] = {}
        self._ticker: Ticker | None = None
        self._newest: dict[str, dict[str, Any]] = {}
        self._trouble = ""

    def add(self, name: str, config: CameraConfig) -> None:
        """Render a camera from now on, with its depth if it has any.

        Raises:
            BackendError: Nothing renders here.
        """
        self._world.enter(self)
        self._shapes[name] = config.size
        if config.depth:
            self._with_depth.add(name)
        self._render()
        self._world.look_again = self._tick
        if self._ticker is None:
            # In virtual time images are those of their moments; people's arms wait for none.
            is_virtual = type(self._clock) is VirtualClock
            clock = self._clock if is_virtual else SystemClock()
            self._ticker = clock.every(RENDER_S, self._tick, "rendering")

    def remove(self, name: str) -> None:
        """Render a camera no more."""
        self._shapes.pop(name, None)
        if self._shapes or self._scene is None:
            return
        if self._ticker is not None:
            self._ticker.stop()
        self._forget()
        self._ticker = None
        self._world.look_again = lambda: None
        self._world.leave(self)

    def seen(self, name: str) -> tuple[Image, Depth | None]:
        """The newest image of a camera, and its depth.

        Raises:
            BackendError: Nothing renders any more.
        """
        if self._trouble:
            raise BackendError(self._trouble)
        newest = self._newest
        return newest[RGB][name], newest[DEPTH].get(name)

    def _tick(self) -> None:
        try:
            self._render()
        except BackendError as error:
            self._trouble = str(error)

    def _render(self) -> None:
        original, moved = self._world.scene()
        with self._lock:
            if self._scene is None or original is not self._scene[0]:
                self._forget()
                model = copy.copy(original)
                self._scene = original, model, mujoco.MjData(model)
            _, model, data = self._scene
            data.qpos[:], data.mocap_pos[:], data.mocap_quat[:], model.geom_rgba[:] = (
                moved
            )
            for bring_up_to_date in (
                mujoco.mj_kinematics,
                mujoco.mj_comPos,
                mujoco.mj_camlight,
            ):
                bring_up_to_date(model, data)
            newest: dict[str, dict[str, Any]] = {RGB: {}, DEPTH: {}}
            for shape in set(self._shapes.values()):
                if shape not in self._renderers:
                    self._renderers[shape] = Renderer(
                        model, height=shape[0], width=shape[1]
                    )
                names = [name for name, each in self._shapes.items() if each == shape]
                deep = [name for name in names if name in self._with_depth]
                wanted: dict[str, Sizes] = {
                    RGB: {**dict.fromkeys(names, shape)},
                    DEPTH: {**dict.fromkeys(deep, shape)},
                }
                try:
                    images = self._renderers[shape].render_kinds(data, wanted)
                except RenderingError as error:
                    raise BackendError(f"Images cannot be rendered: {error}") from error
                for kind, of_kind in images.items():
                    newest[kind] |= of_kind
            self._newest = newest
        self._trouble = ""

    def _forget(self) -> None:
        """Free what renders."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers, self._scene = {}, None


class RehearsalCamera(TickedCamera):
    """Gives the newest image of the world at the rate of the rig.

    Images are rendered ten times a second, so that each comes several times, as new: what is asked
    of the age of real images is asked of these too, and a slow computer loses no trial by them.
    """

    def __init__(
        self, config: CameraConfig, clock: Clock, name: str, views: RehearsalViews
    ) -> None:
        super().__init__(config, clock, name)
        self._views = views
        self._latest_depth: Depth | None = None

    def connect(self) -> None:
        """Begin to take images."""
        if self._ticker is None:
            self._views.add(self.name, self.config)
        super().connect()

    def close(self) -> None:
        """Take no more images."""
        super().close()
        self._views.remove(self.name)

    def _image(self, index: int) -> Image:  # noqa: ARG002 - the number does not matter
        image, self._latest_depth = self._views.seen(self.name)
        return image

    def _depth(self) -> Depth | None:
        return self._latest_depth


class Rehearsal:
    """Makes the devices of a rig that share one world."""

    def __init__(self, clock: Clock, robot: Robot) -> None:
        self._clock = clock
        self.world = RehearsalWorld(clock, robot)
        """World that the devices act on."""
        self._views = RehearsalViews(clock, self.world)

    def device(
        self, config: ArmConfig | GripperConfig | CameraConfig, name: str
    ) -> Device:
        """The arm on the mount that an address names, a gripper, or the camera of a name.

        A gripper is the driver of real ones, at the imitation of the one that a port names.
        """
        if isinstance(config, ArmConfig):
            return RehearsalArm(config, self._clock, self.world)
        if isinstance(config, GripperConfig):
            side = _side(config.port, "port")
            driver = gripper_driver(self.world.robot)
            return driver.rehearse(config, self._clock, self.world, side)
        return RehearsalCamera(config, self._clock, name, self._views)


def _side(given: str, field: str) -> Side:
    check_known(f"{field} of a rehearsal", given, SIDES)
    return Side(given)
