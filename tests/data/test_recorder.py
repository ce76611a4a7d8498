from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import duobench
from duobench.data import Actor, DataSet, Recorder
from duobench.envs.action_modes import CARTESIAN
from duobench.envs.action_wrappers import CartesianActions
from duobench.envs.episode_state import EpisodeState
from duobench.errors import ActionError, DataError, OutputError, SimulationError
from duobench.types import DuoCommand
from tests.data.tools import HORIZON, TASK, ended, only, play, recorded, recorder
from tests.envs.tools import wave


def test_rows_hold_what_was_seen_before_each_action_and_what_the_step_gave(tmp_path: Path) -> None:
    env = recorder(tmp_path)
    seen = play(env)
    rows = only(tmp_path)
    assert len(rows) == HORIZON
    for number, step in enumerate(seen):
        np.testing.assert_array_equal(rows.action[number], np.float64(step["action"]))
        np.testing.assert_array_equal(rows.sent[number], step["sent"])
        assert rows.reward[number] == step["reward"]
        np.testing.assert_array_equal(rows.agent_pos[number + 1], step["agent_pos"])
        np.testing.assert_array_equal(rows.tcp_pose[number + 1], step["tcp_pose"])
        assert rows.stage[number + 1] == step["stage"]
    np.testing.assert_allclose(rows.time, np.arange(HORIZON + 1) / 30, atol=1e-9)
    change = np.diff(rows.agent_pos[:, :7], axis=0) * 30
    assert np.abs(change).max() > 0.1
    np.testing.assert_allclose(rows.joint_velocity[1:, :7], change, atol=0.3)


def test_the_file_says_everything_about_the_episode(tmp_path: Path) -> None:
    rows = recorded(tmp_path)
    info = rows.info
    env = duobench.make(TASK, cameras=False, horizon=HORIZON)
    _, expected = env.reset(seed=0)
    assert (info.task, info.seed, info.split) == (TASK, 0, "eval")
    assert info.layout == expected["layout"]
    assert info.instruction == expected["instruction"]
    assert info.subinstructions == tuple(expected["stage_to_subinstructions"].values())
    assert info.config == env.get_wrapper_attr("config")
    assert info.versions["mujoco"]
    assert info.actor == Actor(name="wave")
    assert info.first_hash == env.get_wrapper_attr("state_hash")()
    outcome = ended(rows)
    assert (outcome.success, outcome.stage, outcome.cut) == (False, 0, False)
    assert info.observation_names[0] == "left_joint_1"


def test_any_row_can_be_continued_from_to_the_last_bit(tmp_path: Path) -> None:
    rows = recorded(tmp_path)
    env = duobench.make(TASK, cameras=False, horizon=HORIZON)
    env.reset(options={"layout": rows.info.layout})
    sim = env.unwrapped
    state = EpisodeState(layout=sim.layout, physics=rows.state[17])
    sim.restore_state(state)
    for number in range(17, HORIZON):
        sim.step(rows.sent[number])
        np.testing.assert_array_equal(sim.simulation.get_state(), rows.state[number + 1])


@pytest.mark.parametrize(("how", "steps"), [("reset", 9), ("close", 9), ("close", 0)])
def test_an_episode_that_is_left_early_is_kept_and_says_so(
    tmp_path: Path, how: str, steps: int
) -> None:
    env = recorder(tmp_path)
    play(env, steps)
    if how == "reset":
        env.reset(seed=1)
        env.discard()
    env.close()
    rows = only(tmp_path)
    assert (len(rows), len(rows.state)) == (steps, steps + 1)
    assert ended(rows).cut
    assert how in str(ended(rows).reason)


def test_an_episode_that_the_arms_end_says_why(tmp_path: Path) -> None:
    env = recorder(tmp_path)
    play(env, steps=2)
    env.base.backend.hold("Somebody came too near.")
    *_, truncated, _ = env.step(wave(2))
    assert truncated
    outcome = ended(only(tmp_path))
    assert (outcome.cut, outcome.kept, outcome.reason) == (False, True, "Somebody came too near.")
    env.close()


def test_what_an_actor_wanted_is_recorded_beside_what_was_sent(tmp_path: Path) -> None:
    env = recorder(tmp_path)
    observation, _ = env.reset(seed=0)
    wanted = observation["agent_pos"]
    disturbed = wanted + np.float32(0.01)
    env.intend(wanted)
    env.step(disturbed)
    env.step(disturbed)
    env.close()
    rows = only(tmp_path)
    np.testing.assert_array_equal(rows.action[0], np.float64(wanted))
    np.testing.assert_array_equal(rows.action[1], np.float64(disturbed))
    assert np.abs(rows.sent[0] - wanted)[:7].max() > 0.005


def test_discarded_episodes_leave_nothing(tmp_path: Path) -> None:
    env = recorder(tmp_path)
    for steps in (20, 1):
        play(env, steps)
        env.discard()
    env.close()
    data = DataSet.open(tmp_path)
    assert not data.episodes()
    assert not data.partials()


