"""The encodings of videos, as values; `core.video` encodes."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True, slots=True)
class Codec:
    """Encoding of videos: the same frames give the same bytes."""

    encoder: str
    """Name in FFmpeg, as for `container`, the format of the file."""
    options: Mapping[str, str]
    container: str
    container_options: Mapping[str, str] = field(default_factory=dict)
    pixel_format: str = "yuv420p"
    """Pixel format of a frame; this one needs an even height and width."""
    is_data: bool = False
    """Whether it is to learn from: `core.video.in_yuv` converts its colours, and the stream says
    how."""


VP9 = Codec(
    encoder="libvpx-vp9",
    options={"deadline": "realtime", "cpu-used": "6", "crf": "33", "b": "0"},
    container="webm",
)
"""To look at: every current browser plays it, also those that come without licensed codecs."""
AV1 = Codec(
    encoder="libsvtav1",
    options={"crf": "30", "g": "2", "preset": "9", "svtav1-params": "lp=1"},
    container="mp4",
    container_options={
        "movflags": "faststart"
    },  # the index first: reading begins at once
    is_data=True,
)
"""To learn from, with LeRobot's defaults but for the preset: with groups of two frames, a training
reads frames in any order without decoding many others. LeRobot's preset 12 keeps less of every
second frame, and 8 takes nearly twice the time to be a sixth smaller (540 frames of two tasks: 42.2
dB there with 8 and 9, 41.7 with 12). One thread (lp): episodes are what runs in parallel."""
DATA_H264 = Codec(
    encoder="libx264",
    options={"preset": "superfast", "crf": "20", "g": "2", "bf": "0"},
    container="mp4",
    container_options={"movflags": "faststart"},
    is_data=True,
)
"""To learn from as well: a fifth of the time of `AV1` and twice its size (160 rows of four tasks,
three cameras of 224 pixels: 3.9 and 22 ms, 7.8 and 4.1 kB a row, 39.8 and 39.2 dB)."""
H264 = Codec(
    encoder="libx264",
    options={"preset": "ultrafast", "tune": "zerolatency", "crf": "20", "g": "15"},
    container="mp4",
    container_options={
        "movflags": "frag_every_frame+empty_moov+default_base_moof",
        "flush_packets": "1",
    },
)
"""To record with: three cameras in real time on one core, and every frame is in the file as soon as
it is encoded, so that a process that is killed leaves a video that can be read. A key frame every
half second."""

HEVC12 = Codec(
    encoder="libx265",
    options={
        "preset": "veryfast",
        "g": "2",
        "x265-params": "lossless=1:pools=none:frame-threads=1:info=0:log-level=none",
    },
    container="mp4",
    container_options={"movflags": "faststart"},
    pixel_format="gray12le",
)
"""To keep whole numbers below 4096, such as codes of depth: without loss, in groups of two frames,
as LeRobot does. Slower presets are no smaller."""
