"""A person with a gamepad in front of the page, as a program: sticks, buttons and triggers.

Its time passes only while it waits; see `screen_operator`.
"""

from __future__ import annotations

import cmath
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

from duobench.core.types import SIDES, Side
from duobench.world.objects.mazes import CELLS, Cell, Direction, Maze, Segment
from tests.pages import screen_operator
from tests.pages.leading import Led
from tests.pages.screen_operator import (
    HEARD_MS,
    MOST_WAITS,
    PERIOD_MS,
    Mask,
    Picture,
    ScreenOperator,
)

DEAD = 0.15
"""What a stick at rest may show."""
SPEED, TURN = 0.25, 1.0
"""Metres and radians a second of a stick at its end, as the docs say."""
TURNING, TOGETHER = 0, 1
"""Buttons A and B."""
BUMPERS = {Side.LEFT: 4, Side.RIGHT: 5}
TRIGGERS = {Side.LEFT: 6, Side.RIGHT: 7}
KEEP = 9
REST = [0.0, 0.0, 0.0, 0.0]
PACE = 0.5
"""How far sticks are pushed when something is brought to a place."""
EASE = 8
"""Messages in which a stick is barely pushed still: a tool that is let go stops where it is."""
BARELY = 0.004
EYE, FOCUS = 1.148, 1.217
"""Of the camera above: metres over the table, and its focus by the height of its picture."""
LEAN = 0.348
"""Radians by which hands lean at the start: the camera at a hand sees what lies before it."""
RING = 0.03
"""Radius in metres of the rings that are drawn."""
NEAR = 0.002
PITCH, EDGE, RIM, RIM_WIDTH, INNER = 0.040, 0.220, 0.019, 0.012, 0.098
"""Of the maze's board, in metres: a cell, the whole, how high its rim is and how wide, and half of
what is inside it."""
NEARER = 4
"""Steps that the camera goes towards the table."""
GRIPPED = 30
POT_RADIUS, POT_TOP = 0.110, 0.092
"""Of the pot's rim, in metres."""
HANDLE, HANDLE_HIGH, HANDLE_HALF = 0.150, 0.085, 0.042
"""How far handles are from the pot's middle, how high, and half of how wide they are."""
BURNER, STOVE = 0.105, 0.020
"""Radius of the burner, and how high the stove is."""
ABOVE_HANDLE, POT_LIFT, POT_OPENING = 0.10, 0.08, 0.45
HIGH = 0.546
"""Metres of the tools above the table at the start."""
CLOCK = screen_operator.CLOCK.replace("{", "{ window.time_left = () => left;", 1)
"""The same clock as `screen_operator` has, which says whether all that was granted has passed."""


def stick(share: float) -> float:
    """How far a stick is pushed for a share of its speed."""
    return math.copysign(DEAD + (1.0 - DEAD) * min(1.0, abs(share)), share) if share else 0.0


