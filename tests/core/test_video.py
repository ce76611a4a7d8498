import io
import os
from contextlib import closing
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image as Pillow

from duobench.core.codecs import AV1, DATA_H264, H264, HEVC12, VP9, Codec
from duobench.core.errors import VideoError
from duobench.core.video import VideoWriter, in_rgb, write_video

FRAMES = [np.full((48, 64, 3), value, np.uint8) for value in (0, 80, 160, 240)]


@pytest.mark.parametrize(("codec", "name"), [(VP9, "vp9"), (AV1, "libdav1d"), (DATA_H264, "h264")])
def test_every_frame_is_kept_and_the_same_frames_give_the_same_bytes(
    tmp_path: Path, codec: Codec, name: str
) -> None:
    path, again = tmp_path / "video", tmp_path / "again"
    for target in (path, again):
        write_video(FRAMES, target, codec, Fraction(15))
    assert path.read_bytes() == again.read_bytes()
    with av.open(path) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name in (name, "av1")
        assert stream.average_rate == 15
        means = [frame.to_ndarray(format="rgb24").mean() for frame in container.decode(stream)]
    np.testing.assert_allclose(means, [frame.mean() for frame in FRAMES], atol=4)


def test_memory_takes_the_bytes_of_a_file(tmp_path: Path) -> None:
    memory, path = io.BytesIO(), tmp_path / "video"
    for target in (memory, path):
        write_video(FRAMES, target, VP9, 15)
    assert memory.getvalue() == path.read_bytes()


def test_image_that_no_encoder_takes_is_said() -> None:
    with pytest.raises(VideoError, match="A video cannot be encoded with libvpx-vp9"):
        write_video([np.zeros((2, 70_000, 3), np.uint8)], io.BytesIO(), VP9, 15)


@pytest.mark.parametrize("codec", [AV1, HEVC12, VP9, H264], ids=lambda codec: codec.encoder)
def test_no_encoder_keeps_others_from_running(codec: Codec, tmp_path: Path) -> None:
    usual = os.sched_getscheduler(0)
    with closing(VideoWriter(tmp_path / "video", codec, 30)) as writer:
        for frame in FRAMES:
            writer.add(frame if codec is not HEVC12 else frame[..., 0].astype(np.uint16))
        threads = [int(each.name) for each in Path("/proc/self/task").iterdir()]
        assert {os.sched_getscheduler(each) for each in threads} == {usual}


def of_many_colours(count: int = 8, size: int = 96) -> list[np.ndarray]:
    """Images that change slowly, so that encoders keep them."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 256, (count, 6, 6, 3), dtype=np.uint8)
    wide = Pillow.Resampling.BICUBIC
    return [np.asarray(Pillow.fromarray(each).resize((size, size), wide)) for each in coarse]


@pytest.mark.parametrize("codec", [AV1, DATA_H264], ids=lambda codec: codec.encoder)
def test_data_is_read_in_its_own_colours_and_says_which_they_are(
    codec: Codec, tmp_path: Path
) -> None:
    """By `to_ndarray`, as LeRobot reads: it cuts fractions off, by 1.2 of 255 in the mean."""
    images, path = of_many_colours(), tmp_path / "video"
    write_video(images, path, codec, 30)
    with av.open(path) as container:
        context = container.streams.video[0].codec_context
        assert (context.colorspace, context.color_range) == (6, 1), "BT.601, limited"
        read = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    errors = np.subtract(read, images, dtype=np.float64)
    assert abs(errors.mean()) < 0.45
    assert np.abs(errors.mean(axis=(0, 1, 2))).max() < 0.75


def test_a_frame_is_read_without_a_shade() -> None:
    image = of_many_colours(1)[0]
    frame = av.VideoFrame.from_ndarray(image, format="rgb24").reformat(format="yuv420p")
    errors, usual = (
        np.subtract(read, image, dtype=np.float64).mean()
        for read in (in_rgb(frame), frame.to_ndarray(format="rgb24"))
    )
    assert abs(errors) < 0.2
    assert usual < -0.8


def test_numbers_of_12_bits_come_back_as_they_were(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    frames = [rng.integers(0, 4096, (34, 50), np.uint16) for _ in range(5)]
    for name in ("one", "two"):
        write_video(frames, tmp_path / name, HEVC12, 30)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()
    with av.open(tmp_path / "one") as container:
        decoded = list(container.decode(video=0))
    for index, (frame, expected) in enumerate(zip(decoded, frames, strict=True)):
        np.testing.assert_array_equal(frame.to_ndarray(format="gray12le"), expected)
        assert frame.time == pytest.approx(index / 30)
