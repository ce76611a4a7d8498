"""Make `mug.stl`, a mug in millimetres: 64 mm wide without its handle, 80 mm high."""

from pathlib import Path

import manifold3d

from duobench.printing import stl_bytes
from duobench.world.objects import mesh_of

RADIUS, HEIGHT, WALL = 0.032, 0.080, 0.004
"""Of the mug, in metres."""
HANDLE, BAR = 0.019, 0.0045
"""Radius of the handle's bend, and of the bar that is bent, in metres."""
SEGMENTS = 40


def mug() -> manifold3d.Manifold:
    """Return the mug with its handle towards x."""
    inside = RADIUS - WALL
    outline = [
        [0, 0],
        [RADIUS, 0],
        [RADIUS, HEIGHT],
        [inside, HEIGHT],
        [inside, WALL],
        [0, WALL],
    ]
    cup = manifold3d.CrossSection([outline]).revolve(SEGMENTS)
    bar = manifold3d.CrossSection.circle(BAR, 12).translate((HANDLE, 0))
    ring = bar.revolve(24).rotate((90, 0, 0)).translate((RADIUS, 0, HEIGHT / 2))
    room = manifold3d.Manifold.cylinder(HEIGHT, RADIUS - WALL / 2, -1, SEGMENTS)
    return cup + (ring - room)


if __name__ == "__main__":
    Path(__file__).with_name("mug.stl").write_bytes(stl_bytes(mesh_of(mug()), "mug"))