class PadOperator(ScreenOperator):
    """Leads tools by sticks, and looks from above: right is right, and up on the screen is away."""

    def __init__(self, led: Led) -> None:
        """Sit down, look from above, and go nearer."""
        super().__init__(led)
        self._box_above = self.scene
        self.sides: tuple[Side, ...] = ()
        self.press("+", NEARER)
        self.high = dict.fromkeys(SIDES, HIGH)
        """Metres of each tool above the table, as far as is known."""

    def lead(self, *sides: Side) -> None:
        """Press the bumpers of one arm, or those of both at once."""
        if sides == self.sides:
            return
        for pressed in (1, 0):
            for side in sides:
                self._push(BUMPERS[side], pressed)
            self._go(3)
        self.sides = sides

    def squeeze(self, opening: float, *sides: Side) -> None:
        """Press triggers as far as leaves the grippers at an opening."""
        for side in sides:
            self._push(TRIGGERS[side], 1.0 - opening)
        self._go(3)
        self.wait(GRIPPED)

    def sticks(self, axes: list[float], messages: int, *buttons: int) -> None:
        """Push sticks by shares of their speed for so many messages, with buttons held."""
        for button in buttons:
            self._push(button, 1)
        self._page.evaluate(f"pad.axes = {[stick(axis) for axis in axes]}")
        self._go(messages)

    def release(self, *buttons: int) -> None:
        """Let sticks and buttons go."""
        self._page.evaluate(f"pad.axes = {REST}")
        for button in buttons:
            self._push(button, 0)
        self._go(2)

    def push_by(self, ways: list[float], most: float, *buttons: int) -> None:
        """Push sticks until they have led by so much along each axis, in metres or radians."""
        largest = max(map(abs, ways))
        messages = max(1, math.ceil(largest / (PACE * most) / (PERIOD_MS / 1000)))
        speeds = [way / (messages * PERIOD_MS / 1000) / most for way in ways]
        self.sticks(speeds, messages, *buttons)
        self.sticks([math.copysign(BARELY, way) if way else 0.0 for way in ways], EASE, *buttons)
        self.release(*buttons)

    def shift(self, right: float, away: float, up: float = 0.0) -> None:
        """Move one tool, or both as one thing, by metres."""
        buttons = [TOGETHER] if len(self.sides) > 1 else []
        self.push_by([right, -away, 0.0, -up], SPEED, *buttons)

    def swivel(self, angle: float) -> None:
        """Turn one tool about the vertical; positive is to the left."""
        self.push_by([0.0, 0.0, -angle, 0.0], TURN)

    def straighten(self) -> None:
        """Turn both hands so that their fingers point straight down, which lean at the start."""
        for side in SIDES:
            self.lead(side)
            self.push_by([0.0, -LEAN, 0.0, 0.0], TURN, TURNING)
        self.wait(10)

    def keep(self) -> bool:
        """Wait until the page asks, and press Start; whether it did ask."""
        for _ in range(MOST_WAITS):
            if "Keep or discard?" in self._words:
                self._push(KEEP, 1)
                self._go(3)
                return True
            self.wait(GRIPPED)
        return False

    def _go(self, messages: int) -> None:
        """Let exactly the time of so many messages pass: sticks lead on as long as it does."""
        self._is_old = True
        self._page.evaluate(f"pass_time({messages * PERIOD_MS})")
        while self._page.evaluate("time_left()") > 0:
            self._led.turn(0.02)
        self._led.follow(0)

    def _push(self, button: int, value: float) -> None:
        self._page.evaluate(f"push({button}, {value})")

    # ------------------------------------------------------------ looking

    def above(self) -> Picture:
        """What is seen from above now."""
        self._led.show()
        self._page.wait_for_timeout(HEARD_MS)
        self._is_old = True
        self._box_above = self.scene
        return self._shot(self._box_above)

    def height(self, side: Side) -> float:
        """Metres that stand at a tool."""
        shown = self.height_mm(side)
        assert shown is not None
        return shown / 1000

    def place(self, pixel: Any, height: float) -> Any:
        """Where something at a height is that is seen at a pixel: metres to the right and away."""
        _x, _y, across, down = self._box_above
        away = np.conj(pixel - complex(across, down) / 2)
        return away * (EYE - height) / (FOCUS * down)

    def pixel(self, place: Any, height: float) -> Any:
        """Where something is seen."""
        _x, _y, across, down = self._box_above
        return complex(across, down) / 2 + np.conj(place) * (FOCUS * down) / (EYE - height)

    def below(self, side: Side, picture: Picture) -> complex:
        """Where the ring with a cross lies that is right below a tool.

        The ring at the tool is seen too, larger and farther from the middle: the higher the more.
        """
        high = self.high[side]
        ground = max(0.0, high - self.height(side))
        marks = ndimage.gaussian_filter(marks_of(picture, side).astype(float), 0.7)
        _x, _y, _across, down = self._box_above
        rough = self.place(found_ring(marks, RING * FOCUS * down / (EYE - ground)), ground)
        circle = RING * np.exp(1j * np.arange(0, 2 * np.pi, 0.1))
        line = np.linspace(-RING, RING, 30)
        on_ground = np.concatenate([circle, line, 1j * line])

        def fit(place: complex) -> float:
            low, top = self.pixel(place + on_ground, ground), self.pixel(place + circle, high)
            seen = np.concatenate([low, top])
            return float(ndimage.map_coordinates(marks, [seen.imag, seen.real], order=1).mean())

        for step, reach in ((0.002, 12), (0.0005, 6)):
            shifts = np.arange(-reach, reach + 1) * step
            rough = max((rough + complex(a, b) for a in shifts for b in shifts), key=fit)
        return rough

    def disc(
        self, mask: Mask, radius: float, height: float, near: complex = 0j, reach: float = 1.0
    ) -> complex:
        """Where the middle of a disc of a colour is, of which parts may be hidden."""
        pixels = radius * FOCUS * self._box_above[3] / (EYE - height)
        size = math.ceil(pixels) + 6
        down, across = np.indices((2 * size + 1, 2 * size + 1)) - size
        away = np.hypot(across, down)
        form = np.where(away < pixels, 1.0, np.where(away < pixels + 5, -2.0, 0.0))
        fit = signal.fftconvolve(mask.astype(float), form, mode="same")
        down, across = np.indices(fit.shape)
        places = self.place(across + 1j * down, height)
        fit[abs(places - near) > reach] = -np.inf
        return complex(places.flat[int(fit.argmax())])

    def go_down(self, side: Side, height: float) -> None:
        """Lower a tool to a height above the table."""
        self.lead(side)
        self.shift(0.0, 0.0, height - self.high[side])
        self.high[side] = height
        self.wait(10)
        self.log(f"{side.name}: {1000 * self.height(side):.0f} of {1000 * height:.0f} mm")

    def bring(self, side: Side, goal: complex, tries: int = 2) -> None:
        """Move a tool until the ring below it is at a place."""
        self.lead(side)
        for _ in range(tries):
            way = goal - self.below(side, self.above())
            self.log(f"{side.name}: {1000 * way:.1f} mm to go")
            if abs(way) < NEAR:
                return
            self.shift(way.real, way.imag)
            self.wait(10)


