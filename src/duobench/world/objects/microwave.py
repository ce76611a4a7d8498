"""A microwave oven with a sprung door that is hinged at its left side.

The oven's frame is at the middle of its underside: x to its back, y to the left, z up. The door's
frame is on the hinge's axis at the oven's front, so that the shut door reaches towards -y; the
hinge turns about -z to open.
"""

from duobench.core.spatial import SE3
from duobench.world.objects.prop import Hinge, Part, Prop
from duobench.world.objects.shapes import box, cylinder
from duobench.world.objects.solid import Solid, images_of

WIDTH, DEPTH, HEIGHT = 0.55, 0.32, 0.30
"""Outer sizes along y, x and z in metres, door and handle aside [task definitions]."""
CAVITY = (0.26, 0.33, 0.24)
"""Depth, width and height of the cavity in metres [task definitions]."""
FLOOR = (HEIGHT - CAVITY[2]) / 2
"""Thickness of floor and roof in metres."""
SIDE = 0.015
"""Thickness of the left side in metres; the door overlaps the cavity by as much on the right."""
CAVITY_CENTRE_Y = WIDTH / 2 - SIDE - CAVITY[1] / 2
"""Middle of the cavity in the oven's frame; the controls are to its right."""
FRONT = -DEPTH / 2
"""Plane of the front in the oven's frame, in metres."""

DOOR_LIMITS = (0.0, 2.09)
"""Range of the door in radians [task definitions]."""
DOOR_STIFFNESS = 4.0
"""Spring that shuts the door in N·m/rad [task definitions]."""
DOOR_DAMPING = 0.9
"""Damping of the door in N·m·s/rad, close to critical: it shuts within two seconds, and softly."""
DOOR_MASS = 1.5
"""Mass of the door with its handle in kg: a hollow one of glass and sheet metal."""
GAP = 0.001
"""Play between the shut door and the front, in metres."""
DOOR = (0.020, CAVITY[1] + 2 * SIDE, HEIGHT - 0.016)
"""Thickness, width and height of the door in metres."""

BAR_RADIUS, BAR_LENGTH = 0.008, 0.190
"""The handle's bar, in metres: it fits between half-closed fingers."""
BAR_STANDOFF = 0.050
"""Distance from the door's outside to the bar's axis, in metres: fingertips reach 24 mm beyond the
tool centre point and come at half a radian to the door, so that one of them is ahead by 20 mm."""
BAR_INSET = 0.030
"""Distance from the door's free edge to the bar's axis, in metres."""
BAR = (-GAP - DOOR[0] - BAR_STANDOFF, BAR_INSET - DOOR[1])
"""The bar's axis in the door's frame: x and y in metres."""
HINGE = (FRONT, WIDTH / 2, HEIGHT / 2)
"""Origin of the door's frame in the oven's: on the hinge's axis at half the height."""

_RELIEF = 0.001
"""How far window, panel and display stand out of what carries them, in metres."""
_BARREL = 0.004
"""Radius in metres of the hinge's barrel, which is seen and not felt: the table would shine through
the gap beside the door in dashes."""
_BODY = (0.38, 0.39, 0.42, 1.0)
_PANEL = (0.07, 0.07, 0.08, 1.0)
_DISPLAY = (0.10, 0.42, 0.36, 1.0)
_FRAME = (0.20, 0.21, 0.23, 1.0)
_WINDOW = (0.04, 0.05, 0.07, 1.0)
_STEEL = (0.72, 0.73, 0.75, 1.0)


def microwave(name: str) -> Prop:
    """A microwave that stands where its layout puts it, with its door as part `door`."""
    hinge = Hinge(
        axis=(0.0, 0.0, -1.0),
        limits=DOOR_LIMITS,
        stiffness=DOOR_STIFFNESS,
        damping=DOOR_DAMPING,
    )
    return Prop(
        name=name,
        solid=_oven,
        parts=(
            Part(
                name="door",
                solid=_door,
                pose=SE3.at(*HINGE),
                hinge=hinge,
            ),
        ),
        fixed=True,
    )


def _oven() -> Solid:
    """The housing: floor, roof, back, left side, and the block with the controls."""
    depth, width, height = CAVITY
    back = DEPTH - depth
    controls = WIDTH - SIDE - width
    middle_x, middle_z = FRONT + depth / 2, HEIGHT / 2
    controls_y = (controls - WIDTH) / 2
    relief = 2 * _RELIEF
    return Solid(
        shapes=(
            box(
                DEPTH,
                WIDTH,
                FLOOR,
                at=SE3.at(0, 0, FLOOR / 2),
            ),
            box(
                DEPTH,
                WIDTH,
                FLOOR,
                at=SE3.at(0, 0, HEIGHT - FLOOR / 2),
            ),
            box(
                back,
                WIDTH,
                height,
                at=SE3.at((DEPTH - back) / 2, 0, middle_z),
            ),
            box(
                depth,
                SIDE,
                height,
                at=SE3.at(middle_x, (WIDTH - SIDE) / 2, middle_z),
            ),
            box(
                depth,
                controls,
                height,
                at=SE3.at(middle_x, controls_y, middle_z),
            ),
            box(
                relief, 0.13, 0.22, at=SE3.at(FRONT, controls_y, middle_z), rgba=_PANEL
            ),
            box(
                2 * relief,
                0.09,
                0.03,
                at=SE3.at(FRONT, controls_y, 0.225),
                rgba=_DISPLAY,
            ),
        ),
        rgba=_BODY,
    )


def _door() -> Solid:
    """The door with its window and its handle."""
    thickness, width, height = DOOR
    middle = SE3.at(-GAP - thickness / 2, -width / 2, 0)
    bar_x, bar_y = BAR
    arm_x = -GAP - thickness - BAR_STANDOFF / 2
    arm_z = BAR_LENGTH / 2 - BAR_RADIUS
    arm = (BAR_STANDOFF, 2 * BAR_RADIUS, 2 * BAR_RADIUS)
    shapes = (
        box(
            thickness,
            width,
            height,
            at=middle,
        ),
        box(
            thickness + _RELIEF,
            width - 0.10,
            height - 0.08,
            at=middle,
            rgba=_WINDOW,
        ),
        cylinder(
            BAR_RADIUS,
            BAR_LENGTH,
            at=SE3.at(bar_x, bar_y, 0),
            rgba=_STEEL,
        ),
        *(box(*arm, at=SE3.at(arm_x, bar_y, z), rgba=_STEEL) for z in (-arm_z, arm_z)),
    )
    return Solid(
        shapes=shapes,
        images=images_of((*shapes, cylinder(_BARREL, height)), _FRAME),
        rgba=_FRAME,
        mass=DOOR_MASS,
    )
