import io

import av
import numpy as np
import pytest

from duobench.envs.execution import Step
from duobench.evaluation.video import FRAME_EVERY, Picture, VideoRecorder
from tests.results.samples import SORT

HEIGHT, WIDTH = 48, 64


def step(number: int, *, last: bool) -> Step:
    played = {"number": number, "terminated": last, "truncated": False}
    return Step(**played, action=np.zeros(16), observation={}, reward=0.0, info={})


def video_of(steps: int, broken_after: int | None = None) -> bytes:
    """Video of a square that moves to the right."""
    number = 0

    def render() -> np.ndarray:
        image = np.full((HEIGHT, WIDTH, 3), 200, dtype=np.uint8)
        image[10:20, number : number + 10] = (200, 30, 30)
        return image

    recorder = VideoRecorder(render)
    recorder.on_episode_start(None, {}, {})  # type: ignore[arg-type]
    for number in range(1, broken_after or steps + 1):
        recorder.on_step(step(number, last=number == steps))
    recorder.on_episode_end(ZeroDivisionError() if broken_after else None)
    return recorder.video() or b""


def frames(video: bytes) -> list[np.ndarray]:
    with av.open(io.BytesIO(video)) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "vp9"
        assert stream.average_rate == 15
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]


@pytest.mark.parametrize(("steps", "shown"), [(8, 5), (9, 6), (1, 2)])
def test_video_shows_the_reset_every_other_step_and_the_last(steps, shown):
    images = frames(video_of(steps))
    assert len(images) == shown
    assert FRAME_EVERY == 2
    for index, image in enumerate(images):
        assert image.shape == (HEIGHT, WIDTH, 3)
        left = min(2 * index, steps)
        inside, outside = image[15, left + 5], image[40, left + 5]
        assert int(inside[0]) - int(inside[1]) > 80
        assert abs(int(outside[0]) - int(outside[1])) < 20


def test_video_of_a_broken_episode_shows_what_there_was():
    assert len(frames(video_of(20, broken_after=9))) == 5


def test_nothing_shown_is_no_video():
    recorder = VideoRecorder(lambda: np.zeros((2, 2, 3), dtype=np.uint8))
    recorder.on_episode_end(None)
    assert recorder.video() is None


TABLE = np.full((480, 640, 3), 200, np.uint8)
CAPTION = slice(0, 24)


def image(shade: int, height: int = 224, width: int = 224) -> np.ndarray:
    return np.full((height, width, 3), shade, np.uint8)


def test_stage_and_time_stand_in_the_corner_and_nowhere_else():
    picture = Picture(SORT)
    drawn = [picture.draw(TABLE, number, stage) for number, stage in ((0, 0), (30, 0), (30, 2))]
    assert (TABLE == 200).all()
    for each in drawn:
        assert each.shape == TABLE.shape
        assert (each[CAPTION.stop :] == 200).all()
    assert not np.array_equal(drawn[0], drawn[1])
    assert not np.array_equal(drawn[1], drawn[2])
    assert np.array_equal(drawn[2], Picture(SORT).draw(TABLE, 30, 2))


def test_long_names_end_at_the_edge():
    drawn = Picture(SORT).draw(TABLE[:, :64], 0, 3)
    assert drawn.shape == (480, 64, 3)
    assert drawn[CAPTION, -4:].max() <= 200


@pytest.mark.parametrize(
    ("sizes", "width"),
    [
        ([(224, 224)] * 3, 640 + 160),
        ([(224, 224)] * 2, 640 + 240),
        ([(96, 128)], 640 + 320),
        ([(224, 224), (90, 160), (224, 224)], 640 + 284),
    ],
)
def test_images_of_the_policy_stand_beside_the_table(sizes, width):
    picture = Picture(SORT)
    picture.look(7, {f"camera_{nth}": image(40 + nth, *size) for nth, size in enumerate(sizes)})
    drawn = picture.draw(TABLE, 8, 0)
    assert drawn.shape == (480, width, 3)
    assert (drawn[CAPTION.stop :, :640] == 200).all()
    cell = 480 // max(2, len(sizes))
    for nth in range(len(sizes)):
        assert (drawn[(nth + 1) * cell - 4, 644] == 40 + nth).all()


def test_picture_says_when_the_policy_saw_it_only_if_it_did():
    columns = []
    for is_seen, number in ((True, 3), (True, 6), (False, 3), (False, 6)):
        picture = Picture(SORT, is_seen=is_seen)
        picture.look(number, {"head": image(40)})
        columns.append(picture.draw(TABLE, 9, 0)[:, 640:])
    assert not np.array_equal(columns[0], columns[1])
    assert np.array_equal(columns[2], columns[3])
