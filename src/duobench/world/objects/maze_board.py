"""The board of the ball maze: floor, rim, walls and four grips, and the ball that rolls on it.

The board's frame is at its middle, on the surface that the ball rolls on. In a simulation one body
has a shape for every place of a wall, and an image for every colour of a corner, so that a board is
chosen without building the model again; `printable_board` has the walls of one maze only.
"""

import math
from collections.abc import Iterable
from itertools import product

from duobench.core.spatial import SE3
from duobench.world.objects.mazes import (
    CELLS,
    CORNERS,
    MAZES,
    SEGMENTS,
    Cell,
    Maze,
    Segment,
)
from duobench.world.objects.prop import Variant
from duobench.world.objects.shapes import (
    JOINT_PLAY,
    Colour,
    Shape,
    box,
    hull,
    prism,
    sphere,
)
from duobench.world.objects.solid import (
    Image,
    Piece,
    Solid,
    images_of,
    mass_properties,
)

PITCH = 0.040
"""Edge of a cell in metres, from wall to wall [task definitions]."""
WALL_HEIGHT = 0.015
"""Height of walls and rim above the floor in metres [task definitions]."""
WALL = 0.004
"""Thickness of the inner walls in metres: ten lines of a printer's nozzle."""
EDGE = 0.220
"""Edge of the board in metres, without the grips [task definitions]."""
BASE = 0.004
"""Thickness of the floor in metres. The rim's underside is level with that of the floor: both are
printed from the bed without a bridge."""
BALL_RADIUS = 0.010
"""Radius of the ball in metres [task definitions]."""
HALF = CELLS * PITCH / 2
"""Half the edge of the maze in metres, up to the middle of a wall on its outline."""
INNER = HALF - WALL / 2
"""Distance of the rim's inner faces from the board's middle in metres."""

GRIP_OFFSET = 0.145
"""Distance in metres of a grip's bar from the board's middle: a finger fits between bar and rim."""
BAR = (0.012, 0.050, 0.022)
"""Edges of a grip's bar in metres: outwards, along the side between its stays, upwards. It is
longer than the pads of a gripper are wide."""
ROOT = 0.002
"""Depth of walls in the floor, and of grips in the rim, in metres."""
STAY = 0.010
"""Width in metres of the two stays that carry a bar."""
GRIP_LIFT = 0.001
"""Height in metres of the underside of the grips above the table."""
GRIP_Z = GRIP_LIFT - BASE + BAR[2] / 2
"""Height of the middle of a bar above the floor's surface in metres."""
DOVETAIL = (0.008, 0.006, 0.010)
"""Depth in the rim, width at its root in the stay and width at its end of the dovetail that holds a
printed stay, in metres. 4 mm of the rim stay behind it."""
LEDGE = 0.003
"""Height in metres of the rim above a dovetail: it is put in from below, and carries the board."""
SHOULDER, BLUNT = 0.002, 0.001
"""How far the printed rim reaches under a printed floor in metres, and how thick it is at the end.
From there it slopes by 45 degrees, so that neither of the two hangs over."""
UPRIGHT = BASE - BLUNT - SHOULDER
"""Height in metres of the upper part of a printed floor's edge, which does not slope."""
FLOOR_PLAY = 0.0003
"""Play in metres on each side between a printed floor and the rim. The floor is not glued: it lies
in the rim by its own weight, and sinks by as much when the board is lifted."""

_FLOOR_COLOUR = (0.80, 0.79, 0.76, 1.0)
WALL_COLOUR = (0.16, 0.34, 0.56, 1.0)
RIM_COLOUR = (0.11, 0.25, 0.42, 1.0)
_GRIP_COLOUR = (0.08, 0.08, 0.09, 1.0)
_START_COLOUR = (0.55, 0.72, 0.55, 1.0)
_GOAL_COLOUR = (0.80, 0.10, 0.09, 1.0)
_BALL_COLOUR = (0.95, 0.62, 0.08, 1.0)
_CORNER_COLOURS = tuple(product(CORNERS, (_FLOOR_COLOUR, _START_COLOUR, _GOAL_COLOUR)))
"""Colours that each corner of the floor may have."""


def cell_centre(cell: Cell) -> tuple[float, float]:
    """Middle of a cell in the board's frame, in metres."""
    middle = (CELLS - 1) / 2
    return (cell[0] - middle) * PITCH, (cell[1] - middle) * PITCH


def cell_at(x: float, y: float) -> Cell:
    """The cell that a point of the board's frame (metres) lies in, or the nearest one."""
    i, j = (min(max(int(v / PITCH + CELLS / 2), 0), CELLS - 1) for v in (x, y))
    return i, j


