"""The extents of the workcell: table and room, and where its lights aim.

All positions are in the table frame; see `robot.frames`.
"""

FLOOR_Z = -0.8095
"""Height of the floor in the table frame, in metres [facts of the platform]."""
TABLE_X = (-0.30, 1.10)
"""Front and back edge of the table top; the arms reach x 0.15 to 1.05 [facts of the platform]."""
TABLE_Y = (-0.75, 0.75)
"""Right and left edge of the table top; the arms reach |y| up to 0.65 [facts of the platform]."""

ROOM_X = (-1.6, 3.0)
ROOM_Y = (-2.3, 2.3)
ROOM_HEIGHT = 2.7
"""The room that every camera looks into; its walls are one-sided."""

SHADOW_CENTRE = (0.24, 0.0, 0.24)
"""Where the lights aim, and so the middle of the shadow map: between the table's far edge and the
elbows, as the light sees them."""
