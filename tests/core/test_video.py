import io
import os
from contextlib import closing
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from duobench.core.errors import VideoError
from duobench.core.video import AV1, H264, VP9, Codec, VideoWriter, write_video

FRAMES = [np.full((48, 64, 3), value, np.uint8) for value in (0, 80, 160, 240)]


@pytest.mark.parametrize(("codec", "name"), [(VP9, "vp9"), (AV1, "libdav1d")])
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


@pytest.mark.parametrize("codec", [AV1, VP9, H264], ids=lambda codec: codec.encoder)
def test_no_encoder_keeps_others_from_running(codec: Codec, tmp_path: Path) -> None:
    usual = os.sched_getscheduler(0)
    with closing(VideoWriter(tmp_path / "video", codec, 30)) as writer:
        for frame in FRAMES:
            writer.add(frame)
        threads = [int(each.name) for each in Path("/proc/self/task").iterdir()]
        assert {os.sched_getscheduler(each) for each in threads} == {usual}
