"""Height of each tool above the surface below it, as the page draws it."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from duobench.core.types import SIDES, Side
from duobench.world.scene.naming import tcp_name
from duobench.world.sim.simulation import Simulation

_DOWN = np.array([0.0, 0.0, -1.0])
_PAST = 1e-5
"""Metres by which a ray goes on behind a surface that does not count."""


class PlumbLines:
    """A line from each tool straight down to what lies below it.

    It passes through the tool's own arm and through what its fingers hold. While they hold
    something, the line begins at the height of the lowest point of that, and its length says how
    far the tool may be lowered.

    Args:
        sim: The simulation, whose kinematics are up to date whenever it is asked.
        has_objects: Whether its objects are where they really are; without, all lines end at what
            stands still.
    """

    def __init__(
        self,
        sim: Simulation,
        *,
        has_objects: bool = True,
    ) -> None:
        self._sim = sim
        model = sim.model
        owners = [model.body(body).name for body in model.geom_bodyid]
        self._own = {
            side: {
                geom for geom, name in enumerate(owners) if name.startswith(f"{side}/")
            }
            for side in SIDES
        }
        self._props = {
            prop: {
                geom
                for geom, name in enumerate(owners)
                if name.partition("/")[0] == prop
            }
            for prop in sim.props
        }
        self._rigid = {
            name: [
                name,
                *(prop.part_name(part.name) for part in prop.parts if not part.hinge),
            ]
            for name, prop in sim.props.items()
            if not prop.fixed
        }
        self._ignored: set[int] = set()
        if not has_objects:
            self._ignored = set().union(*self._props.values())
        self._tools = {side: model.site(tcp_name(side)).id for side in SIDES}
        self._hit = np.zeros(1, dtype=np.int32)

    def rows(self) -> NDArray[np.float32]:
        """Return, by side, the tool (x, y, z), the beginning of its line (x, y, z), and its length.

        Metres, in the table frame; a line that meets nothing has the length NaN.
        """
        return np.array([self._row(side) for side in SIDES], dtype=np.float32)

    def _row(self, side: Side) -> list[float]:
        """Tool, beginning of its line, and length of it, of one side."""
        x, y, z = self._sim.data.site_xpos[self._tools[side]].tolist()
        held = self._held(side)
        ignored = self._own[side] | self._ignored
        start = z
        for prop in held:
            ignored |= self._props[prop]
            start = min(start, float(self._sim.min_height(prop)))
        below = self._below((x, y, z), ignored)
        return [x, y, z, x, y, max(start, below), max(start - below, 0.0)]

    def _held(self, side: Side) -> list[str]:
        """The free props that a gripper holds, at any part that does not turn on them."""
        if self._ignored:
            return []
        return [
            name
            for name, bodies in self._rigid.items()
            if any(self._sim.contacts.grasped(side, body) for body in bodies)
        ]

    def _below(
        self,
        tool: tuple[float, float, float],
        ignored: set[int],
    ) -> float:
        """Height of the first surface below a tool that counts; NaN where there is none."""
        point = np.array(tool)
        for _ in range(self._sim.model.ngeom):
            distance = mujoco.mj_ray(
                self._sim.model, self._sim.data, point, _DOWN, None, True, -1, self._hit
            )
            if distance < 0.0:
                break
            point[2] -= distance
            if int(self._hit[0]) not in ignored:
                return float(point[2])
            point[2] -= _PAST
        return float("nan")
