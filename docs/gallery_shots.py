"""How the gallery images each task: sizes, places to look from, names of files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from duobench.world.robot.cameras import View

FOLDER = "gallery"
"""Where the images of the page are, beside it."""

START_SIZE = (540, 960)
CAMERA_SIZE = (180, 320)
STAGE_SIZE = (480, 640)
"""Height and width in pixels: the start, what a policy's camera shows of it, a stage."""
LOOK = "studio"
"""How the images look, all but those of a policy's cameras; it needs Vulkan."""
SAMPLES = 16
QUALITY = 82
FILM = "film.avif"
"""The moving image of a task, beside the others."""
FILM_SIZE, FILM_QUALITY, FILM_SAMPLES = (300, 400), 58, 4
FILM_FRAMES, FRAME_MS, REST_MS = 36, 125, 1500
"""Images of one turn, milliseconds of each, and of the last."""
LATER = 20
"""Control steps after which a stage is drawn: at the very step that reaches it there is often
little to see, a gripper about to open or a cube that has just left the table."""

CLOSE_UP = View(eye=(1.45, -0.72, 0.72), target=(0.47, 0.0, 0.08), fovy_deg=32.0)


@dataclass(frozen=True, kw_only=True, slots=True)
class Shot:
    """How the episode of a task is pictured."""

    seed: int = 0
    """Of the reset."""
    view: View = CLOSE_UP
    """Where stages are seen from."""
    last: View | None = None
    """Where the last stage is seen from, if it is another place."""


SHOTS: Mapping[str, Shot] = MappingProxyType(
    {
        "hinge_chest": Shot(
            view=View(eye=(1.1, 0.7, 1.0), target=(0.44, -0.04, 0.15), fovy_deg=32.0)
        ),
        "spring_door": Shot(
            # The door opens towards the robot: only from beside it can one see both sides of it,
            # and only from in front of the microwave the cube inside.
            view=View(eye=(0.12, -1.25, 0.55), target=(0.52, 0.0, 0.14), fovy_deg=36.0),
            last=View(eye=(0.02, -0.8, 0.48), target=(0.6, -0.02, 0.12), fovy_deg=40.0),
        ),
        "pour_marbles": Shot(
            # Steep enough to look down into the cups.
            view=View(eye=(1.05, -0.2, 1.4), target=(0.41, 0.0, 0.10), fovy_deg=33.0),
        ),
        "ball_maze": Shot(
            view=View(eye=(1.3, -0.1, 1.0), target=(0.48, -0.02, 0.10), fovy_deg=26.0)
        ),
        "carry_pot": Shot(
            view=View(eye=(1.4, -0.6, 0.8), target=(0.45, 0.06, 0.12), fovy_deg=32.0)
        ),
        "block_balance": Shot(
            view=View(eye=(1.3, -0.38, 0.62), target=(0.48, 0.0, 0.11), fovy_deg=28.0)
        ),
        "join_blocks": Shot(
            view=View(eye=(1.0, 0.85, 0.6), target=(0.53, 0.0, 0.10), fovy_deg=26.0),
            # From the other side, where no hand is in front of the bars.
            last=View(eye=(0.75, -0.95, 0.55), target=(0.55, 0.0, 0.08), fovy_deg=27.0),
        ),
        "transfer_cube": Shot(
            view=View(eye=(1.5, -0.6, 0.85), target=(0.43, -0.03, 0.15), fovy_deg=35.0)
        ),
        "transfer_gate": Shot(
            view=View(eye=(1.6, -0.8, 0.95), target=(0.43, -0.04, 0.23), fovy_deg=36.0)
        ),
        "transfer_reorient": Shot(
            view=View(eye=(1.45, -0.5, 0.88), target=(0.44, 0.0, 0.13), fovy_deg=34.0)
        ),
        "bin_sort": Shot(
            seed=1,  # of seeds 0 and 1 the one in which a cube is still carried when the other lies
            view=View(eye=(1.6, -0.25, 1.05), target=(0.44, 0.0, 0.10), fovy_deg=37.0),
        ),
    }
)
"""What differs from one task to the next."""


def shot(name: str) -> Shot:
    """Return how a task is pictured; one that is not in the list in the usual way."""
    return SHOTS.get(name, Shot())


def camera_file(camera: str) -> str:
    """Return the name of the image of the start from a camera."""
    return f"{camera}.jpg"


def stage_file(stage: int) -> str:
    """Return the name of the image of a stage."""
    return f"stage_{stage}.jpg"