def test_names_count_on_and_are_never_overwritten(tmp_path: Path) -> None:
    for episodes in (2, 1):
        env = recorder(tmp_path)
        for _ in range(episodes):
            play(env, steps=3)
        env.close()
    assert [path.stem for path in DataSet.open(tmp_path).episodes()] == ["00000", "00001", "00002"]
    env = recorder(tmp_path)
    env.next_name = "00001"
    with pytest.raises(DataError, match=r"00001\.parquet exists already"):
        env.reset(seed=0)


def test_two_recorders_at_once_take_different_names(tmp_path: Path) -> None:
    first, second = recorder(tmp_path), recorder(tmp_path)
    for env in (first, second):
        env.reset(seed=0)
    first.close()
    second.close()
    assert len(DataSet.open(tmp_path).episodes()) == 2
    first, second = recorder(tmp_path), recorder(tmp_path)
    first.next_name = second.next_name = "x"
    first.reset(seed=0)
    with pytest.raises(DataError, match="being recorded by another process"):
        second.reset(seed=0)
    first.close()


def test_recorders_say_where_they_belong(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="single actions"):
        recorder(tmp_path, chunk=4)
    plain = duobench.make(TASK, cameras=False)
    with pytest.raises(DataError, match="lacks agent_pos, tcp_pose"):
        Recorder(gym.wrappers.FlattenObservation(plain), tmp_path)
    with pytest.raises(TypeError):
        Recorder(gym.make("CartPole-v1"), tmp_path)


def test_a_restored_state_is_not_recorded_as_if_actions_led_there(tmp_path: Path) -> None:
    env = recorder(tmp_path)
    env.reset(seed=0)
    state = env.save_state()
    for number in range(5):
        env.step(wave(number))
    env.restore_state(state)
    env.step(wave(0))
    env.close()
    rows = only(tmp_path)
    assert len(rows) == 5
    assert "restored" in str(ended(rows).reason)


@pytest.mark.parametrize("wanted", [0.5, [1.0, 2.0], np.full(16, np.nan)])
def test_actions_that_were_refused_are_not_recorded(tmp_path: Path, wanted: Any) -> None:
    env = recorder(tmp_path)
    observation, _ = env.reset(seed=0)
    env.step(observation["agent_pos"])
    for take in (env.intend, env.step):
        with pytest.raises(ActionError):
            take(wanted)
    env.close()
    assert len(only(tmp_path)) == 1


def test_actions_are_named_by_the_wrapper_that_takes_them(tmp_path: Path) -> None:
    env = Recorder(CartesianActions(duobench.make(TASK, cameras=False)), tmp_path)
    observation, _ = env.reset(seed=0)
    poses = observation["tcp_pose"].reshape(2, 7)
    env.step(np.hstack([poses, np.ones((2, 1))]).ravel())
    env.close()
    rows = only(tmp_path)
    assert rows.info.action_names[:3] == ("left_x", "left_y", "left_z")
    assert rows.info.mode is CARTESIAN
    scaled = gym.wrappers.RescaleAction(
        duobench.make(TASK, cameras=False), np.float32(-1), np.float32(1)
    )
    with pytest.raises(DataError, match="inside wrappers that scale"):
        Recorder(scaled, tmp_path)


def test_a_step_that_broke_has_no_last_state(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    env = recorder(tmp_path)
    play(env, steps=3)

    def diverge(command: DuoCommand) -> None:
        env.base.backend.simulation.data.qpos[0] += 1.0  # pyright: ignore[reportAttributeAccessIssue]
        raise SimulationError(f"It diverged at {command.flat[0]}.")

    monkeypatch.setattr(env.base.backend, "command", diverge)
    with pytest.raises(SimulationError):
        env.step(wave(3))
    env.close()
    rows = only(tmp_path)
    assert len(rows) == 3
    assert rows.info.last_hash is None
    assert "diverged" in str(ended(rows).reason)


@pytest.mark.parametrize("name", ["", "../../x", "a/b", ".x"])
def test_a_name_stays_in_the_folder(tmp_path: Path, name: str) -> None:
    env = recorder(tmp_path)
    env.next_name = name
    with pytest.raises(DataError, match="cannot be named"):
        env.reset(seed=0)
    env.next_name = "x" * 300
    with pytest.raises(OutputError, match="too long"):
        env.reset(seed=0)
    env.close()


def test_a_reset_that_cannot_be_recorded_leaves_nothing(tmp_path: Path) -> None:
    plain = duobench.make(TASK, cameras=False)
    short = gym.wrappers.TransformObservation(
        plain, lambda seen: {**seen, "agent_pos": seen["agent_pos"][:15]}, plain.observation_space
    )
    env = Recorder(short, tmp_path)
    with pytest.raises(ValueError, match="broadcast"):
        env.reset(seed=0)
    env.close()
    assert not DataSet(tmp_path).partials()
