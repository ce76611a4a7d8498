"""A person who sees the page and nothing else, as a program: pictures of pixels and words.

It never asks where a tool or an object is, nor what the page keeps behind its words. It takes
screenshots, reads the words that stand on the page, moves the pointer and presses keys.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Locator
from scipy import ndimage

from duobench.core.types import Side
from tests.pages.leading import Led

KEYS = {Side.LEFT: ("1", "g"), Side.RIGHT: ("2", "j")}
"""The keys that choose an arm, and that open and close its gripper."""
TAP_RAD = 0.05
TAP_MM = 5
NEAR_RAD = 0.1
GRASP_MM, LIFT_MM = 20, 80
"""Below the top of a cube, and above the table."""
MOST_TRIES = 3
MOST_PIXELS = 120
"""Of a drag, before it is looked at again."""
LEARNT = 10
"""Pixels of a picture from which on a drag tells how far drags go."""
GUESS = 0.36
"""Pixels of a camera's picture that a pixel of a drag from above moves a tool, at first."""
HEAD_RING = 4
"""Pixels from the lower end of the ring on the table to its middle, in the head's picture."""
SETTLED = 16
"""Messages in which a tool comes to rest."""
GRIPPED = 24
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
  window.pass_time = (ms) => { left += ms; };
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

Picture = NDArray[np.int16]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, slots=True)
class Blob:
    """A patch of one colour in a picture, in pixels from its top left."""

    middle: complex
    """Across and down, as one number."""
    area: float
    angle: float
    """Of an edge, in radians from -pi/4 to pi/4; positive is clockwise on the screen."""
    mask: Mask


@dataclass(frozen=True, kw_only=True, slots=True)
class Seen:
    """Something in a camera's picture."""

    away: complex
    """Pixels from what is right below the tool."""
    blob: Blob


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


def blobs(mask: Mask, least: int, most: int) -> list[Blob]:
    """The compact patches of a mask with an area in pixels, which marks may cut across."""
    closed = ndimage.binary_closing(mask, iterations=2)
    labels, _count = ndimage.label(closed)
    found = []
    for number, part in enumerate(ndimage.find_objects(labels), start=1):
        patch = labels == number
        area = int(patch.sum())
        if not least <= area <= most:
            continue
        rows, columns = (piece.stop - piece.start for piece in part)
        if max(rows, columns) > 2.2 * min(rows, columns) or area < 0.45 * rows * columns:
            continue
        down, across = np.nonzero(patch)
        middle = complex(across.mean(), down.mean())
        found.append(Blob(middle=middle, area=area, angle=_angle(across, down), mask=patch))
    return found


def _angle(across: NDArray[np.int_], down: NDArray[np.int_]) -> float:
    """The turn of the smallest rectangle about points."""
    points = np.stack([across, down], axis=1) - [across.mean(), down.mean()]

    def size(angle: float) -> float:
        c, s = np.cos(angle), np.sin(angle)
        one = points[:, 0] * c + points[:, 1] * s
        other = points[:, 1] * c - points[:, 0] * s
        return float(np.ptp(one) * np.ptp(other))

    return float(min(np.radians(np.arange(-45, 45, 3)), key=size))


