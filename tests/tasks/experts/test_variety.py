"""Variety: within its ranges, decided by task and seed, and none of it without being asked for."""

import numpy as np
import pytest

from duobench.core.types import OPENING_SLOTS, SIDES, Side
from duobench.evaluation.policies import ExpertPolicy
from duobench.tasks.experts.variety import HUMAN, NONE, STRAIGHT, WIDE, Variety, VarietySample
from tests.tasks.experts.baseline_episodes import Episode, make, play

TASK = "bin_sort"
VARIED = pytest.mark.parametrize("variety", [HUMAN, WIDE], ids=lambda variety: variety.name)
SEEDS = range(200)
WAY = np.array([0.3, -0.2, 0.1])


def samples(variety: Variety) -> list[VarietySample]:
    return [VarietySample(variety, TASK, seed) for seed in SEEDS]


def numbers(sample: VarietySample) -> list[float]:
    """Some of everything that an episode asks for."""
    return [
        sample.pace(1.0),
        sample.pause_steps([Side.LEFT], 1.0),
        *sample.detour(WAY, 1.0),
        *sample.grasp_offset(1.0).tquat,
        *sample.disturbance(np.ones(2)).ravel(),
    ]


@pytest.mark.parametrize(("variety", "freedom"), [(NONE, 1.0), (HUMAN, 0.0), (WIDE, 0.0)])
def test_without_variety_or_freedom_a_motion_is_that_of_the_script(
    variety: Variety, freedom: float
) -> None:
    for sample in samples(variety)[:20]:
        assert variety is not NONE or sample.pause_steps(SIDES, freedom) == 0
        sample.pause_steps(SIDES, freedom)
        assert sample.pace(freedom) == 1.0
        assert sample.pause_steps(SIDES, freedom) == 0
        assert not sample.detour(WAY, freedom).any()
        assert np.array_equal(sample.grasp_offset(freedom).rotation, np.eye(3))
        assert not sample.grasp_offset(freedom).translation.any()
        assert variety is not NONE or sample.ordered(SIDES, -0.1) == SIDES
        assert not sample.disturbance(np.full(2, freedom)).any()


def test_a_sample_follows_from_task_seed_and_variety() -> None:
    expected = numbers(VarietySample(HUMAN, TASK, 3))
    assert numbers(VarietySample(HUMAN, TASK, 3)) == expected
    for other in (
        VarietySample(HUMAN, TASK, 4),
        VarietySample(HUMAN, "carry_pot", 3),
        VarietySample(WIDE, TASK, 3),
    ):
        assert numbers(other) != expected


@VARIED
def test_motions_keep_to_the_speeds_of_the_design(variety: Variety) -> None:
    paces = [sample.pace(1.0) for sample in samples(variety)]
    assert min(paces) >= 0.6
    assert max(paces) <= 1.3
    assert np.ptp(paces) > 0.4


@VARIED
def test_detours_lead_to_one_side_and_never_down(variety: Variety) -> None:
    detours = np.array([sample.detour(WAY, 1.0) for sample in samples(variety)])
    sizes = np.linalg.norm(detours, axis=1)
    assert np.abs(detours @ WAY).max() < 1e-9
    assert (detours[:, 2] >= 0.0).all()
    assert 0.0 < sizes.min() < sizes.max() <= variety.max_detour
    short = 0.99 * STRAIGHT * WAY / np.linalg.norm(WAY)
    assert not any(sample.detour(short, 1.0).any() for sample in samples(variety))
    assert not any(sample.detour(np.zeros(3), 1.0).any() for sample in samples(variety))


@VARIED
def test_each_arm_begins_later_and_pauses_now_and_then(variety: Variety) -> None:
    first, pauses = [], []
    for sample in samples(variety):
        first += [sample.pause_steps([side], 1.0) for side in SIDES]
        pauses += [sample.pause_steps([side], 1.0) for side in SIDES]
    assert 0 <= min(first) < max(first) <= 30 * variety.start_delay.high
    assert max(pauses) <= 30 * variety.pause.high
    assert np.count_nonzero(pauses) / len(pauses) == pytest.approx(variety.pause_chance, abs=0.06)


@VARIED
def test_the_nearer_arm_goes_first_so_that_the_order_is_seen(variety: Variety) -> None:
    for sample in samples(variety)[:20]:
        assert sample.ordered(SIDES, 0.02) == (Side.LEFT, Side.RIGHT)
        assert sample.ordered(SIDES[::-1], -0.02) == (Side.RIGHT, Side.LEFT)
    assert VarietySample(NONE, TASK, 0).ordered(SIDES, -0.02) == SIDES


@VARIED
def test_grasps_are_shifted_as_far_as_they_may_be(variety: Variety) -> None:
    offsets = [sample.grasp_offset(1.0) for sample in samples(variety)]
    shifts = np.abs([offset.translation for offset in offsets])
    limits = np.array([variety.grasp_shift, 0.0, variety.grasp_depth])
    assert (shifts <= limits).all()
    assert (shifts.max(axis=0) >= 0.9 * limits).all()


@VARIED
def test_noise_is_as_strong_as_it_should_be_and_forgets_itself(variety: Variety) -> None:
    sample = VarietySample(variety, TASK, 0)
    noise = np.array([sample.disturbance(np.ones(2)) for _ in range(20_000)])
    assert noise[100:].std() == pytest.approx(variety.noise, rel=0.1)
    assert np.abs(np.diff(noise, axis=0)).max() < 3.0 * variety.noise
    late, early = noise[60:], noise[:-60]
    assert abs((late * early).mean()) < 0.2 * variety.noise**2


@pytest.fixture(scope="module")
def episodes() -> list[Episode]:
    """Episodes of one layout, by two seeds of the expert."""
    found = []
    for seed in (0, 1):
        env = make(TASK)
        found.append(play(env, ExpertPolicy(env, HUMAN), 0, expert_seed=seed))
        env.close()
    return found


def test_another_seed_is_another_path_in_the_same_layout(episodes: list[Episode]) -> None:
    one, other = episodes
    steps = min(len(one.actions), len(other.actions))
    assert np.abs(np.subtract(one.actions[:steps], other.actions[:steps])).max() > 0.05


@pytest.mark.parametrize("variety", [NONE, HUMAN], ids=lambda variety: variety.name)
def test_noise_is_in_the_executed_action_and_not_in_the_intended_one(variety: Variety) -> None:
    env = make(TASK)
    expert = ExpertPolicy(env, variety)
    observation, info = env.reset(seed=0)
    expert.reset(info["instruction"], 0)
    assert expert.intended_action is None
    noise, over = [], False
    while not over:
        executed = np.asarray(expert.act(observation), dtype=np.float32)[0]
        intended = expert.intended_action
        assert intended is not None
        assert (intended.shape, intended.dtype) == ((16,), np.float32)
        noise.append(executed - intended)
        observation, _, terminated, truncated, info = env.step(executed)
        over = terminated or truncated
    env.close()
    assert info["success"]
    size = np.abs(noise).max(axis=1)
    assert not np.array(noise)[:, OPENING_SLOTS].any()
    if variety is NONE:
        assert not size.any()
    else:
        assert 0.3 * variety.noise < size.max() < 6.0 * variety.noise
        assert (size == 0.0).sum() > 10  # it fades before what must be precise
