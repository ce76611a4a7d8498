from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pyarrow.parquet as pq
import pytest

import duobench
from duobench.core.errors import ActionError, DataError, OutputError, SimulationError
from duobench.core.types import DuoCommand
from duobench.data import Actor, ActorKind, DataSet, Outcome, Recorder, Recording, stream
from duobench.data.recorder import UNDECIDED
from duobench.data.schema import Takeover
from duobench.envs.action_modes import CARTESIAN
from duobench.envs.action_wrappers import CartesianActions
from duobench.envs.episode_state import EpisodeState
from duobench.tasks import catalog
from tests.data.tools import HORIZON, TASK, ended, only, play, recorded, recorder
from tests.envs.tools import wave


def plain(**options: Any) -> gym.Env:
    return duobench.make(TASK, **{"cameras": False, **options})


@pytest.fixture
def env(tmp_path: Path) -> Iterator[Recorder]:
    made = recorder(tmp_path)
    yield made
    made.close()


def test_rows_hold_what_was_seen_before_each_action_and_what_the_step_gave(
    env: Recorder, tmp_path: Path
) -> None:
    seen = play(env)
    rows = only(tmp_path)
    assert len(rows) == HORIZON
    for name in ("action", "sent", "reward"):
        np.testing.assert_array_equal(getattr(rows, name), [step[name] for step in seen])
    for name in ("agent_pos", "tcp_pose", "stage"):
        np.testing.assert_array_equal(getattr(rows, name)[1:], [step[name] for step in seen])
    np.testing.assert_allclose(rows.time, np.arange(HORIZON + 1) / 30, atol=1e-9)
    change = np.diff(rows.agent_pos[:, :7], axis=0) * 30
    assert np.abs(change).max() > 0.1
    np.testing.assert_allclose(rows.joint_velocity[1:, :7], change, atol=0.3)


def test_the_file_says_everything_about_the_episode(tmp_path: Path) -> None:
    rows = recorded(tmp_path)
    info, env = rows.info, plain(horizon=HORIZON)
    _, expected = env.reset(seed=0)
    assert (info.task, info.seed, info.split) == (TASK, 0, "eval")
    assert (info.layout, info.instruction) == (expected["layout"], expected["instruction"])
    assert info.subinstructions == tuple(expected["stage_to_subinstructions"].values())
    assert info.config == env.get_wrapper_attr("config")
    assert info.versions["mujoco"]
    assert info.actor == Actor(name="wave")
    assert info.first_hash == env.get_wrapper_attr("state_hash")()
    assert info.observation_names[0] == "left_joint_1"
    assert ended(rows) == Outcome(success=False, stage=0, max_stage=catalog.get(TASK).max_stage)


def test_any_row_can_be_continued_from_to_the_last_bit(example: Recording) -> None:
    env = plain(horizon=HORIZON)
    env.reset(options={"layout": example.info.layout})
    sim: Any = env.unwrapped
    sim.restore_state(EpisodeState(layout=sim.layout, physics=example.state[17]))
    for number in range(17, HORIZON):
        sim.step(example.sent[number])
        np.testing.assert_array_equal(sim.simulation.get_state(), example.state[number + 1])


def reset(env: Recorder) -> None:
    env.reset(seed=1)
    env.discard()


def hold(env: Recorder) -> None:
    env.base.backend.hold("Somebody came too near.")
    *_, truncated, _ = env.step(wave(2))
    assert truncated


def restore(env: Recorder) -> None:
    """What follows is not recorded as if the actions before led there."""
    env.restore_state(env.save_state())
    env.step(wave(0))


def diverge(env: Recorder) -> None:
    def command(_command: DuoCommand) -> None:
        env.base.backend.simulation.data.qpos[0] += 1.0  # pyright: ignore
        raise SimulationError("It diverged.")

    env.base.backend.command = command  # pyright: ignore
    with pytest.raises(SimulationError):
        env.step(wave(3))


@pytest.mark.parametrize(
    ("end", "steps", "reason"),
    [
        (reset, 9, "The environment was reset."),
        (Recorder.close, 9, "The environment was closed."),
        (Recorder.close, 0, "The environment was closed."),
        (restore, 5, "Another state was restored."),
        (hold, 3, "Somebody came too near."),
        (diverge, 3, "It diverged."),
    ],
)
def test_an_episode_that_ends_early_is_kept_and_says_why(
    env: Recorder, tmp_path: Path, end: Callable[[Recorder], None], steps: int, reason: str
) -> None:
    is_whole = end is hold  # the arms ended it, with a step of its own
    play(env, steps - is_whole)
    end(env)
    env.close()
    rows = only(tmp_path)
    assert (len(rows), len(rows.state)) == (steps, steps + 1)
    outcome = ended(rows)
    assert (outcome.cut, outcome.kept, outcome.reason) == (not is_whole, True, reason)
    assert (rows.info.last_hash is None) == (end is diverge)


