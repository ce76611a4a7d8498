"""The film of an episode: each frame at its control step, whatever its viewers and encoder do."""

import io
import threading
from collections.abc import Callable, Collection
from types import SimpleNamespace
from typing import Any, cast

import av
import numpy as np
import pytest

from duobench.real.sessions import cameras
from duobench.real.sessions.cameras import FILM_EVERY, FILM_SIZE, Film
from tests.web.pages import wait_until

FRAMES, CLOSENESS = 100, 8


class Filmed:
    """A film of an episode whose images grow brighter, but for some that the camera has not."""

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        show: Callable[[bytes], object],
        missing: Collection[int] = (),
    ) -> None:
        self.number, self.missing = 0, missing
        monkeypatch.setattr(cameras, "head_image", lambda *_: self.image())
        self.film = Film(cast(Any, None), cast(Any, show))
        self.film.on_episode_start(cast(Any, None), {}, {})

    def image(self) -> np.ndarray | None:
        if self.number in self.missing:
            return None
        return np.full((*FILM_SIZE, 3), 2 * self.number, np.uint8)

    def play(self, numbers: range, *, waits: bool = True) -> None:
        for self.number in numbers:
            self.film.on_step(cast(Any, SimpleNamespace(number=self.number * FILM_EVERY)))
            if waits:
                self.wait()

    def wait(self) -> None:
        """Until the encoder has taken everything."""
        wait_until(self.film._frames.empty)

    def brightness(self) -> list[float]:
        """Of every frame, once the episode is over."""
        self.film.on_episode_end(None)
        video = self.film.video()
        assert video is not None
        with av.open(io.BytesIO(video)) as container:
            frames = container.decode(video=0)
            return [float(frame.to_ndarray(format="gray").mean()) for frame in frames]


def check_like(seen: list[float], numbers: list[int]) -> None:
    """Each frame is as bright as that of a number, as far as encoding keeps it."""
    assert len(seen) == len(numbers)
    spread = [2 * number * 219 / 255 + 16 for number in numbers]  # of the encoding
    full = [2.0 * number for number in numbers]
    assert min(np.abs(np.subtract(seen, each)).max() for each in (spread, full)) < CLOSENESS


def test_encoder_that_stands_still_stops_no_control_step(monkeypatch: pytest.MonkeyPatch) -> None:
    gate = threading.Event()
    filmed = Filmed(monkeypatch, lambda _: gate.wait())
    filmed.play(range(1, 90), waits=False)
    lost = filmed.film.lost
    assert 0 < lost < 90
    gate.set()
    filmed.wait()
    filmed.play(range(90, FRAMES))
    last = 89 - lost  # before the gap, in which it is shown
    check_like(filmed.brightness(), [*range(last + 1), *[last] * lost, *range(90, FRAMES)])


def test_film_goes_on_where_nobody_can_be_shown_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_: bytes) -> None:
        raise OSError("the page is gone")

    filmed = Filmed(monkeypatch, broken)
    filmed.play(range(1, FRAMES))
    check_like(filmed.brightness(), list(range(FRAMES)))


def test_frame_that_is_missing_shifts_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    filmed = Filmed(monkeypatch, lambda _: None, missing={0, 40, 41})
    filmed.play(range(1, FRAMES))
    numbers = list(range(FRAMES))
    numbers[0], numbers[40], numbers[41] = 1, 39, 39
    check_like(filmed.brightness(), numbers)