def ball() -> Solid:
    """The ball; it resists rolling like a marble on a printed floor."""
    return Solid(shapes=(sphere(BALL_RADIUS),), rgba=_BALL_COLOUR, condim=6)


def board() -> Solid:
    """The board for a simulation: it has all walls, of which `wall_variants()` leaves some out.

    The walls of each maze have an image of their own, and so has each corner's floor in each of its
    colours.

    Its mass is that of any of the printed boards, which all weigh the same.
    """
    corners = (_corner_image(*corner) for corner in _CORNER_COLOURS)
    return Solid(
        shapes=(*_frame(), *map(_wall, SEGMENTS)),
        images=(*_frame_images(), *corners, *map(_walls_image, MAZES)),
        rgba=_FLOOR_COLOUR,
        mass=mass_properties(printable_board(MAZES[0])).mass,
    )


def wall_numbers() -> dict[Segment, int]:
    """Number of each wall among the shapes of `board()`."""
    return {segment: number for number, segment in enumerate(SEGMENTS, len(_frame()))}


def wall_variants() -> dict[str, Variant]:
    """Parts of `board()` that each maze leaves out, walls and images, by the maze's number."""
    numbers = wall_numbers()
    first = len(_frame_images())
    return {
        str(index): Variant(
            without_shapes=frozenset(
                numbers[s] for s in SEGMENTS if s not in maze.walls
            ),
            without_images=frozenset(
                first + number
                for number, shown in enumerate(
                    (*_shown_corners(maze), *(other is maze for other in MAZES))
                )
                if not shown
            ),
            printed=printable_board(maze),
        )
        for index, maze in enumerate(MAZES)
    }


def _shown_corners(maze: Maze) -> Iterable[bool]:
    """Numbers of the corner images that a maze shows: each corner in one colour."""
    colours = {maze.start: _START_COLOUR, maze.goal: _GOAL_COLOUR}
    for corner, colour in _CORNER_COLOURS:
        yield colour == colours.get(corner, _FLOOR_COLOUR)


def printable_board(maze: Maze) -> Solid:
    """The board of one maze, printed in six pieces: a frame, a floor with walls, four equal grips.

    A grip is put into the frame from below, and glued. A floor lies in the frame, which all mazes
    share.
    """
    inside = (_floor(), *_rim(), *_walls(maze))
    turns = _quarter_turns()
    slots = tuple(slot for turn in turns for slot in _dovetails(turn, JOINT_PLAY))
    grips = (
        Piece(
            name="grip",
            rgba=_GRIP_COLOUR,
            shapes=(*_grip(turn, EDGE / 2), *_dovetails(turn)),
            is_shared=True,
        )
        for turn in turns
    )
    return Solid(
        shapes=(*inside, *_grips()),
        rgba=_FLOOR_COLOUR,
        pieces=(
            Piece(
                name="frame",
                rgba=RIM_COLOUR,
                shapes=(*_rim(), *_shoulders()),
                holes=slots,
                is_shared=True,
            ),
            Piece(
                name="floor",
                shapes=(*_loose_floor(), *_walls(maze, UPRIGHT)),
                holes=tuple(_outside()),
            ),
            *grips,
        ),
    )


def _frame() -> tuple[Shape, ...]:
    """Everything but the walls, which is the same on all boards."""
    return (_floor(), *_rim(), *_grips())


def _floor() -> Shape:
    """Floor of the ball."""
    return box(
        2 * HALF,
        2 * HALF,
        BASE,
        at=SE3.at(z=-BASE / 2),
    )


def _loose_floor() -> Iterable[Shape]:
    """The floor that lies in the rim: its lower edges slope as the shoulders do."""
    wide = INNER - FLOOR_PLAY
    narrow = wide - SHOULDER
    yield box(
        2 * narrow,
        2 * narrow,
        2 * BLUNT,
        at=SE3.at(z=BLUNT - BASE),
    )
    levels = ((narrow, BLUNT - BASE), (wide, -UPRIGHT), (wide, 0.0))
    yield hull(
        [
            (x * half, y * half, z)
            for half, z in levels
            for x in (-1, 1)
            for y in (-1, 1)
        ]
    )


def _outside() -> Iterable[Shape]:
    """Cut at the ends of walls: they end where the loose floor does."""
    low, high = -UPRIGHT, 2 * WALL_HEIGHT
    for turn in _quarter_turns():
        inner = INNER - FLOOR_PLAY
        at = turn @ SE3.at(x=inner + PITCH / 2, z=(low + high) / 2)
        yield box(
            PITCH,
            2 * EDGE,
            high - low,
            at=at,
        )


