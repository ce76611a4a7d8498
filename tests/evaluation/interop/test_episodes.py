"""Episodes as vla-eval plays them are those of the evaluation, number by number; its parameters."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.core.errors import OptionError, PolicyError, UnknownNameError
from duobench.core.randomness import SUITE_VERSION
from duobench.envs.duo_env import ResetNeededError
from duobench.evaluation.interop.episodes import Episodes, format_for, tasks_by_id
from duobench.evaluation.runners.evaluate import evaluate
from duobench.policy import PolicyMetadata
from duobench.policy.serving.message_format import MessageFormat, read_format
from duobench.results.folder import RunFolder
from duobench.results.suite import Suite, find_tasks
from duobench.tasks import catalog
from tests.evaluation import toy_tasks

TWO_SIZES = {"head": [96, 96], "left_wrist": [1, 1], "right_wrist": [1, 1]}
BLIND = MessageFormat(state={"state": ("left_arm", "left_gripper")})
UP = {1: -1.7, 3: -0.2}
"""Targets of joints of the left arm that lift its tool, in radians."""


class Stretches:
    """Stretches the left arm up, in chunks of five."""

    metadata = PolicyMetadata(name="stretches", version="1")

    def reset(self, instruction: str, seed: int) -> None:
        self.episode = instruction, seed

    def act(self, observation: Any) -> np.ndarray:
        return chunk_of(observation["agent_pos"])


def chunk_of(position: np.ndarray) -> np.ndarray:
    chunk = np.tile(position, (5, 1))
    for joint, target in UP.items():
        chunk[:, joint] = target
    return chunk


@pytest.fixture
def episodes() -> Iterator[Episodes]:
    made = Episodes(BLIND)
    yield made
    made.close()


def test_same_actions_have_the_same_outcome_as_in_an_evaluation(
    tmp_path: Path, episodes: Episodes
) -> None:
    suite = Suite(tasks=find_tasks([toy_tasks.WAVE_NAME, toy_tasks.NOD_NAME]), episodes=2)
    folder = RunFolder(tmp_path / "run")
    results = evaluate(f"{__name__}:Stretches", suite, folder, workers=0, videos=0)
    assert results.overall.errors == 0
    successes = set()
    for task in results.tasks:
        for record in task.records:
            turn = episodes.begin(f"{toy_tasks.__name__}:{record.task.upper()}", record.episode)
            assert not turn.is_last
            while not turn.is_last:
                turn = episodes.execute(chunk_of(turn.observation["agent_pos"]))
            assert episodes._env is not None
            assert episodes._env.get_wrapper_attr("state_hash")() == record.state_hash
            assert (turn.info["stage"], turn.number) == (record.final_stage, record.steps)
            assert turn.info["max_stage"] == record.max_stage
            assert (turn.info["success"], turn.reward) == (record.success, record.progress)
            assert record.suite_version == SUITE_VERSION
            successes.add(record.success)
    assert successes == {True, False}


def test_single_actions_are_chunks_of_one_and_the_horizon_counts_control_steps() -> None:
    episodes = Episodes(BLIND, horizon=7)
    turn = episodes.begin(toy_tasks.WAVE_NAME, 0)
    still = turn.observation["agent_pos"]
    assert episodes.execute(still).number == 1
    assert episodes.execute(np.tile(still, (2, 1))).number == 3
    last = episodes.execute(np.tile(still, (30, 1)))
    assert (last.number, last.is_last, last.info["success"]) == (7, True, False)
    episodes.close()


def test_images_are_rendered_for_whoever_sees_them_and_no_others() -> None:
    message_format = MessageFormat(images={"images.top": "head"}, image_size=(24, 32))
    episodes = Episodes(message_format, horizon=4)
    turn = episodes.begin(toy_tasks.WAVE_NAME, 0)
    shown = episodes.request(turn.observation)
    assert shown["images"]["top"].shape == (24, 32, 3)
    assert shown["prompt"] == "Do the wave."
    still = np.tile(turn.observation["agent_pos"], (3, 1))
    assert "pixels" in episodes.execute(still).observation
    assert "pixels" not in episodes.execute(still).observation  # over before the chunk was
    assert "pixels" in episodes.begin(toy_tasks.WAVE_NAME, 1).observation
    episodes.close()


def test_broken_actions_end_the_episode_and_the_next_can_be_played(episodes: Episodes) -> None:
    with pytest.raises(ResetNeededError, match="begin one"):
        episodes.execute(np.zeros(16))
    with pytest.raises(UnknownNameError, match="Unknown task"):
        episodes.begin("bin_sotr", 0)
    turn = episodes.begin(toy_tasks.WAVE_NAME, 0)
    for broken in (np.full(16, np.nan), np.zeros(14), np.zeros((0, 16)), None, "text"):
        with pytest.raises(PolicyError):
            episodes.execute(broken)  # pyright: ignore[reportArgumentType] - that is the point
    assert episodes.execute(turn.observation["agent_pos"]).number == 1
    assert episodes.begin(toy_tasks.WAVE_NAME, 0).number == 0


@pytest.mark.parametrize("mode", ["joint", "joint_relative", "cartesian", "cartesian_relative"])
def test_hold_action_keeps_the_arms_where_they_are(tmp_path: Path, mode: str) -> None:
    path = tmp_path / "mine.toml"
    order = '["left_arm", "right_arm", "left_gripper", "right_gripper"]'
    path.write_text(f'[actions]\nmode = "{mode}"\norder = {order}')
    with closing(Episodes(read_format(str(path)), horizon=20)) as episodes:
        assert not episodes.hold_action(None).any()
        turn = episodes.begin(toy_tasks.WAVE_NAME, 0)
        before = turn.observation["tcp_pose"]
        for _ in range(5):
            turn = episodes.execute(episodes.hold_action(None))
        np.testing.assert_allclose(turn.observation["tcp_pose"], before, atol=2e-3)
        last = np.arange(sum(episodes.message_format.action_sizes.values()), dtype=np.float32)
        held = episodes.hold_action([last - 1, last])
        assert held.shape == last.shape
        np.testing.assert_array_equal(held[-2:], last[-2:])
        np.testing.assert_array_equal(held[:-2], 0 if mode.endswith("relative") else last[:-2])


@pytest.mark.parametrize(
    "options", [{"control_rate_hz": 10}, {"horizon": 0}, {"binary_gripper": "yes"}]
)
def test_environment_that_does_not_exist_is_refused_at_once(options: dict[str, Any]) -> None:
    with pytest.raises(OptionError):
        Episodes(BLIND, **options)


DEFAULTS: dict[str, Any] = {
    "name": "vla_eval",
    "control_mode": None,
    "relative_to": None,
    "send_state": True,
    "send_wrist_image": True,
    "camera_resolution": None,
}


def chosen(**options: Any) -> MessageFormat:
    return format_for(**DEFAULTS | options)


@pytest.mark.parametrize(
    ("control_mode", "relative_to", "mode"),
    [
        ("joints", None, "joint"),
        (None, "last_step", "joint_relative"),
        ("JOINTS", "NONE", "joint"),
        ("cartesian_tquat", None, "cartesian"),
        ("cartesian_rotvec", "last_step", "cartesian_relative"),
    ],
)
def test_control_mode_and_frame_are_an_action_mode(
    control_mode: str | None, relative_to: str | None, mode: str
) -> None:
    message_format = chosen(control_mode=control_mode, relative_to=relative_to)
    assert message_format.actions.mode == mode


def test_what_is_shown_can_be_less() -> None:
    assert chosen() == read_format("vla_eval")
    message_format = chosen(send_state=False, send_wrist_image=False, camera_resolution=[96, 128])
    assert dict(message_format.images) == {"images.head": "head"}
    assert not message_format.state
    assert message_format.image_size == (96, 128)


@pytest.mark.parametrize(
    ("resolution", "size"),
    [
        ((48, 64), (48, 64)),
        ({name: [48, 64] for name in ("head", "left_wrist", "right_wrist")}, (48, 64)),
        (96, (96, 96)),
        ({"head": 224}, (224, 224)),
        ({}, (224, 224)),
    ],
)
def test_resolution_is_one_for_all_images(resolution: object, size: tuple[int, int]) -> None:
    assert chosen(camera_resolution=resolution).image_size == size


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"control_mode": "cartesian_trpy"}, "joints with none or"),
        ({"control_mode": "cartesian_tquat", "relative_to": "last_step"}, "rotation vector"),
        ({"relative_to": "configured_origin"}, "configured_origin"),
        ({"camera_resolution": {"head": [96, 96]}}, "one size"),
        ({"camera_resolution": TWO_SIZES}, "one size"),
        ({"camera_resolution": {"haed": [96, 96]}}, "Did you mean 'head'"),
        ({"camera_resolution": [9000, 96]}, "at most"),
        ({"camera_resolution": [96]}, "height, width"),
        ({"camera_resolution": "96"}, "height, width"),
        ({"camera_resolution": {"head": None}}, "height, width"),
        ({"name": "vla_evl"}, "Did you mean 'vla_eval'"),
    ],
)
def test_what_there_is_not_is_refused_in_words(options: dict[str, Any], message: str) -> None:
    error = UnknownNameError if message.startswith("Did you mean") else OptionError
    with pytest.raises(error, match=message):
        chosen(**options)


def test_tasks_are_those_of_the_benchmark_or_anybodys() -> None:
    assert tuple(tasks_by_id(None)) == catalog.names()
    assert tasks_by_id(["bin_sort", toy_tasks.WAVE_NAME]) == {
        "bin_sort": "bin_sort",
        "wave": toy_tasks.WAVE_NAME,
    }
    assert tasks_by_id("bin_sort") == {"bin_sort": "bin_sort"}
    with pytest.raises(OptionError, match="named twice"):
        tasks_by_id(["bin_sort", "bin_sort"])
    with pytest.raises(UnknownNameError, match="Did you mean 'bin_sort'"):
        tasks_by_id(["bin_sotr"])
