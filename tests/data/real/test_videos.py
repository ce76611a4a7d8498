"""Episodes of a rig: videos beside the rows, which frame belongs to a row, the arms' full state."""

from __future__ import annotations

from contextlib import closing, suppress
from pathlib import Path

import numpy as np
import pytest

from duobench.core.errors import DataError, OutputError
from duobench.core.types import POLICY_CAMERAS
from duobench.data import DataSet, stream, videos
from duobench.data.images import VideoFrames
from duobench.data.recorder import UNDECIDED
from duobench.data.rig import RigRecorder
from duobench.data.schema import VideoFacts, video_path
from tests.data.real.number_duo import (
    HORIZON,
    PERIOD_S,
    TASK,
    NumberDuo,
    number_in,
    numbers_in,
    play_real,
    real_recorder,
)
from tests.data.tools import ended, only, room


def test_each_row_names_the_frame_that_was_seen_and_the_episode_its_rig(tmp_path: Path) -> None:
    env, duo = real_recorder(tmp_path)
    play_real(env)
    env.close()
    recording, data = only(tmp_path), DataSet(tmp_path)
    info = recording.info
    assert (info.domain, info.is_real, tuple(info.videos)) == ("real", True, POLICY_CAMERAS)
    assert recording.frame.shape == (HORIZON + 1, 3)
    for place, camera in enumerate(POLICY_CAMERAS):
        shown = numbers_in(video_path(data.episodes()[0], camera))
        assert len(shown) == info.videos[camera].frames == HORIZON + 1
        np.testing.assert_array_equal(
            np.array(shown)[recording.frame[:, place]], recording.frame_number[:, place]
        )
        assert recording.frame[:, place].tolist() == list(range(HORIZON + 1))
    np.testing.assert_allclose(recording.frame_age, 0.01)
    assert recording.state.shape == (HORIZON + 1, 0)
    assert info.rig is not None
    assert (info.rig.name, info.rig.hash) == ("simulated", duo.rig.hash)
    assert info.rig.drivers == ("simulated",)
    assert info.cameras["head"]["fps"] == 30


def test_what_arms_say_of_themselves_is_recorded_by_name(tmp_path: Path) -> None:
    env, duo = real_recorder(tmp_path)
    observation, _ = env.reset()
    env.step(observation["agent_pos"])
    duo.state = {}  # as after a fault
    env.step(observation["agent_pos"])
    env.close()
    recording = only(tmp_path)
    names = recording.info.robot_state_names["right"]
    row = dict(zip(names, recording.right_robot_state[1], strict=True))
    assert (row["torques_6"], row["tau_J_6"], row["control_rate"]) == (1.0, 6.0, 1.0)
    assert row["time_s"] == recording.time[1]
    assert np.isnan(recording.left_robot_state[2]).all()


def test_what_is_seen_before_the_first_step_is_seen_again_then(tmp_path: Path) -> None:
    env, duo = real_recorder(tmp_path)
    observation, _ = env.reset()
    for _ in range(100):  # a person places objects
        duo.pass_time(PERIOD_S)
    for _ in range(5):
        env.step(observation["agent_pos"])
    env.close()
    recording = only(tmp_path)
    np.testing.assert_allclose(np.diff(recording.time), PERIOD_S)
    np.testing.assert_allclose(recording.frame_age, 0.01)
    assert recording.frame[:, 0].tolist() == [1, 2, 3, 4, 5, 6]
    assert np.diff(recording.frame_number[:, 0]).tolist() == [1] * 5


def test_videos_of_an_episode_that_waits_are_kept_or_discarded_with_it(tmp_path: Path) -> None:
    env, _ = real_recorder(tmp_path, is_reviewed=True)
    data = DataSet.open(tmp_path)
    play_real(env)
    assert len(data.videos()) == 3
    env.discard()
    assert data.videos() == []
    assert data.partials() == []
    play_real(env)
    env.keep()
    play_real(env, 5)
    env.close()
    kept, left = data.recordings()
    assert (ended(kept).kept, ended(left).reason) == (True, UNDECIDED)
    assert [path.name for path in data.videos()] == [
        f"{number:05d}.{camera}.mp4" for number in range(2) for camera in sorted(POLICY_CAMERAS)
    ]


def test_a_camera_without_a_frame_yet_says_so(tmp_path: Path) -> None:
    duo = NumberDuo()
    duo.cameras["head"].frame = None
    env, _ = real_recorder(tmp_path, duo)
    env.reset()
    env.finish()
    env.close()
    recording = only(tmp_path)
    assert recording.frame.tolist() == [[-1, 0, 0]]
    assert np.isnan(recording.frame_age[0, 0])
    assert recording.info.videos["head"].frames == 0


