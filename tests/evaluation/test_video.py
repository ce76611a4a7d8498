import io

import av
import numpy as np
import pytest

from duobench.envs.execution import Step
from duobench.evaluation.video import FRAME_EVERY, VideoRecorder

HEIGHT, WIDTH = 48, 64


def step(number: int, *, last: bool) -> Step:
    return Step(
        number=number,
        action=np.zeros(16),
        observation={},
        reward=0.0,
        terminated=last,
        truncated=False,
        info={},
    )


def video_of(steps: int, broken_after: int | None = None) -> bytes:
    """Video of a square that moves to the right."""
    number = 0

    def render() -> np.ndarray:
        image = np.full((HEIGHT, WIDTH, 3), 200, dtype=np.uint8)
        image[10:20, number : number + 10] = (200, 30, 30)
        return image

    recorder = VideoRecorder(render)
    recorder.on_episode_start(None, {}, {})  # type: ignore[arg-type]
    error = None
    for number in range(1, steps + 1):
        if number == broken_after:
            error = ZeroDivisionError()
            break
        recorder.on_step(step(number, last=number == steps))
    recorder.on_episode_end(error)
    video = recorder.video()
    assert video
    return video


def frames(video: bytes) -> list[np.ndarray]:
    with av.open(io.BytesIO(video)) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "vp9"
        assert stream.average_rate == 15
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]


@pytest.mark.parametrize(("steps", "shown"), [(8, 5), (9, 6), (1, 2)])
def test_video_shows_the_reset_every_other_step_and_the_last(steps: int, shown: int) -> None:
    images = frames(video_of(steps))
    assert len(images) == shown
    assert FRAME_EVERY == 2
    for index, image in enumerate(images):
        assert image.shape == (HEIGHT, WIDTH, 3)
        left = min(2 * index, steps)
        inside, outside = image[15, left + 5], image[40, left + 5]
        assert int(inside[0]) - int(inside[1]) > 80
        assert abs(int(outside[0]) - int(outside[1])) < 20


def test_video_of_a_broken_episode_shows_what_there_was() -> None:
    assert len(frames(video_of(20, broken_after=9))) == 5


def test_nothing_shown_is_no_video() -> None:
    recorder = VideoRecorder(lambda: np.zeros((2, 2, 3), dtype=np.uint8))
    recorder.on_episode_end(None)
    assert recorder.video() is None