def test_what_an_actor_wanted_is_recorded_beside_what_was_sent(
    env: Recorder, tmp_path: Path
) -> None:
    observation, _ = env.reset(seed=0)
    wanted = observation["agent_pos"]
    disturbed = wanted + np.float32(0.01)
    env.intend(wanted)
    env.step(disturbed)
    env.step(disturbed)
    env.close()
    rows = only(tmp_path)
    np.testing.assert_array_equal(rows.action, np.float64([wanted, disturbed]))
    assert np.abs(rows.sent[0] - wanted)[:7].max() > 0.005


def test_what_was_wanted_stays_wanted_where_a_wrong_action_was_refused(
    env: Recorder, tmp_path: Path
) -> None:
    wanted = env.reset(seed=0)[0]["agent_pos"]
    env.intend(wanted)
    with pytest.raises(ActionError):
        env.step([0.5])
    env.step(wanted + np.float32(0.01))
    env.close()
    np.testing.assert_array_equal(only(tmp_path).action, np.float64([wanted]))


def test_who_acts_is_checked_before_anything_is_recorded(tmp_path: Path) -> None:
    env = Recorder(plain(), tmp_path, "me")  # type: ignore[arg-type]
    with pytest.raises(DataError, match=r"Actor\(name='me'\)"):
        env.reset(seed=0)
    env.actor = Actor(name="me")
    env.reset(seed=0)
    env.close()
    assert only(tmp_path).info.actor.name == "me"


def test_a_name_that_is_taken_is_asked_for_once(env: Recorder, tmp_path: Path) -> None:
    env.next_name = "mine"
    env.step(env.reset(seed=0)[0]["agent_pos"])
    env.finish()
    env.next_name = "mine"
    with pytest.raises(DataError):
        env.reset(seed=1)
    env.reset(seed=1)
    env.close()
    assert len(DataSet(tmp_path).episodes()) == 2


def test_discarded_episodes_leave_nothing(env: Recorder, tmp_path: Path) -> None:
    for steps in (20, 1):
        play(env, steps)
        env.discard()
    data = DataSet(tmp_path)
    assert data.episodes() == data.partials() == []


