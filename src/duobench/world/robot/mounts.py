"""How two arms are mounted: the poses of their bases, and where they are at home.

Another mounting is another row of `MOUNTS`; the block that carries the bases follows from their
poses.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from duobench.core.spatial import SE3
from duobench.core.types import Array, Side


@dataclass(
    frozen=True,
    kw_only=True,
    slots=True,
    eq=False,
)
class Mount:
    """A mounting of both arms."""

    name: str
    bases: Mapping[Side, SE3]
    """Pose of each arm's base in the table frame."""
    home: Array
    """Home configuration (2, 7) in radians, left then right."""


_LEFT_HOME = (
    0.48797692,
    -0.57224476,
    -0.58536988,
    -2.57958827,
    0.86400183,
    2.0530809,
    -0.85965005,
)
HOME_JOINTS = np.array([_LEFT_HOME, np.multiply(_LEFT_HOME, (-1, 1, -1, 1, -1, 1, -1))])
"""Home configuration (2, 7) of the FR3 Duo in radians; the right arm mirrors the left."""
HOME_JOINTS.setflags(write=False)


def _duo(half_distance: float) -> Mapping[Side, SE3]:
    """Bases of the manufacturer's duo workcell [as used by Robot Control Stack], so far apart."""
    return {
        Side.LEFT: SE3.from_wxyz(
            (0.865641, -0.436978, 0.0225312, -0.243326), (0.0, half_distance, 0.342)
        ),
        Side.RIGHT: SE3.from_wxyz(
            (0.865641, 0.436978, 0.0225312, 0.243326), (0.0, -half_distance, 0.342)
        ),
    }


DEFAULT_MOUNT = "duo"
"""Mounting of the FR3 Duo, which is the paper's."""
MOUNTS: Mapping[str, Mount] = {
    mount.name: mount
    for mount in (
        Mount(name=DEFAULT_MOUNT, bases=_duo(0.05018), home=HOME_JOINTS),
        Mount(name="wide", bases=_duo(0.15018), home=HOME_JOINTS),
    )
}
"""Mountings by name; "wide" has the arms 200 mm further apart."""