def marks_of(picture: Picture, side: Side) -> Mask:
    """The pixels in the colour of an arm's marks."""
    red, green, blue = (picture[..., i] for i in range(3))
    if side is Side.LEFT:
        return (red - blue > 110) & (green > 100)
    return (blue - red > 80) & (blue > 190)


def found_ring(marks: NDArray[np.float64], radius: float) -> complex:
    """The middle of a ring of a radius with a cross in it."""
    size = math.ceil(radius) + 4
    down, across = np.indices((2 * size + 1, 2 * size + 1)) - size
    away = np.hypot(across, down)
    is_line = (np.abs(away - radius) < 1.5) | (
        (np.minimum(abs(across), abs(down)) < 1.5) & (away < radius)
    )
    form = np.where(is_line, 1.0, np.where(away < radius + 3, -0.4, 0.0))
    fit = signal.fftconvolve(marks, form[::-1, ::-1], mode="same")
    row, column = np.unravel_index(int(fit.argmax()), fit.shape)
    return complex(column, row)


# ------------------------------------------------------------------- the pot


def carry_pot(op: PadOperator) -> None:
    """Take both handles of a pot, lift it, carry it to the stove, put it down and let go."""
    picture = op.above()
    pot = op.disc(is_steel(picture), POT_RADIUS, POT_TOP)
    stove = op.disc(is_burner(picture), BURNER, STOVE)
    axis = handles_of(op, picture, pot)
    op.log(f"pot at {1000 * pot:.0f} mm, handles {math.degrees(cmath.phase(axis)):.0f} degrees")
    op.squeeze(POT_OPENING, *SIDES)
    op.straighten()
    places = {side: pot - side.sign * HANDLE * axis for side in SIDES}
    for side in SIDES:
        op.bring(side, places[side], tries=1)
        op.swivel(cmath.phase(axis))
        op.go_down(side, HANDLE_HIGH + ABOVE_HANDLE)
        op.bring(side, places[side])
    for side in SIDES:
        op.go_down(side, HANDLE_HIGH)
    op.squeeze(0.0, *SIDES)
    op.lead(*SIDES)
    op.log(f"{op.next} {op.height(Side.LEFT)} m")
    for _ in range(2):  # it is heavy: hands give way
        op.shift(0.0, 0.0, POT_LIFT - op.height(Side.LEFT))
        op.wait(10)
    for _ in range(2):
        pot = op.disc(is_steel(op.above()), POT_RADIUS, POT_TOP + POT_LIFT, pot, 0.04)
        way = stove - pot
        op.log(f"{op.next} {1000 * way:.0f} mm to the stove")
        op.shift(way.real, way.imag)
        op.wait(10)
        pot = stove
    for _ in range(2):
        op.shift(0.0, 0.0, -op.height(Side.LEFT))
        op.wait(10)
        op.log(f"{op.height(Side.LEFT)} m over the stove")
    op.squeeze(POT_OPENING, *SIDES)
    op.wait(30)
    op.log(op.next)


