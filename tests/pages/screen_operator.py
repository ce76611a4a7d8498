"""A person who sees the page and nothing else, as a program: pictures of pixels and words.

It never asks where a tool or an object is, nor what the page keeps behind its words. It takes
screenshots, reads the words that stand on the page, moves the pointer and presses keys.
"""

from __future__ import annotations

import cmath
import io
import math
import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Locator
from scipy import ndimage, signal

from duobench.core.types import Side
from tests.pages.leading import Led

KEYS = {Side.LEFT: ("1", "g"), Side.RIGHT: ("2", "j")}
"""The keys that choose an arm, and that open and close its gripper."""
TAP_RAD = 0.05
TAP_MM = 5
NEAR_RAD = 0.1
GRASP_MM = {"cube": 20, "block": 10}
"""Below the top of a thing."""
OVER_MM = {"cube": 60, "block": 80}
"""Above a thing, where it is all in the picture and large enough to tell its edges."""
LIFT_MM = 80
RAISED_MM = 200
"""How much higher than lifted a block is handed over."""
MEETING = 20 - 20j
"""Pixels from the middle of the scene to where the giver holds a block, from above."""
LEANS = {Side.RIGHT: 87, Side.LEFT: -192}
"""Pixels of a drag from above that lean each hand outwards: by 25 degrees, and by 55."""
FREE_END_RADII, FREE_END_MM = 2.0, 43
"""Of the block that the giver holds leaning: to the left of the giver's ring, and above what was
its lowest point before it leaned."""
APART_RADII = 6.0
"""From the right tool's ring to the left one's, before that comes nearer."""
MOST_TRIES = 3
MOST_PIXELS = 120
"""Of a drag, before it is looked at again."""
LEARNT = 10
"""Pixels of a picture from which on a drag tells how far drags go."""
STRAY = 25
"""Pixels from where something should be that are too many: it is something else."""
GUESS = {"Head": 0.36, "Left wrist": 0.067, "Right wrist": 0.067}
"""Pixels of a camera's picture that a pixel of a drag from above moves a tool, at first; of a
wrist's camera, as shares of how large a cube is there."""
HEAD_RING = 4
"""Pixels from the lower end of the ring on the table to its middle, in the head's picture."""
SETTLED = 45
"""Messages in which a tool comes to rest."""
GRIPPED = 60
EDGE = 4
"""Pixels from the edge of a picture within which something is cut off, as the own fingers are."""
MOST_WAITS = 6
HEARD_MS = 40
"""In which the page hears what the session says."""
PERIOD_MS = 1000 / 60
"""From one message of the page to the next."""
CLOCK = """{
  const clock = performance.now.bind(performance);
  let [before, shown, left] = [clock(), clock(), 1000];
  window.pass_time = (ms) => { left = Math.max(left, ms); };
  performance.now = () => {
    const next = clock();
    const passed = Math.min(4 * (next - before), 8, left);
    before = next;
    shown += passed;
    left -= passed;
    return shown;
  };
}"""
"""A page's clock that stands still while its operator looks and thinks, on a slow machine."""
DRAWN = "() => new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r)))"
LOOKS = 2
"""Pictures that the page draws before it is looked at: the insets are drawn one at a time."""

RATIOS = {"cube": (1.0, 2.0), "block": (1.9, 4.5)}
"""How many times as long as wide things are in a picture."""
END = 0.27
"""Of a block's length, from its middle, where it is taken to be handed over."""
REST_YAW = -0.26
"""Turn of the right hand to the left about which all turns are easy."""

Picture = NDArray[np.int16]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, slots=True)
class Blob:
    """A patch of one colour in a picture, in pixels from its top left."""

    middle: complex
    """Across and down, as one number."""
    area: float
    angle: float
    """Of its long side from upright, in radians from -pi/2 to pi/2; positive is clockwise."""
    long: float
    """Pixels of its long side."""
    mask: Mask


