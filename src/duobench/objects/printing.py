"""What printing asks of the shapes of objects.

Objects are printed solid (100 % infill) in PLA, so that they weigh what a simulation gives them.
"""

PRINTER = 0.256
"""Edge in metres of the cube that a printer fills: that of the paper's Bambu Lab X1C."""
THINNEST_WALL = 0.0008
"""Thinnest wall in metres that is printed reliably: two lines of a nozzle of 0.4 mm."""
JOINT_PLAY = 0.0002
"""Play in metres on each side of a joint that is put together once and glued: a printer with a
nozzle of 0.4 mm is off by 0.1 to 0.2 mm, and a gap of that width still holds glue."""
OVERLAP = 0.002
"""How deep in metres shapes of one body reach into each other: shells that only touch may be two
bodies to a printer's software."""
