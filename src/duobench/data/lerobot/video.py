"""Videos of images that a policy learns from: AV1, a constant frame rate, every frame kept."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

from duobench.files import replacing
from duobench.types import CONTROL_HZ
from duobench.video import AV1, Image, VideoWriter

FPS = int(CONTROL_HZ)


def describe(size: tuple[int, int]) -> dict[str, Any]:
    """What `meta/info.json` says about a video, under the keys that LeRobot's own writer uses.

    Args:
        size: Height and width in pixels.
    """
    return {
        "video.height": size[0],
        "video.width": size[1],
        "video.codec": "av1",
        "video.pix_fmt": AV1.pixel_format,
        "video.fps": FPS,
        "video.channels": 3,
        "has_audio": False,
        "video.g": int(AV1.options["g"]),
        "video.crf": int(AV1.options["crf"]),
        "video.preset": int(AV1.options["preset"]),
        "video.fast_decode": 0,
        "video.video_backend": "pyav",
        "video.extra_options": {},
        "is_depth_map": False,
    }


def write_videos(frames: Iterable[Mapping[str, Image]], paths: Mapping[str, Path]) -> None:
    """Encode one video a camera side by side; each is whole or absent after a kill.

    Args:
        frames: Images (height, width, 3), both even, by camera, frame by frame.
        paths: Where the video of each camera will be.

    Raises:
        VideoError: The images cannot be encoded.
        OutputError: A file cannot be written.
    """
    with ExitStack() as stack:
        writers = {}
        for camera, path in paths.items():
            temporary = stack.enter_context(replacing(path))
            writers[camera] = stack.enter_context(closing(VideoWriter(temporary, AV1, FPS)))
        for images in frames:
            for camera, writer in writers.items():
                writer.add(images[camera])
