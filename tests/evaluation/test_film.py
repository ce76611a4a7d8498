from pathlib import Path

import av
import numpy as np
import pytest

from duobench.evaluation.film import FRAME_EVERY, FilmError, filming
from duobench.evaluation.loop import Step

HEIGHT, WIDTH = 48, 64


def step(number: int, *, last: bool) -> Step:
    return Step(
        number=number,
        action=np.zeros(16),
        observation={},
        terminated=last,
        truncated=False,
        info={},
    )


def shoot(path: Path, steps: int, broken_after: int | None = None) -> None:
    """Film a square that moves to the right."""
    number = 0

    def render() -> np.ndarray:
        image = np.full((HEIGHT, WIDTH, 3), 200, dtype=np.uint8)
        image[10:20, number : number + 10] = (200, 30, 30)
        return image

    with filming(path, render) as film:
        film.on_episode_start(None, {}, {})  # type: ignore[arg-type]
        for number in range(1, steps + 1):
            if number == broken_after:
                return
            film.on_step(step(number, last=number == steps))
        film.on_episode_end()


def frames(path: Path) -> list[np.ndarray]:
    with av.open(path) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "vp9"
        assert stream.average_rate == 15
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]


@pytest.mark.parametrize(("steps", "shown"), [(8, 5), (9, 6), (1, 2)])
def test_film_shows_the_reset_every_other_step_and_the_last(
    tmp_path: Path, steps: int, shown: int
) -> None:
    path = tmp_path / "videos" / "a.webm"
    shoot(path, steps)
    pictures = frames(path)
    assert len(pictures) == shown
    assert FRAME_EVERY == 2
    for index, picture in enumerate(pictures):
        assert picture.shape == (HEIGHT, WIDTH, 3)
        left = min(2 * index, steps)
        inside, outside = picture[15, left + 5], picture[40, left + 5]
        assert int(inside[0]) - int(inside[1]) > 80
        assert abs(int(outside[0]) - int(outside[1])) < 20


def test_film_of_a_broken_episode_shows_what_there_was(tmp_path: Path) -> None:
    shoot(tmp_path / "a.webm", 20, broken_after=9)
    assert len(frames(tmp_path / "a.webm")) == 5


def test_same_frames_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        shoot(tmp_path / f"{name}.webm", 12)
    assert (tmp_path / "a.webm").read_bytes() == (tmp_path / "b.webm").read_bytes()


def test_nothing_filmed_leaves_no_file(tmp_path: Path) -> None:
    with filming(tmp_path / "a.webm", lambda: np.zeros((2, 2, 3), dtype=np.uint8)):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_video_that_cannot_be_written_is_no_fault_of_the_policy(tmp_path: Path) -> None:
    def film_into_nothing() -> None:
        with filming(tmp_path / "a.webm", lambda: picture) as film:
            (tmp_path / "gone").mkdir()
            tmp_path.rename(tmp_path.with_name("elsewhere"))
            film.on_episode_start(None, {}, {})  # type: ignore[arg-type]

    picture = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
    with pytest.raises(FilmError, match=r"A video cannot be written to .*Make room"):
        film_into_nothing()