def is_steel(picture: Picture) -> Mask:
    """The pixels of a pot, also in the shade."""
    high = picture.max(axis=2)
    return (high - picture.min(axis=2) < 20) & (high > 90)


def is_burner(picture: Picture) -> Mask:
    """The pixels of a stove's burner, also in the shade."""
    red, green, blue = (picture[..., i] for i in range(3))
    return (red - green > 25) & (red - blue > 25) & (red < 160)


def handles_of(op: PadOperator, picture: Picture, pot: complex) -> complex:
    """The direction, right and away, from a pot's middle to its right handle."""
    is_dark = ndimage.gaussian_filter((picture.max(axis=2) < 70).astype(float), 0.7)
    bar = HANDLE + 1j * np.linspace(-HANDLE_HALF, HANDLE_HALF, 20)
    stays = np.linspace(POT_RADIUS + 0.01, HANDLE, 8)
    form = np.concatenate([bar, stays - 1j * HANDLE_HALF, stays + 1j * HANDLE_HALF])

    def fit(angle: float) -> float:
        seen = op.pixel(pot + np.concatenate([form, -form]) * cmath.exp(1j * angle), HANDLE_HIGH)
        return float(ndimage.map_coordinates(is_dark, [seen.imag, seen.real], order=1).mean())

    return cmath.exp(1j * max(np.radians(np.arange(-60, 61, 1.0)), key=fit))


# ------------------------------------------------------------------ the maze

OPENING = 0.32
GRIP = 0.145
"""How far grips are from the board's middle."""
ABOVE, GRASP, LIFT = 0.11, 0.030, 0.07
"""Heights of the tools above the table, and how far the board is lifted."""
STEEP = 0.13
"""Radians of a run."""
STEP = 3
"""Messages from one look at the ball to the next."""
CENTRING, DAMPING = 4.0, 1.0
AT_WALL = 0.004
MOST_RUNS, MOST_LOOKS = 24, 30