def test_names_count_on_and_are_never_overwritten(tmp_path: Path) -> None:
    first, second = recorder(tmp_path), recorder(tmp_path)
    for env in (first, second, first):
        play(env, 3)
    first.close()
    second.close()
    assert [path.stem for path in DataSet(tmp_path).episodes()] == ["00000", "00001", "00002"]
    first, second = recorder(tmp_path), recorder(tmp_path)
    first.next_name = "00001"
    with pytest.raises(DataError, match=r"00001\.parquet exists already"):
        first.reset(seed=0)
    first.next_name = second.next_name = "x"
    first.reset(seed=0)
    with pytest.raises(DataError, match="being recorded by another process"):
        second.reset(seed=0)
    first.close()


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: plain(chunk=4), DataError, "single actions"),
        (lambda: gym.wrappers.FlattenObservation(plain()), DataError, "lacks agent_pos, tcp_pose"),
        (
            lambda: gym.wrappers.RescaleAction(plain(), np.float32(-1), np.float32(1)),
            DataError,
            "inside wrappers that scale",
        ),
        (lambda: gym.make("CartPole-v1"), TypeError, "CartPole"),
    ],
)
def test_recorders_say_where_they_belong(
    tmp_path: Path, make: Callable[[], gym.Env], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        Recorder(make(), tmp_path)


@pytest.mark.parametrize("wanted", [0.5, [1.0, 2.0], np.full(16, np.nan)])
def test_actions_that_were_refused_are_not_recorded(
    env: Recorder, tmp_path: Path, wanted: Any
) -> None:
    observation, _ = env.reset(seed=0)
    env.step(observation["agent_pos"])
    for take in (env.intend, env.step):
        with pytest.raises(ActionError):
            take(wanted)
    env.close()
    assert len(only(tmp_path)) == 1


@pytest.mark.parametrize(
    "make",
    [
        lambda: CartesianActions(plain()),
        lambda: gym.wrappers.RecordEpisodeStatistics(gym.Wrapper(plain(action_mode="cartesian"))),
    ],
)
def test_actions_are_named_by_the_wrapper_that_takes_them_through_any_other(
    tmp_path: Path, make: Callable[[], gym.Env]
) -> None:
    env = Recorder(make(), tmp_path)
    observation, _ = env.reset(seed=0)
    poses = observation["tcp_pose"].reshape(2, 7)
    env.step(np.hstack([poses, np.ones((2, 1))]).ravel())
    env.close()
    info = only(tmp_path).info
    assert info.action_names[:3] == ("left_x", "left_y", "left_z")
    assert info.mode is CARTESIAN


@pytest.mark.parametrize(
    ("name", "error", "message"),
    [
        *((name, DataError, "cannot be named") for name in ("", "../../x", "a/b", ".x")),
        ("x" * 300, OutputError, "too long"),
    ],
)
def test_a_name_stays_in_the_folder(
    env: Recorder, name: str, error: type[Exception], message: str
) -> None:
    env.next_name = name
    with pytest.raises(error, match=message):
        env.reset(seed=0)


def test_a_reset_that_cannot_be_recorded_leaves_nothing(tmp_path: Path) -> None:
    inner = plain()
    short = gym.wrappers.TransformObservation(
        inner, lambda seen: {**seen, "agent_pos": seen["agent_pos"][:15]}, inner.observation_space
    )
    env = Recorder(short, tmp_path)
    with pytest.raises(ValueError, match="broadcast"):
        env.reset(seed=0)
    env.close()
    assert not DataSet(tmp_path).partials()


# --- episodes that wait for a decision, and rows that say which hands led --------------------


def reviewed(folder: Path | None) -> Recorder:
    return Recorder(plain(horizon=HORIZON), folder, Actor(), is_reviewed=True, has_clutch=True)


def test_a_finished_episode_waits_until_somebody_decides(tmp_path: Path) -> None:
    env, data = reviewed(tmp_path), DataSet.open(tmp_path)
    play(env)
    assert env.pending is not None
    assert not data.episodes()
    (partial,) = data.partials()
    assert len(stream.recover(partial)) == HORIZON  # a kill loses nothing now
    env.keep()
    assert env.pending is None
    play(env, seed=1)
    env.discard()
    env.keep()
    recording = only(tmp_path)
    assert (ended(recording).kept, recording.info.seed) == (True, 0)
    assert recording.info.last_hash is not None
    assert not data.partials()
    env.close()


@pytest.mark.parametrize("steps", [HORIZON, 5])
def test_an_episode_that_is_left_undecided_says_so(tmp_path: Path, steps: int) -> None:
    env = reviewed(tmp_path)
    play(env, steps)
    reset(env)
    env.close()
    recording = only(tmp_path)
    outcome = ended(recording)
    assert (outcome.kept, outcome.cut, outcome.reason) == (False, steps < HORIZON, UNDECIDED)
    assert len(recording) == steps


def test_without_a_data_set_an_episode_waits_in_memory() -> None:
    env = reviewed(None)
    play(env)
    assert env.content is None
    env.keep()
    assert env.content is not None
    assert not Recording.read_info(env.content).is_real
    env.close()


def test_rows_say_which_hands_led_where_there_is_a_clutch(
    tmp_path: Path, example: Recording
) -> None:
    env = reviewed(tmp_path)
    observation, _ = env.reset(seed=0)
    states = [(False, False), (True, False), (True, True), (False, True)]
    for env.clutch in states:
        env.step(observation["agent_pos"])
    env.finish()
    env.keep()
    env.close()
    clutch = only(tmp_path).clutch
    assert (clutch.dtype, clutch.tolist()) == (np.bool_, list(map(list, states)))
    assert example.clutch.shape == (HORIZON, 0)
    with pytest.raises(DataError, match="'clutch' has shape"):
        replace(example, clutch=np.ones((HORIZON, 2), dtype=bool))


# --- episodes that several led ------------------------------------------------------------------

POLICY = Actor(kind=ActorKind.POLICY, name="act")
PERSON = Actor(kind=ActorKind.PERSON, name="P01")


def taken_over(env: Recorder) -> None:
    """Four steps of a policy, three of a person, and two of the policy again."""
    hold, _ = env.reset(seed=0)
    for step in range(9):
        if step == 4:
            env.take_over(PERSON)
        if step == 6:
            env.explain("dropped")
        if step == 7:
            env.leader = None
        env.step(hold["agent_pos"])


def test_rows_say_who_led_and_why_also_after_a_kill(tmp_path: Path) -> None:
    env, data = Recorder(plain(horizon=20), tmp_path, POLICY), DataSet.open(tmp_path)
    taken_over(env)
    (partial,) = data.partials()
    left = stream.recover(partial)
    env.device = "gamepad"
    env.take_over(PERSON, "no row of it follows")
    env.finish()
    whole = only(tmp_path)
    assert whole.leader.tolist() == [0, 0, 0, 0, 1, 1, 1, 0, 0]
    assert whole.info.leaders == (POLICY, replace(PERSON, device="gamepad"))
    assert left.info.leaders == (POLICY, PERSON)
    assert left.leader.tolist() == whole.leader.tolist()[: len(left)]
    assert whole.info.takeovers == (Takeover(step=4, why="dropped"),)
    assert left.info.takeovers == whole.info.takeovers
    with pytest.raises(DataError, match="'leader' counts from 0 to 1, and 1 led"):
        replace(whole, info=replace(whole.info, leaders=()))
    env.close()


def test_an_episode_of_one_leader_says_no_more_than_that(tmp_path: Path) -> None:
    env = Recorder(plain(horizon=20), tmp_path, POLICY)
    hold, _ = env.reset(seed=0)
    env.leader = PERSON
    env.step(hold["agent_pos"])
    env.close()
    (path,) = DataSet.open(tmp_path).episodes()
    rows = Recording.read(path)
    assert (rows.info.actor, rows.info.leaders) == (PERSON, ())
    assert rows.leader.tolist() == [0]
    assert "leader" not in pq.read_schema(path).names