def _shoulders() -> Iterable[Shape]:
    """Supports of a loose floor: four wedges at the rim's inner faces, half in it."""
    outer = INNER + ROOT
    end = INNER - SHOULDER
    high = -UPRIGHT
    section = (
        (outer, -BASE),
        (end, -BASE),
        (end, BLUNT - BASE),
        (INNER, high),
        (outer, high),
    )
    for turn in _quarter_turns():
        corners = [(x, side * INNER, z) for x, z in section for side in (-1, 1)]
        yield hull([tuple(turn.apply(corner).tolist()) for corner in corners])


def _frame_images() -> tuple[Image, ...]:
    """Everything but walls and the floor's corners."""
    inner = HALF - PITCH
    cross = (
        box(
            x,
            y,
            BASE,
            at=SE3.at(z=-BASE / 2),
        )
        for x, y in ((2 * HALF, 2 * inner), (2 * inner, 2 * HALF))
    )
    _, *others = images_of(_frame(), _FLOOR_COLOUR)
    return (*images_of(cross, _FLOOR_COLOUR), *others)


def _corner_image(corner: Cell, rgba: Colour) -> Image:
    """The floor of a corner, flush with the rest."""
    floor = box(
        PITCH,
        PITCH,
        BASE,
        at=SE3.at(*cell_centre(corner), -BASE / 2),
    )
    return images_of((floor,), rgba)[0]


def _rim() -> Iterable[Shape]:
    """Four bars around the floor; their inner faces are as far from the cells as a wall's."""
    width = EDGE / 2 - INNER
    height = BASE + WALL_HEIGHT
    for turn in _quarter_turns():
        side = turn @ SE3.at(x=(EDGE - width) / 2, z=WALL_HEIGHT - height / 2)
        yield box(
            width,
            EDGE,
            height,
            at=side,
            rgba=RIM_COLOUR,
        )


def _grips() -> Iterable[Shape]:
    """A grip at the middle of each side."""
    for turn in _quarter_turns():
        yield from _grip(turn, EDGE / 2 - ROOT)


def _grip(turn: SE3, inner: float) -> Iterable[Shape]:
    """A bar with two stays that begin at a distance from the board's middle."""
    x, y, z = BAR
    bar = SE3.at(x=GRIP_OFFSET, z=GRIP_Z)
    yield box(
        x,
        y + 2 * STAY,
        z,
        at=turn @ bar,
        rgba=_GRIP_COLOUR,
    )
    for side in _stays():
        stay = SE3.at((inner + GRIP_OFFSET) / 2, side, GRIP_Z)
        yield box(
            GRIP_OFFSET - inner,
            STAY,
            z,
            at=turn @ stay,
            rgba=_GRIP_COLOUR,
        )


def _stays() -> tuple[float, float]:
    """Positions of the middles of a grip's stays along a side."""
    return -(BAR[1] + STAY) / 2, (BAR[1] + STAY) / 2


def _dovetails(turn: SE3, play: float = 0.0) -> Iterable[Shape]:
    """Dovetails of a printed grip in the rim; with play, the slots for it, open from below."""
    depth, root, end = DOVETAIL
    outer, inner = EDGE / 2 + ROOT, EDGE / 2 - depth - play
    low, high = GRIP_LIFT - BASE, WALL_HEIGHT - LEDGE
    if play:
        low = -BASE - ROOT
    half = root / 2 + play, end / 2 + play
    outline = ((outer, -half[0]), (outer, half[0]), (inner, half[1]), (inner, -half[1]))
    for side in _stays():
        yield prism(outline, high - low, at=turn @ SE3.at(0.0, side, (low + high) / 2))


def _wall(segment: Segment, root: float = ROOT) -> Shape:
    """A wall over the whole edge of a cell, from the middle of one post to that of the next."""
    x, y = cell_centre(segment.cell)
    along, across = PITCH + WALL, WALL
    centre = (x, y + PITCH / 2) if segment.along_x else (x + PITCH / 2, y)
    size = (along, across) if segment.along_x else (across, along)
    middle = SE3.at(*centre, (WALL_HEIGHT - root) / 2)
    return box(
        *size,
        WALL_HEIGHT + root,
        at=middle,
        rgba=WALL_COLOUR,
    )


def _walls(maze: Maze, root: float = ROOT) -> tuple[Shape, ...]:
    return tuple(_wall(segment, root) for segment in SEGMENTS if segment in maze.walls)


def _walls_image(maze: Maze) -> Image:
    """The walls of a maze in one image, without their ends in the rim."""
    return images_of((*_rim(), *_walls(maze)), WALL_COLOUR)[-1]


def _quarter_turns() -> tuple[SE3, ...]:
    return tuple(SE3.at(yaw=k * math.pi / 2) for k in range(4))
