"""The frames of the arms: where their bases stand, and where flange and tool are on the last link.

The table frame is the world frame: origin under the duo mount on the table top, x away from the
robot, y to its left, z up.
"""

from __future__ import annotations

from duobench.robot.fr3_links import LINKS
from duobench.spatial import SE3
from duobench.types import Side

FLANGE_OFFSET = 0.107
"""Flange beyond link 7 along its z, in metres [Menagerie franka_fr3]."""
TCP_OFFSET = 0.1493
"""Tool centre point beyond the flange along z, in metres [facts of the platform]."""
LINK7_FROM_FLANGE = SE3.at(z=FLANGE_OFFSET)
"""Pose of the flange in link 7."""
LINK7_FROM_TCP = SE3.at(z=FLANGE_OFFSET + TCP_OFFSET)
"""Pose of the tool centre point in link 7; both have the same orientation."""

BASE_POSES = {
    Side.LEFT: SE3.from_wxyz((0.865641, -0.436978, 0.0225312, -0.243326), (0.0, 0.05018, 0.342)),
    Side.RIGHT: SE3.from_wxyz((0.865641, 0.436978, 0.0225312, 0.243326), (0.0, -0.05018, 0.342)),
}
"""World from arm base [manufacturer's duo workcell, as used by Robot Control Stack]."""
SHOULDERS = {side: base.apply(LINKS[1].position) for side, base in BASE_POSES.items()}
"""Middle of each arm's shoulder (3,) in the table frame: where the axes of joints 1 to 3 meet."""
