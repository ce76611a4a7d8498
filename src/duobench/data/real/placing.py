"""Where people are to put the objects of a layout, in words."""

from __future__ import annotations

import numpy as np

from duobench.sim.layout import Layout


def placement(layout: Layout) -> str:
    """Where the objects of a layout belong, one a line: in mm in the table frame, and in degrees.

    Args:
        layout: The layout.
    """
    lines = []
    for name, pose in sorted(layout.poses.items()):
        x, y, z = 1000.0 * pose.translation
        yaw = np.degrees(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]))
        lines.append(f"  {name}: x {x:.0f} mm, y {y:.0f} mm, z {z:.0f} mm, turned by {yaw:.0f} deg")
    lines += [f"  {name}: {value}" for name, value in sorted(layout.variants.items())]
    return "\n".join(lines) or "  as you like; this task says nothing."