def _touches_border(mask: Mask) -> bool:
    inner = mask[EDGE:-EDGE, EDGE:-EDGE]
    return int(inner.sum()) < int(mask.sum())


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
        scene = led.page.locator("canvas").first
        scene.scroll_into_view_if_needed()
        self._scene = self._box(scene)
        self._insets = {
            name: self._box(led.page.get_by_label(f"{name} camera"))
            for name in ("Head", "Left wrist", "Right wrist")
        }
        x, y, width, height = self._scene
        self._middle = (x + width / 2, y + height / 2)
        self._rings: dict[str, tuple[complex, float]] = {}
        self._mm_a_pixel = 1.3
        self._pixels = dict.fromkeys(self._insets, GUESS + 0j)
        self.log: Callable[[str], None] = lambda _line: None
        led.page.mouse.click(*self._middle)  # brings the scene into focus
        self.press("8")

    # ------------------------------------------------------------ looking

    def look(self) -> Picture:
        """A picture of the page as it stands now."""
        for _ in range(LOOKS):
            self._page.evaluate(DRAWN)
        with Image.open(io.BytesIO(self._page.screenshot())) as image:
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

    def _go(self, messages: int) -> None:
        """Let time pass: else the page's clock stands still, however long one thinks."""
        goal = len(self._led.samples) + messages
        while missing := max(0, goal - len(self._led.samples)):
            self._page.evaluate(f"pass_time({missing * PERIOD_MS})")
            came = -1
            while came != len(self._led.samples) < goal:
                came = len(self._led.samples)
                self._led.turn(0.1)
        if messages:
            self._led.follow(0)

    def inset(self, name: str, picture: Picture | None = None) -> Picture:
        """What a camera shows, without its frame."""
        x, y, width, height = self._insets[name]
        picture = self.look() if picture is None else picture
        return picture[y + 4 : y + height - 4, x + 4 : x + width - 4]

    def height_mm(self, side: Side) -> int | None:
        """The number that stands at a tool."""
        self._page.evaluate(DRAWN)
        words = self._page.locator("svg text").all_text_contents()
        found = re.search(rf"{side.name.capitalize()}\D*?(\d+) mm", " ".join(words))
        return int(found[1]) if found else None

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

    def see(self, side: Side, colour: Callable[[Picture], Mask], name: str) -> Seen | None:
        """How far something is from below the tool, in a camera's picture; None if it is not."""
        picture = self.inset(name)
        marks = is_marked(picture, side)
        found = [
            blob
            for blob in blobs(colour(picture) & ~marks, 20, 9000)
            if not _touches_border(blob.mask)
        ]
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

    def aim(
        self, side: Side, colour: Callable[[Picture], Mask], name: str, near: float, tries: int = 5
    ) -> Seen | None:
        """Drag the tool until something is below it in a camera's picture."""
        before = None
        way = 0j
        for _ in range(tries):
            seen = self.see(side, colour, name)
            if seen is None:
                return None
            if before is not None and abs(before) > LEARNT:
                learnt = (before - seen.away) / way
                if 0.05 < abs(learnt) < 5:
                    self._pixels[name] = learnt
            self.log(f"{name}: away {seen.away:.1f}, area {seen.blob.area:.0f}")
            if abs(seen.away) < near:
                return seen
            before = seen.away
            way = seen.away / self._pixels[name]
            way *= min(1.0, MOST_PIXELS / abs(way))
            self.drag(way)
        return self.see(side, colour, name)

    def turn(self, angle: float) -> None:
        """Turn the tool about the vertical; positive is to the left."""
        taps = round(angle / TAP_RAD)
        self.press("q" if taps > 0 else "e", abs(taps), SETTLED)

    @staticmethod
    def _box(element: Locator) -> tuple[int, int, int, int]:
        box = element.bounding_box()
        assert box
        return (round(box["x"]), round(box["y"]), round(box["width"]), round(box["height"]))


def take_cube(op: ScreenOperator, side: Side, colour: Callable[[Picture], Mask]) -> bool:
    """Take the cube of a colour and lift it; whether the page says so."""
    wrist = f"{side.name.capitalize()} wrist"
    goal = op.next
    op.choose(side)
    for _ in range(MOST_TRIES):
        if op.see(side, colour, wrist) is None:
            op.aim(side, colour, "Head", 4.0)
        op.aim(side, colour, wrist, 8.0, 3)
        op.lower(side, 150, 30)
        seen = op.aim(side, colour, wrist, 5.0)
        if seen is None:
            op.lower(side, 350, 30)
            continue
        op.lower(side, 60)
        for _ in range(2):  # across an edge of the cube, which is large enough to tell from here
            seen = op.aim(side, colour, wrist, 3.0)
            if seen is None or abs(seen.blob.angle) < NEAR_RAD:
                break
            op.log(f"turned by {seen.blob.angle:.2f}")
            op.turn(-seen.blob.angle)
        op.sink((op.height_mm(side) or 0) + GRASP_MM)
        op.grip(side)
        op.sink(-LIFT_MM)
        op.log(f"{op.next}; {op.height_mm(side)} mm")
        if op.next != goal:
            return True
        op.grip(side)
    return False