class MazeOnScreen:
    """The board of the maze as it is seen from above.

    Its axes are those of its picture: along `axis` (a direction, right and away), and at a right
    angle to the left of it.
    """

    def __init__(self, operator: PadOperator) -> None:
        """Look at a board that lies on the table, and at nothing before it."""
        self._op = operator
        picture = operator.above()
        self.middle, self.axis = self._lying(picture)
        self.height = RIM
        self.maze = self._read(picture)

    def _lying(self, picture: Picture) -> tuple[complex, complex]:
        labels, count = ndimage.label(is_blue(picture), np.ones((3, 3)))
        sizes = ndimage.sum_labels(labels > 0, labels, range(1, count + 1))
        down, across = np.nonzero(labels == 1 + int(np.argmax(sizes)))
        places = self._op.place(across + 1j * down, RIM)

        def box(angle: float) -> tuple[float, complex]:
            turned = places * cmath.exp(-1j * angle)
            low = complex(turned.real.min(), turned.imag.min())
            high = complex(turned.real.max(), turned.imag.max())
            size = high - low
            return size.real * size.imag, (low + high) / 2 * cmath.exp(1j * angle)

        angle = min(np.radians(np.arange(-45, 45, 0.25)), key=lambda angle: box(angle)[0])
        return box(angle)[1], cmath.exp(1j * float(angle))

    def at(self, x: float, y: float) -> complex:
        """The place of a point of the board, in metres along its axes."""
        return self.middle + self.axis * complex(x, y)

    def _colour(self, picture: Picture, x: float, y: float) -> NDArray[np.float64]:
        seen = self._op.pixel(self.at(x, y), self.height)
        row, column = round(seen.imag), round(seen.real)
        return picture[row - 1 : row + 2, column - 1 : column + 2].mean(axis=(0, 1))

    def _read(self, picture: Picture) -> Maze:
        """The maze, by colours in the middle of its cells and between them."""
        walls = set[Segment]()
        reds: dict[Cell, float] = {}
        greens: dict[Cell, float] = {}
        for i in range(CELLS):
            for j in range(CELLS):
                x, y = centre((i, j))
                red, green, blue = self._colour(picture, x - 0.011, y - 0.011)
                reds[i, j] = red - green
                greens[i, j] = green - red
                for along_x, (dx, dy) in ((False, (1, 0)), (True, (0, 1))):
                    red, green, blue = self._colour(picture, x + dx * PITCH / 2, y + dy * PITCH / 2)
                    if blue - red > 20 and max(i + dx, j + dy) < CELLS:
                        walls.add(Segment((i, j), along_x=along_x))
        return Maze(
            walls=frozenset(walls),
            start=max(greens, key=greens.__getitem__),
            goal=max(reds, key=reds.__getitem__),
        )

    def follow(self, picture: Picture) -> None:
        """See where the board is, near where it was."""
        near = ndimage.gaussian_filter(is_blue(picture).astype(float), 1.0)
        side = np.linspace(-1, 1, 41)
        edges = (side + 1j, side - 1j, 1 + 1j * side, -1 + 1j * side)
        rim = (EDGE - RIM_WIDTH) / 2 * np.concatenate(edges)

        def fit(middle: complex, axis: complex) -> float:
            seen = self._op.pixel(middle + axis * rim, self.height)
            return float(ndimage.map_coordinates(near, [seen.imag, seen.real], order=1).mean())

        for step in (0.008, 0.004, 0.002, 0.001):
            for _ in range(4):
                tries = [
                    (self.middle + complex(a, b) * step, self.axis * cmath.exp(1j * c * step / 0.1))
                    for a in (-1, 0, 1)
                    for b in (-1, 0, 1)
                    for c in (-1, 0, 1)
                ]
                best = max(tries, key=lambda one: fit(*one))
                if fit(*best) <= fit(self.middle, self.axis):
                    break
                self.middle, self.axis = best

    def ball(self, picture: Picture) -> complex | None:
        """Where the ball is on the board, in metres along its axes."""
        red, green, blue = (picture[..., i] for i in range(3))
        down, across = np.nonzero((red - blue > 90) & (red - green < 130) & (green > 70))
        on_board = (self._op.place(across + 1j * down, self.height) - self.middle) / self.axis
        inside = on_board[np.maximum(abs(on_board.real), abs(on_board.imag)) < INNER]
        return complex(np.median(inside.real), np.median(inside.imag)) if len(inside) > 3 else None


