"""Poses and speeds for stages: of one simulation, or of many of the same model at once.

A number is a float in one simulation, and an array (n,) in a batch of n. Everything here is plain
arithmetic on such numbers, so that both give the same answers.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from duobench.core.errors import Named
from duobench.core.spatial import hypot
from duobench.core.types import SIDES, Array, Side
from duobench.world.objects.prop import Prop
from duobench.world.objects.solid import corner_points
from duobench.world.scene.naming import tcp_name
from duobench.world.sim.contacts import HingeAxis

if TYPE_CHECKING:
    import mujoco


CLEARLY = 1e-9
"""Difference of two heights in metres that no rounding makes up for."""


class Questions(ABC):
    """The questions; a subclass has the engine's arrays, and says how a row is read."""

    def __init__(
        self, props: Mapping[str, Prop], model: mujoco.MjModel, data: Any
    ) -> None:
        """Resolve names into ids, and look at the engine's data, of one simulation or of many."""
        from mujoco import mjtJoint

        # Views of the engine's memory; they live as long as its data.
        self._xpos = data.xpos
        self._xmat = data.xmat
        self._qpos = data.qpos
        self._qvel = data.qvel
        self._xanchor, self._xaxis = data.xanchor, data.xaxis
        self._xipos, self._site_xpos = data.xipos, data.site_xpos
        self._tools = {side: int(model.site(tcp_name(side)).id) for side in SIDES}
        self.props: Mapping[str, Prop] = Named("object", props)
        bodies = ((model.body(number).name, number) for number in range(model.nbody))
        self._bodies = Named("body", bodies)
        self._corners = {
            name: np.ascontiguousarray(corner_points(prop.solid).T)
            for name, prop in props.items()
        }
        """Points (3, n) of each prop in its own frame, one of which is its lowest."""
        self._dofs = {
            name: int(model.joint(name).dofadr[0])
            for name, prop in props.items()
            if not prop.fixed
        }
        # Id of each hinge, and where its angle is in `qpos`.
        joints = map(model.joint, range(model.njnt))
        hinges = (joint for joint in joints if joint.type[0] == mjtJoint.mjJNT_HINGE)
        places = ((hinge.name, (hinge.id, int(hinge.qposadr[0]))) for hinge in hinges)
        self._hinges = Named("hinge", places)

    def ask(self, question: Callable[[Any], Any], *, vectorized: bool) -> Any:  # noqa: ARG002
        """Value of a function of a simulation; `vectorized` says whether it takes many."""
        return question(self)

    @abstractmethod
    def _numbers(self, array: Array, row: int | slice) -> Any:
        """The numbers in a row of one of the engine's arrays."""

    @abstractmethod
    def _number(self, array: Array, place: int) -> Any:
        """The number at a place of one of the engine's flat arrays."""

    @abstractmethod
    def _lowest(
        self,
        prop: str,
        x: Any,
        y: Any,
        z: Any,
    ) -> Any:
        """Height of a prop's lowest corner above its origin; the vertical is in its own frame."""

    def body_id(self, name: str) -> int:
        """Id of a body."""
        return self._bodies[name]

    def origin(self, body: str) -> Sequence[Any]:
        """Origin of a body in the table frame, in metres: x, y, z."""
        return self._numbers(self._xpos, self._bodies[body])

    def axes(self, body: str) -> Sequence[Any]:
        """The nine numbers of a body's rotation matrix in the table frame, row by row."""
        return self._numbers(self._xmat, self._bodies[body])

    def reach(self, arm: Side, body: str) -> Any:
        """Distance in metres from an arm's tool centre point to a body's centre of mass."""
        tool = self._numbers(self._site_xpos, self._tools[arm])
        centre = self._numbers(self._xipos, self.body_id(body))
        return hypot(*(a - b for a, b in zip(tool, centre, strict=True)))

    def turned(self, body: str, vector: Sequence[float]) -> tuple[Any, Any, Any]:
        """A vector of a body's frame in the table frame."""
        u, v, w = vector
        xx, xy, xz, yx, yy, yz, zx, zy, zz = self.axes(body)
        return (
            xx * u + xy * v + xz * w,
            yx * u + yy * v + yz * w,
            zx * u + zy * v + zz * w,
        )

    def relative_position(self, body: str, frame: str) -> tuple[Any, Any, Any]:
        """Origin of a body in the frame of another body, in metres."""
        rows, numbers = self._bodies, self._numbers
        x, y, z = numbers(self._xpos, rows[body])
        ox, oy, oz = numbers(self._xpos, rows[frame])
        xx, xy, xz, yx, yy, yz, zx, zy, zz = numbers(self._xmat, rows[frame])
        x, y, z = x - ox, y - oy, z - oz
        return (
            xx * x + yx * y + zx * z,
            xy * x + yy * y + zy * z,
            xz * x + yz * y + zz * z,
        )

    def speed(self, prop: str) -> tuple[Any, Any]:
        """Linear (m/s) and angular (rad/s) speed of a free prop; zero for a fixed one."""
        x, y, z, wx, wy, wz = self._velocity(prop)
        return hypot(x, y, z), hypot(wx, wy, wz)

    def velocity(self, prop: str) -> Sequence[Any]:
        """Velocity in m/s of a prop's origin in the table frame: x, y, z."""
        return self._velocity(prop)[:3]

    def relative_speed(self, prop: str, frame: str) -> Any:
        """Speed in m/s of a prop's origin, in the frame of another prop that may move."""
        px, py, pz = self.relative_position(prop, frame)
        x, y, z = self._velocity(prop)[:3]
        ox, oy, oz, wx, wy, wz = self._velocity(frame)
        x, y, z = x - ox, y - oy, z - oz
        xx, xy, xz, yx, yy, yz, zx, zy, zz = self.axes(frame)
        return hypot(
            xx * x + yx * y + zx * z - (wy * pz - wz * py),
            xy * x + yy * y + zy * z - (wz * px - wx * pz),
            xz * x + yz * y + zz * z - (wx * py - wy * px),
        )

    def _velocity(self, prop: str) -> Sequence[Any]:
        """Linear velocity in the table frame and angular velocity in the prop's own, 3 each."""
        if self.props[prop].fixed:
            return [0.0] * 6
        start = self._dofs[prop]
        return self._numbers(self._qvel, slice(start, start + 6))

    def angle(self, hinge: str) -> Any:
        """Angle of a hinge in radians."""
        return self._number(self._qpos, self._hinges[hinge][1])

    def hinge_axis(self, hinge: str) -> HingeAxis:
        """Axis of a hinge now, in the table frame."""
        joint, _ = self._hinges[hinge]
        return HingeAxis(
            self._numbers(self._xanchor, joint), self._numbers(self._xaxis, joint)
        )

    def min_height(self, prop: str) -> Any:
        """Height of the lowest point of a prop's root part above the table top, in metres."""
        x, y, z = self.axes(self.props[prop].name)[
            6:
        ]  # the vertical in the prop's frame
        return self._lowest(prop, x, y, z) + self.origin(prop)[2]

    def height_bounds(self, prop: str) -> tuple[float, float] | None:  # noqa: ARG002
        """Two numbers between which `min_height` is, up to `CLEARLY`, where they are cheap."""
        return None