@dataclass(frozen=True, kw_only=True, slots=True)
class Thing:
    """Something to be taken."""

    colour: Callable[[Picture], Mask]
    """The pixels of its colour."""
    shape: str

    def patches(self, picture: Picture, marks: Mask) -> list[Blob]:
        """Where it may be in a picture, whole."""
        mask = self.colour(picture) & ~marks
        found = blobs(mask, 20, 9000, RATIOS[self.shape])
        return [blob for blob in found if not _touches_border(blob.mask)]

    def turn(self, blob: Blob, yaw: float) -> float:
        """How far the hand turns to the left so that the fingers close on its sides.

        Of the ways that there are, the one that leaves the hand turned least; a block's end shall
        be handed to the left arm, for which the right one turns to the right afterwards.
        """
        step, rest = (math.pi, REST_YAW) if self.shape == "block" else (math.pi / 2, yaw)
        turned = yaw - blob.angle
        return turned - yaw + step * round((rest - turned) / step)


@dataclass(frozen=True, kw_only=True, slots=True)
class Seen:
    """Something in a camera's picture."""

    away: complex
    """Pixels from what is right below the tool."""
    blob: Blob


def wrist_of(side: Side) -> str:
    """The name of the camera at a wrist."""
    return f"{side.name.capitalize()} wrist"


# ---------------------------------------------------------------- what is seen


def is_black(picture: Picture) -> Mask:
    """The pixels of the black cube's colour."""
    return picture.max(axis=2) < 40


def is_pale(picture: Picture) -> Mask:
    """The pixels of white things, also in the shade: without a colour, and not dark."""
    high = picture.max(axis=2)
    return (high - picture.min(axis=2) < 20) & (high > 105)


def is_marked(picture: Picture, side: Side) -> Mask:
    """The pixels in the colour of an arm's marks."""
    red, blue = picture[..., 0], picture[..., 2]
    return red - blue > 110 if side is Side.LEFT else blue - red > 80


def blobs(mask: Mask, least: int, most: int, ratios: tuple[float, float]) -> list[Blob]:
    """The patches of a mask with an area in pixels, as long for their width; marks may cut them."""
    closed = ndimage.binary_closing(mask, iterations=2)
    labels, _count = ndimage.label(closed)
    found = []
    for number, part in enumerate(ndimage.find_objects(labels), start=1):
        patch = labels[part] == number
        area = int(patch.sum())
        if not least <= area <= most:
            continue
        down, across = np.nonzero(patch)
        angle, long, wide = _rectangle(across, down)
        if not ratios[0] <= long / wide <= ratios[1] or area < 0.6 * long * wide:
            continue
        whole = labels == number
        corner = complex(part[1].start, part[0].start)
        middle = corner + complex(across.mean(), down.mean())
        found.append(Blob(middle=middle, area=area, angle=angle, long=long, mask=whole))
    return found


def _rectangle(across: NDArray[np.int_], down: NDArray[np.int_]) -> tuple[float, float, float]:
    """The smallest rectangle about points: its long side's turn from upright, and both sides."""
    points = np.stack([across, down], axis=1) - [across.mean(), down.mean()]

    def sides(angle: float) -> tuple[float, float]:
        c, s = np.cos(angle), np.sin(angle)
        one = points[:, 0] * c + points[:, 1] * s
        other = points[:, 1] * c - points[:, 0] * s
        return float(np.ptp(one)) + 1, float(np.ptp(other)) + 1

    angle = float(min(np.radians(np.arange(-45, 45, 3)), key=lambda each: math.prod(sides(each))))
    flat, upright = sides(angle)
    if flat <= upright:
        return angle, upright, flat
    return angle - math.copysign(math.pi / 2, angle), flat, upright


def _touches_border(mask: Mask) -> bool:
    inner = mask[EDGE:-EDGE, EDGE:-EDGE]
    return int(inner.sum()) < int(mask.sum())


