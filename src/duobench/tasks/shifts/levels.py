"""Bounds of each level of each axis. A change is another version of the suite `robust`.

Levels of layout, physics and latency are those at which scripted experts still solve the tasks; see
the page robustness. An entry 0 of each row is no shift.
"""

import math
from collections.abc import Mapping

from duobench.tasks.shifts.shift import LATENCY, LAYOUT, Shift

CAMERA_METRES = (0.0, 0.005, 0.010, 0.015, 0.020, 0.030)
"""Largest offset of the head camera along each axis; wrist cameras have `WRIST_SHARE` of it."""
CAMERA_RADIANS = tuple(
    math.radians(angle) for angle in (0.0, 0.75, 1.5, 2.25, 3.0, 4.0)
)
"""Largest turn of a camera about each axis, and change of its field of view."""
WRIST_SHARE = 0.4

MARGIN_METRES = (0.0, 0.01, 0.02, 0.03, 0.04, 0.05)
"""Distance beyond the range of training at which an object may start, along each axis."""
MARGIN_RADIANS = tuple(
    math.radians(angle) for angle in (0.0, 3.0, 6.0, 9.0, 12.0, 15.0)
)
"""Turn of an object beyond that range."""

MASS_FACTORS = (1.0, 1.2, 1.4, 1.6, 1.8, 2.0)
FRICTION_FACTORS = (1.0, 1.1, 1.2, 1.3, 1.4, 1.5)
SPRING_FACTORS = (1.0, 1.2, 1.4, 1.6, 1.8, 2.0)
"""Masses of all objects, friction of all surfaces, and springs of hinges with the mass that they
move are multiplied by a factor between one over this and this. So lids and doors that are let go
move as they usually do."""

REWORDED_SHARE = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
"""Share of episodes with a sentence that no demonstration has."""

IMAGE_NOISE = (0.0, 0.02, 0.04, 0.06, 0.09, 0.12)
"""Standard deviation of the noise in images, as a share of full brightness."""
DEPTH_SUBPIXEL = (0.0, 0.04, 0.08, 0.12, 0.20, 0.30)
"""Standard deviation of the disparity that a stereo camera matches, in native pixels."""
DEPTH_FARTHEST = (math.inf, 2.0, 1.5, 1.0, 0.8, 0.7)
"""Distance in metres from which on the wrists' cameras and those of one's own give no depth; from
home the table is 0.64 m away."""
DEPTH_SHINY_SHARE = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9)
"""Share of grippers, cameras and mount, which are of metal and glass, without depth."""
DROPPED_SHARE = (0.0, 0.1, 0.25, 0.5, 0.7, 0.85)
"""Probability that a camera drops a frame and shows the last one that it did not drop."""
JOINT_NOISE = (0.0, 0.001, 0.002, 0.004, 0.006, 0.010)
"""Standard deviation of the noise in joint positions (rad) and openings (parts of 1)."""
POSE_NOISE = (0.0, 0.001, 0.002, 0.004, 0.006, 0.010)
"""Standard deviation of the noise in positions of tools (m) and in the numbers of the objects."""

LATENCY_STEPS = (0, 2, 4, 6, 8, 10)
"""Control steps from an observation to the chunk that answers it."""

LOWERED: Mapping[str, Mapping[str, int]] = {
    LAYOUT: {"hinge_chest": 4, "spring_door": 4},
    LATENCY: {"ball_maze": 3},
}
"""Highest level by axis and task beyond which the expert fails; higher levels have its bounds."""


def level_for(
    shift: Shift,
    axis: str,
    task_id: str,
) -> int:
    """Whose bounds an episode of a task has along an axis, 0 to 5."""
    level = shift.level_of(axis)
    return min(level, LOWERED.get(axis, {}).get(task_id, level))


def latency_steps(shift: Shift, task_id: str) -> int:
    """Control steps of latency of an episode of a task."""
    return LATENCY_STEPS[level_for(shift, LATENCY, task_id)]