def test_frames_that_come_while_the_encoder_is_behind_are_left_out_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    env, duo = real_recorder(tmp_path, horizon=400)
    env._rig = RigRecorder(duo)  # in real time, in which nobody waits
    monkeypatch.setattr(videos, "QUEUE", 2)
    play_real(env, 200)
    env.close()
    recording = only(tmp_path)
    places, numbers = recording.frame, recording.frame_number
    for place, (camera, facts) in enumerate(recording.info.videos.items()):
        shown = np.array(numbers_in(video_path(DataSet(tmp_path).episodes()[0], camera)))
        assert facts.frames is not None
        assert facts.frames + facts.left_out == 201
        np.testing.assert_array_equal(shown[places[:, place]], numbers[:, place])


def test_nothing_is_recorded_over_what_is_there(tmp_path: Path) -> None:
    data = DataSet.open(tmp_path)
    orphan = data.episode(TASK, "00000").with_name("00000.head.mp4")
    orphan.parent.mkdir(parents=True)
    orphan.write_bytes(b"precious")
    env, _ = real_recorder(tmp_path)
    env.next_name = "00000"
    with pytest.raises(DataError, match=r"00000\.head\.mp4 exists already"):
        env.reset()
    env.next_name = None
    play_real(env, 3)
    env.close()
    assert [path.stem for path in data.episodes()] == ["00001"]
    assert orphan.read_bytes() == b"precious"


def test_a_full_disk_is_said_and_loses_nothing_that_was_written(tmp_path: Path) -> None:
    env, duo = real_recorder(tmp_path, horizon=400)
    observation, _ = env.reset()
    for number in range(20):
        env.step(observation["agent_pos"] + 0.01 * number)
    with room(2000), pytest.raises(OutputError):  # noqa: PT012 - one of many steps
        for number in range(200):
            env.step(observation["agent_pos"] + 0.001 * number)
    with suppress(OutputError):
        env.close()
    assert "close" in duo.calls
    data = DataSet(tmp_path)
    for partial in data.partials():
        data.recover(partial)
    assert len(only(tmp_path)) >= 15


def test_cameras_need_a_folder() -> None:
    with pytest.raises(DataError, match="data set"):
        real_recorder(None)


def test_rows_whose_frames_were_not_encoded_yet_name_the_newest_that_is(tmp_path: Path) -> None:
    env, _ = real_recorder(tmp_path)
    play_real(env, 30)
    data = DataSet(tmp_path)
    (partial,) = data.partials()
    env._episode.flush()  # type: ignore[union-attr]
    video = video_path(partial, "head")
    whole, counts = video.read_bytes(), []
    for cut in range(0, len(whole), max(1, len(whole) // 12)):
        video.write_bytes(whole[: len(whole) - cut])
        count = videos.count_frames(video)
        recording = stream.recover(partial)
        assert len(recording) == 30
        assert recording.info.videos["head"].frames == count
        frame, number = recording.frame[:, 0], recording.frame_number[:, 0]
        assert frame.tolist() == [min(row, count - 1) for row in range(31)]
        if count:
            shown = numbers_in_first(video, count)
            assert shown[frame].tolist() == number.tolist()
            late = np.maximum(0, np.arange(31) - frame)
            np.testing.assert_allclose(recording.frame_age[:, 0], 0.01 + late * PERIOD_S, atol=1e-6)
        else:
            assert np.isnan(recording.frame_age[:, 0]).all()
        counts.append(count)
    assert counts == sorted(counts, reverse=True)
    assert len(set(counts)) > 5
    video.unlink()
    with pytest.raises(DataError, match=r"head\.mp4 is missing"):
        stream.recover(partial)
    env.discard()
    env.close()


def numbers_in_first(video: Path, count: int) -> np.ndarray:
    with closing(VideoFrames(video)) as frames:
        return np.array([number_in(frames.read(place)) for place in range(count)])


def test_recovered_information_is_that_of_the_beginning(tmp_path: Path) -> None:
    env, _ = real_recorder(tmp_path)
    play_real(env, 9)
    data = DataSet(tmp_path)
    (partial,) = data.partials()
    env._episode.flush()  # type: ignore[union-attr]
    left = partial.read_bytes()
    env.finish()
    partial.write_bytes(left)  # killed after the episode was written
    data.recover(partial)
    assert not partial.exists()
    recording = only(tmp_path)
    assert set(recording.info.begun.videos.values()) == {VideoFacts()}
    env.close()
