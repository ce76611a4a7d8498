"""A recording of three cameras of full size whose process is killed while its encoders are busy."""

from __future__ import annotations

import signal
import sys
from contextlib import closing
from pathlib import Path

import numpy as np

from duobench.cli import main
from duobench.core.types import POLICY_CAMERAS
from duobench.data import DataSet
from duobench.data.images import VideoFrames
from duobench.data.schema import video_path
from duobench.data.stream import BATCH_ROWS
from tests.data.real.number_duo import CountingCamera, NumberDuo, number_in, real_recorder
from tests.data.tools import child_of, ended, only

STEPS = 90


def record(folder: Path) -> None:
    """Record as fast as three encoders can until somebody kills this process."""
    duo = NumberDuo()
    for camera in POLICY_CAMERAS:
        duo.cameras[camera] = CountingCamera((720, 1280))
    duo.pass_time(1.0)
    env, _ = real_recorder(folder, duo, horizon=100_000)
    observation, _ = env.reset()
    for number in range(100_000):
        env.step(observation["agent_pos"])
        sys.stdout.write(f"{number}\n")
        sys.stdout.flush()


def test_a_kill_costs_at_most_a_second(tmp_path: Path) -> None:
    with child_of(__name__, tmp_path) as child:
        assert child.stdout is not None
        lines = []
        for line in child.stdout:
            lines.append(line)
            if len(lines) == STEPS:
                child.send_signal(signal.SIGKILL)
    steps = sum(line.endswith("\n") for line in lines)
    assert steps >= STEPS
    main(["data", "recover", str(tmp_path)])
    recording = only(tmp_path)
    assert 0 <= steps - len(recording) <= BATCH_ROWS + 1
    assert recording.frame_age[-1].max() <= 1.0
    assert np.diff(recording.time - recording.frame_age[:, 0]).min() >= -1e-9
    assert (ended(recording).cut, ended(recording).kept) == (True, False)
    (path,) = DataSet(tmp_path).episodes()
    for place, camera in enumerate(POLICY_CAMERAS):
        with closing(VideoFrames(video_path(path, camera))) as frames:
            for row in (0, len(recording)):
                image = frames.read(int(recording.frame[row, place]))
                assert number_in(image) == recording.frame_number[row, place] % 256
    main(["data", "check", str(tmp_path)])


if __name__ == "__main__":
    record(Path(sys.argv[1]))
