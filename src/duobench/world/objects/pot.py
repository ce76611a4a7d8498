"""A cooking pot with a rigid loop handle on either side, and the stove plate it is put on.

An ordinary pot, closed and as heavy as if it were full. Each handle is a bar on two arms, near the
rim and clear of the wall, so that a gripper can take it from above with one finger in the loop. A
gripper that holds an end of a handle at a slant, palm against the wall, can carry even this pot
level (a search found it): that two arms carry it is up to the task's stages.
"""

import math

from duobench.core.spatial import SE3
from duobench.world.objects.prop import Part, Prop
from duobench.world.objects.shapes import (
    CIRCLE_SEGMENTS,
    box,
    circle,
    cylinder,
    prism,
)
from duobench.world.objects.solid import Solid, mass_properties

RADIUS = 0.110
HEIGHT = 0.110
"""Outer radius and height in metres [task definitions]."""
LID_HEIGHT = 0.018
LID_TAPER = 0.62
"""Height of the lid in metres, and its upper radius as a part of the lower one. The lid stays on: a
gripper could carry an open pot by its wall."""
MASS = 2.5
"""Mass of the whole pot in kg [task definitions]: that of a steel pot with more than a litre of
soup in it. Two arms, of 3 kg payload each, carry it with ease."""
ALUMINIUM_DENSITY = 2700.0
"""Density of the handles in kg/m³."""

HANDLE_OFFSET = 0.150
HANDLE_Z = 0.030
"""Distance in metres of a handle's bar from the pot's axis (a finger fits between bar and wall),
and its height above the pot's centre: just below the rim."""
BAR_RADIUS = 0.006
"""Radius of a handle's bar in metres."""
BAR_LENGTH = 0.080
"""Length in metres of a bar, between its two arms: a finger with its tongue is 22 mm wide."""
ARM = 0.010
"""Edge in metres of the square arms that carry a bar."""
_ROOT = 0.002
"""Depth of the arms in the wall, in metres: so that they end inside it."""

_STEEL = (0.66, 0.68, 0.71, 1.0)
_LID_COLOUR = (0.76, 0.77, 0.79, 1.0)
_HANDLE_COLOUR = (0.09, 0.09, 0.10, 1.0)

PLATE = (0.35, 0.28, 0.02)
"""Edges of the stove plate in metres [task definitions]."""
_BURNER = (0.105, 0.0005)
_PLATE_COLOUR = (0.13, 0.13, 0.15, 1.0)
_BURNER_COLOUR = (0.42, 0.16, 0.13, 1.0)


def pot(name: str) -> Prop:
    """A pot with the parts `left_handle` (+y) and `right_handle`; its frame is at its centre.

    The handles are rigid, and bodies of their own only so that contacts tell them from the wall.
    """
    return Prop(
        name=name,
        solid=_vessel,
        parts=tuple(
            Part(
                name=f"{side}_handle",
                solid=_handle,
                pose=SE3.at(yaw=yaw) @ SE3.at(y=HANDLE_OFFSET, z=HANDLE_Z),
            )
            for side, yaw in (("left", 0.0), ("right", math.pi))
        ),
    )


def _vessel() -> Solid:
    """The pot with its lid, without its handles."""
    body = HEIGHT - LID_HEIGHT
    lid = prism(
        (RADIUS * circle(CIRCLE_SEGMENTS)).tolist(),
        LID_HEIGHT,
        at=SE3.at(z=(HEIGHT - LID_HEIGHT) / 2),
        rgba=_LID_COLOUR,
        taper=LID_TAPER,
        shadow=False,
    )
    return Solid(
        shapes=(cylinder(RADIUS, body, at=SE3.at(z=-LID_HEIGHT / 2)), lid),
        rgba=_STEEL,
        mass=MASS - 2 * mass_properties(_handle()).mass,
    )


def _handle() -> Solid:
    """A bar along x on two arms; its frame is in the middle of the bar, its outside is +y."""
    aside = (BAR_LENGTH + ARM) / 2
    # The inner edge of an arm reaches into the round wall along its whole width.
    length = HANDLE_OFFSET - math.sqrt(RADIUS**2 - (aside + ARM / 2) ** 2) + _ROOT
    return Solid(
        shapes=(
            cylinder(
                BAR_RADIUS, BAR_LENGTH + ARM, at=SE3.about((0, 1, 0), math.pi / 2)
            ),
            *(
                box(
                    ARM,
                    length,
                    ARM,
                    at=SE3.at(x, -length / 2),
                )
                for x in (-aside, aside)
            ),
        ),
        rgba=_HANDLE_COLOUR,
        density=ALUMINIUM_DENSITY,
    )


def stove_plate() -> Solid:
    """A flat plate with a burner on top; its frame is at the middle of its underside."""
    x, y, z = PLATE
    radius, height = _BURNER
    return Solid(
        shapes=(
            box(
                x,
                y,
                z,
                at=SE3.at(z=z / 2),
            ),
            cylinder(
                radius,
                height,
                at=SE3.at(z=z + height / 2),
                rgba=_BURNER_COLOUR,
            ),
        ),
        rgba=_PLATE_COLOUR,
    )