def largest_circle(mask: Mask, radii: range = range(10, 26)) -> tuple[complex, float]:
    """Middle and radius of the largest circle that is drawn well among marks."""
    drawn = ndimage.binary_dilation(mask).astype(float)
    found = []
    for radius in radii:
        angles = np.arange(0, 2 * np.pi, 1 / radius)
        size = 2 * radius + 3
        circle = np.zeros((size, size))
        across = np.round(radius + 1 + radius * np.cos(angles)).astype(int)
        down = np.round(radius + 1 + radius * np.sin(angles)).astype(int)
        circle[down, across] = 1 / len({*zip(across.tolist(), down.tolist(), strict=True)})
        shares = signal.fftconvolve(drawn, circle, mode="same")
        row, column = np.unravel_index(int(shares.argmax()), shares.shape)
        found.append((float(shares.max()), complex(int(column), int(row)), float(radius)))
    best = max(share for share, _, _ in found)
    _, middle, radius = max(
        (each for each in found if each[0] > 0.9 * best), key=lambda each: each[2]
    )
    return middle, radius


def ring_of(mask: Mask) -> tuple[complex, float]:
    """Middle and radius of the largest ring among marks: its middle row is the widest one."""
    extents = np.array([np.ptp(np.nonzero(row)[0]) if row.any() else 0 for row in mask])
    rows = np.nonzero(extents >= extents.max() - 1)[0]
    row = int(rows[len(rows) // 2])
    columns = np.nonzero(mask[row])[0]
    return complex((columns[0] + columns[-1]) / 2, float(rows.mean())), float(extents.max()) / 2


class ScreenOperator:
    """Leads tools from the page of a session, by what is to be seen there."""

    def __init__(self, led: Led) -> None:
        """Sit down in front of a page that drives, and look from above."""
        led.shown_every = None
        self._led, self._page = led, led.page
        led.page.locator("canvas").first.scroll_into_view_if_needed()
        x, y, width, height = self.scene
        self._middle = (x + width / 2, y + height / 2)
        self._is_old = True
        self._pixels: dict[str, complex] = {}
        self._rings: dict[str, tuple[complex, float]] = {}
        self._mm_a_pixel = 1.3
        self._yaws: dict[Side, float] = {}
        self._leans: dict[Side, int] = {}
        self._closed: set[Side] = set()
        self.begin()
        self.log: Callable[[str], None] = lambda _line: None
        led.page.mouse.click(*self._middle)  # brings the scene into focus
        self.press("8")

    # ------------------------------------------------------------ looking

    def inset(self, name: str) -> Picture:
        """What a camera shows, without its frame."""
        x, y, width, height = self._box(self._page.get_by_label(f"{name} camera"))
        return self._shot((x + 4, y + 4, width - 8, height - 8))

    def _shot(self, box: tuple[int, int, int, int]) -> Picture:
        """A picture of a part of the page as it stands now."""
        self._draw()
        clip = dict(zip(("x", "y", "width", "height"), box, strict=True))
        with Image.open(io.BytesIO(self._page.screenshot(clip=clip))) as image:  # pyright: ignore[reportArgumentType]
            return np.asarray(image.convert("RGB")).astype(np.int16)

    def wait(self, messages: int = 0) -> None:
        """Let the world go on for some messages, and then until it stands still, as it does."""
        self._go(messages)
        for _ in range(MOST_WAITS):
            self._led.show()
            self._page.wait_for_timeout(HEARD_MS)
            if "Standing still" in self._words or "Waiting" in self._words:
                return
            self._go(SETTLED)

    def _draw(self) -> None:
        """Let the page draw what it was told last."""
        for _ in range(LOOKS if self._is_old else 0):
            self._page.evaluate(DRAWN)
        self._is_old = False

    def _go(self, messages: int) -> None:
        """Let time pass: else the page's clock stands still, however long one thinks."""
        self._is_old = True
        goal = len(self._led.samples) + messages
        while missing := max(0, goal - len(self._led.samples)):
            self._page.evaluate(f"pass_time({missing * PERIOD_MS})")
            came = -1
            while came != len(self._led.samples) < goal:
                came = len(self._led.samples)
                self._led.turn(0.1)
        if messages:
            self._led.follow(0)

    def height_mm(self, side: Side) -> int | None:
        """The number that stands at a tool."""
        self._draw()
        words = self._page.locator("svg text").all_text_contents()
        found = re.search(rf"{side.name.capitalize()}\D*?(\d+) mm", " ".join(words))
        return int(found[1]) if found else None

    @property
    def scene(self) -> tuple[int, int, int, int]:
        """Left, top, width and height of the scene."""
        return self._box(self._page.locator("canvas").first)

    @property
    def led_s(self) -> int:
        """The seconds that the page says were led."""
        found = re.search(r"(\d+) of \d+ s led", self._words)
        assert found, self._words
        return int(found[1])

    @property
    def next(self) -> str:
        """What the page says is to be done next."""
        found = re.search(r"Next: (.*)", self._words)
        return found[1] if found else ""

    @property
    def _words(self) -> str:
        return self._page.locator("body").inner_text()

    # ------------------------------------------------------------- moving

    def press(self, key: str, times: int = 1, settled: int = 6) -> None:
        """Tap a key."""
        for _ in range(times):
            self._page.keyboard.press(key)
            self._go(2)
        self.wait(settled)

    def choose(self, side: Side) -> None:
        self.press(KEYS[side][0])

    def grip(self, side: Side) -> None:
        """Close a gripper that is open, or open it."""
        self.press(KEYS[side][1], settled=GRIPPED)
        self._closed ^= {side}

    def begin(self) -> None:
        """Another layout: hands are turned as at the start, and open."""
        self._yaws = dict.fromkeys(KEYS, 0.0)
        self._leans = dict.fromkeys(KEYS, 0)
        self._closed = set()
        self._pixels = {name: complex(guess) for name, guess in GUESS.items()}

    def stand_up(self, side: Side) -> None:
        """Open a hand, and have it look straight down."""
        if side in self._closed:
            self.grip(side)
        self.choose(side)
        self.lean(side, 0)

    def lean(self, side: Side, pixels: int) -> None:
        """Lean the hand that is led as a drag of so many pixels from above does."""
        if pixels != self._leans[side]:
            self.drag(complex(pixels - self._leans[side]), "Shift")
        self._leans[side] = pixels

    def drag(self, way: complex, key: str | None = None, step: float = 25.0) -> None:
        """Drag the tool of the active arm, in pixels across and down."""
        mouse = self._page.mouse
        mouse.move(*self._middle)
        if key:
            self._page.keyboard.down(key)
        mouse.down()
        count = max(1, int(np.ceil(abs(way) / step)))
        for number in range(1, count + 1):
            part = way * number / count
            mouse.move(self._middle[0] + round(part.real), self._middle[1] + round(part.imag))
            self._go(2)
        mouse.up()
        if key:
            self._page.keyboard.up(key)
        self.wait(SETTLED)

    def lower(self, side: Side, height_mm: float, near_mm: float = 8.0) -> None:
        """Bring a tool to a height above what lies below it: by the pointer, then by keys."""
        for _ in range(3):
            shown = self.height_mm(side)
            assert shown is not None
            if abs(shown - height_mm) <= near_mm:
                return
            pixels = (shown - height_mm) / self._mm_a_pixel
            self.drag(complex(0, -pixels), "Control")
            now = self.height_mm(side)
            if now is not None and 20 < abs(shown - now) < 2 * abs(shown - height_mm):
                self._mm_a_pixel = (shown - now) / pixels

    def sink(self, millimetres: float) -> None:
        """Tap a tool down, or up by a negative number."""
        key = "PageDown" if millimetres > 0 else "PageUp"
        self.press(key, round(abs(millimetres) / TAP_MM), SETTLED)

    def see(self, side: Side, thing: Thing, name: str) -> Seen | None:
        """How far something is from below the tool, in a camera's picture; None if it is not."""
        picture = self.inset(name)
        marks = is_marked(picture, side)
        found = thing.patches(picture, marks)
        below = self._below(marks, name)
        if not found or below is None:
            return None
        nearest = min(found, key=lambda blob: abs(blob.middle - below))
        return Seen(away=nearest.middle - below, blob=nearest)

    def _below(self, marks: Mask, name: str) -> complex | None:
        """Where the line of a tool ends."""
        if name == "Head":
            marks = np.asarray(ndimage.binary_opening(marks, np.ones((1, 2))), dtype=np.bool_)
            rows = np.nonzero(marks.any(axis=1))[0]
            if not len(rows):
                return None
            row = max(0, int(rows[-1]) - HEAD_RING)
            columns = np.nonzero(marks[row:].any(axis=0))[0]
            return complex(columns.mean(), row)
        if name not in self._rings:
            self._rings[name] = ring_of(marks)
        middle, radius = self._rings[name]
        down, across = np.indices(marks.shape)
        away = np.abs(np.hypot(across - middle.real, down - middle.imag) - radius)
        rest = marks & (away > 4) & (np.abs(across - middle.real) < radius + 6)
        if not rest.any():
            return middle
        return ring_of(rest)[0]

    def aim(self, side: Side, thing: Thing, name: str, near: float, tries: int = 5) -> Seen | None:
        """Drag the tool until something is below it in a camera's picture."""
        last: Seen | None = None
        way = 0j
        for _ in range(tries):
            seen = self.see(side, thing, name)
            if last is not None:
                size = self._size(last, name)
                left = last.away - way * self._pixels[name] * size
                if seen is None or abs(seen.away - left) > STRAY + 0.6 * abs(last.away):
                    return Seen(away=left, blob=last.blob)  # the marks are over it
                if abs(last.away - seen.away) > LEARNT:
                    learnt = (last.away - seen.away) / way / size
                    if 0.3 < abs(learnt / self._pixels[name]) < 3:
                        self._pixels[name] = learnt
            if seen is None:
                return None
            self.log(f"{name}: away {seen.away:.1f}, area {seen.blob.area:.0f}")
            if abs(seen.away) < near:
                return seen
            last = seen
            way = self.way(seen.away, seen, name)
            way *= min(1.0, MOST_PIXELS / abs(way))
            self.drag(way)
        return self.see(side, thing, name)

    def way(self, pixels: complex, seen: Seen, name: str) -> complex:
        """The drag that moves the tool by pixels of a camera's picture, where something is seen."""
        return pixels / self._pixels[name] / self._size(seen, name)

    @staticmethod
    def _size(seen: Seen, name: str) -> float:
        """How large things are in a picture: for a wrist's camera, by how wide this one is."""
        return 1.0 if name == "Head" else seen.blob.area / seen.blob.long

    def turn(self, side: Side, angle: float) -> None:
        """Turn the tool about the vertical; positive is to the left."""
        taps = round(angle / TAP_RAD)
        self.press("q" if taps > 0 else "e", abs(taps), SETTLED)
        self._yaws[side] += taps * TAP_RAD
        self._pixels[wrist_of(side)] *= cmath.rect(1.0, taps * TAP_RAD)

    def turn_to(self, side: Side, yaw: float) -> None:
        """Turn the tool about the vertical to where it is turned to the left of the start by."""
        self.turn(side, yaw - self._yaws[side])

    def yaw(self, side: Side) -> float:
        """How far the tool was turned to the left."""
        return self._yaws[side]

    def ring(self, side: Side) -> tuple[complex, float]:
        """Middle and radius of the ring at a tool, in pixels from the scene's top left."""
        picture = self._shot(self.scene)
        return largest_circle(is_marked(picture, side))

    @staticmethod
    def _box(element: Locator) -> tuple[int, int, int, int]:
        box = element.bounding_box()
        assert box
        return (round(box["x"]), round(box["y"]), round(box["width"]), round(box["height"]))


def take(op: ScreenOperator, side: Side, thing: Thing) -> bool:
    """Take something and lift it; whether the page says so."""
    wrist = wrist_of(side)
    goal = op.next
    op.choose(side)
    for _ in range(MOST_TRIES):
        if op.see(side, thing, wrist) is None:
            op.aim(side, thing, "Head", 4.0)
        op.aim(side, thing, wrist, 8.0, 3)
        op.lower(side, 150, 30)
        turn_across(op, side, thing, 5.0)
        op.lower(side, OVER_MM[thing.shape])
        seen = turn_across(op, side, thing, 3.0)
        if seen is None:
            op.lower(side, 350, 30)
            continue
        if thing.shape == "block":  # by the end that is up in the picture: the rest is handed over
            op.drag(op.way(complex(0.0, -END * seen.blob.long), seen, wrist))
        op.sink((op.height_mm(side) or 0) + GRASP_MM[thing.shape])
        op.grip(side)
        op.sink(-LIFT_MM)
        op.log(f"{op.next}; {op.height_mm(side)} mm")
        if op.next != goal:
            return True
        op.grip(side)
    return False


def turn_across(op: ScreenOperator, side: Side, thing: Thing, near: float) -> Seen | None:
    """Be over something with the fingers on both sides of it; None if it is not seen."""
    seen = None
    for _ in range(2):
        seen = op.aim(side, thing, wrist_of(side), near)
        if seen is None:
            return None
        angle = thing.turn(seen.blob, op.yaw(side))
        if abs(angle) < NEAR_RAD:
            break
        op.log(f"turned by {angle:.2f}")
        op.turn(side, angle)
    return seen


def pass_on(op: ScreenOperator) -> bool:
    """Take the white block and hand it to the other arm; whether the page says so."""
    for _ in range(MOST_TRIES):
        if take(op, Side.RIGHT, WHITE_BLOCK) and hand_over(op):
            return True
        for side in (Side.LEFT, Side.RIGHT):
            op.stand_up(side)
            op.sink(-LIFT_MM)
    return False


def hand_over(op: ScreenOperator) -> bool:
    """Hand what the right hand holds to the left one, in the air; whether the page says so.

    Both hands have their cameras outside and lean outwards, and both close on the same two sides of
    the block. How far apart is told by the ring at a tool, which shows how large 30 mm are.
    """
    giver, receiver = Side.RIGHT, Side.LEFT
    op.sink(-RAISED_MM)
    op.turn_to(giver, -math.pi / 2)
    middle = complex(*op.scene[2:]) / 2
    for _ in range(2):
        at, _radius = op.ring(giver)
        op.drag(middle + MEETING - at)
    goal_mm = (op.height_mm(giver) or 0) + FREE_END_MM
    op.lean(giver, LEANS[giver])
    op.log(f"held up: {op.ring(giver)}, {goal_mm} mm")
    op.choose(receiver)
    op.turn_to(receiver, math.pi / 2)
    op.lean(receiver, LEANS[receiver])
    for nearer in (0.0, 0.4, -0.4):
        beside(op, APART_RADII, 5.0)
        op.lower(receiver, goal_mm)
        op.sink((op.height_mm(receiver) or 0) - goal_mm)
        beside(op, APART_RADII, 3.0)
        beside(op, FREE_END_RADII - nearer, 3.0)
        op.log(f"at the end: {op.ring(giver)}, {op.ring(receiver)}, {op.height_mm(receiver)} mm")
        op.grip(receiver)
        op.log(op.next)
        if not op.next.startswith("Grasp"):
            break
        op.grip(receiver)
        beside(op, APART_RADII, 5.0)
    if op.next.startswith("Let go"):
        op.grip(giver)
    op.log(op.next)
    return op.next.startswith("Lower")


def beside(op: ScreenOperator, radii: float, near: float) -> None:
    """Bring the left tool to the left of the right one as seen from above, in radii of its ring."""
    for _ in range(4):
        (right, radius), (left, _) = op.ring(Side.RIGHT), op.ring(Side.LEFT)
        way = right - radii * radius - left
        op.log(f"beside by {radii}: {way:.1f}, radius {radius}")
        if abs(way) < near:
            return
        op.drag(way)


BLACK_CUBE = Thing(colour=is_black, shape="cube")
WHITE_BLOCK = Thing(colour=is_pale, shape="block")