def is_blue(picture: Picture) -> Mask:
    """The pixels of walls and rim."""
    red, blue = picture[..., 0], picture[..., 2]
    return (blue - red > 30) & (blue < 190)


def centre(cell: Cell) -> tuple[float, float]:
    """Middle of a cell, in metres along the board's axes."""
    i, j = ((k - (CELLS - 1) / 2) * PITCH for k in cell)
    return i, j


def cell_of(place: complex) -> Cell:
    """The cell of a place on the board."""
    i, j = (min(max(int(v / PITCH + CELLS / 2), 0), CELLS - 1) for v in (place.real, place.imag))
    return i, j


class MazePlayer:
    """Takes the board, lifts it, and tilts it by what is seen of board and ball."""

    def __init__(self, operator: PadOperator) -> None:
        self._op = operator
        self._board = MazeOnScreen(operator)
        self._slope = 0j
        """How far the board is tilted down to the right and away, in radians, as was pushed."""

    def play(self) -> None:
        """Play to the end."""
        self.take()
        self.solve()

    def take(self) -> None:
        """Grasp both grips, lift, and bring the board below the eye."""
        op, board = self._op, self._board
        op.squeeze(OPENING, *SIDES)
        op.straighten()
        places = {side: board.at(-side.sign * GRIP, 0.0) for side in SIDES}
        for side in SIDES:
            op.bring(side, places[side], tries=1)
            op.swivel(cmath.phase(board.axis))
            op.go_down(side, ABOVE)
        for side in SIDES:
            op.bring(side, places[side])
        for side in SIDES:
            op.go_down(side, GRASP)
        for side in SIDES:
            op.squeeze(0.0, side)
        op.log(op.next)
        op.lead(*SIDES)
        op.shift(0.0, 0.0, LIFT)
        op.shift(-board.middle.real, -board.middle.imag)
        board.middle = 0j
        board.height += LIFT
        op.wait(10)

    def solve(self) -> None:
        """Let the ball roll run by run until it lies in the red corner."""
        board, op = self._board, self._op
        for _ in range(MOST_RUNS):
            ball = self.see()
            plan = board.maze.plan(cell_of(ball))
            op.log(f"ball {cell_of(ball)} {1000 * ball:.0f}: {[d.name for d in plan or ()]}")
            if not plan:
                break
            self.run(plan[0], ball)
        goal = complex(*centre(board.maze.goal))
        for _ in range(12):
            self.towards(
                STEEP / 2 * complex(math.copysign(1, goal.real), math.copysign(1, goal.imag))
            )
        op.release(TURNING, TOGETHER)
        op.wait(30)
        op.log(op.next)

    def see(self) -> complex:
        """Where the ball is."""
        picture = self._op.above()
        self._board.follow(picture)
        ball = self._board.ball(picture)
        assert ball is not None
        return ball

    def run(self, direction: Direction, ball: complex) -> None:
        end = complex(*centre(self._board.maze.run(cell_of(ball), direction)))
        along = complex(*direction.value)
        before = ball
        for _ in range(MOST_LOOKS):
            speed = (ball - before) / (STEP / 30)
            before = ball
            centring = CENTRING * (end - ball) - DAMPING * speed
            across = (centring / along).imag * 1j * along
            self.towards(STEEP * along + across)
            ball = self.see()
            self._op.log(f"   {1000 * ball:.0f} slope {self._slope:.3f}")
            if ((ball - end) / along).real > AT_WALL:
                return

    def towards(self, slope: complex) -> None:
        """Push the sticks for some messages, towards a slope along the board's axes."""
        left = slope * self._board.axis - self._slope
        share = left / (TURN * STEP * PERIOD_MS / 1000)
        share /= max(1.0, abs(share.real), abs(share.imag))
        self._op.sticks([share.real, -share.imag, 0.0, 0.0], STEP, TURNING, TOGETHER)
        self._slope += share * TURN * STEP * PERIOD_MS / 1000
