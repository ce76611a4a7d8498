"""Episodes on MuJoCo Warp are near those on threads; here on a processor, which it can use too."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations
from typing import Any

import mujoco_warp
import numpy as np
import pytest

import duobench
from dev.benchmarks import warp as benchmark
from duobench.core.errors import OptionError, SimulationError
from duobench.envs import sim_of
from duobench.envs.batch_env import BatchEnv
from duobench.tasks import catalog
from duobench.world.objects.blocks import RED
from duobench.world.objects.prop import Prop, Variant
from duobench.world.objects.shapes import sphere
from duobench.world.objects.solid import Solid
from duobench.world.sim import warp_batch
from duobench.world.sim.simulation import Simulation
from tests.envs.tools import make_small, vectors, waves
from tests.tasks.experts.baseline_episodes import SEEDS, baseline

COUNT, SEED, STEPS = 2, 3, 4
NEAR = 1e-3
"""Metres and radians by which numbers may differ after a few steps without a grasp; where marbles
rest on each other they do by 3e-4, elsewhere by less than 1e-4."""


@pytest.fixture
def several() -> Iterator[Callable[..., BatchEnv]]:
    """Makes vector environments on Warp, unless they are told another engine."""
    yield from vectors(engine="warp")


def check_near(one: dict[str, Any], other: dict[str, Any]) -> None:
    assert one.keys() == other.keys()
    for name, numbers in one.items():
        np.testing.assert_allclose(numbers, other[name], atol=NEAR, err_msg=name)


@pytest.mark.parametrize("task", catalog.names())
def test_first_steps_are_near_those_on_threads(several: Callable[..., BatchEnv], task: str) -> None:
    there = several(task, object_state=True)
    here = several(task, engine="mujoco", threads=1, object_state=True)
    assert there.metadata["engine"] == "warp"
    assert "engine" not in here.metadata
    result = there.reset(seed=SEED), here.reset(seed=SEED)
    for wave in waves(STEPS):
        check_near(result[0][0], result[1][0])
        touching = [each.simulations.contacts.owners for each in (there, here)]
        assert touching[0] == touching[1]
        for pair in combinations(touching[0], 2):
            touch = [each.simulations.contacts.between(*pair) for each in (there, here)]
            assert np.array_equal(*touch), pair
        result = tuple(each.step(np.tile(wave, (COUNT, 1))) for each in (there, here))
        assert np.array_equal(result[0][-1]["stage"], result[1][-1]["stage"])


@pytest.mark.parametrize("task", ["transfer_reorient", "bin_sort"])
def test_what_an_expert_did_succeeds_there_as_well(
    several: Callable[..., BatchEnv], task: str
) -> None:
    """The first loses its peg where edges on faces have one contact."""
    episodes = baseline(task)
    vector = several(task, len(SEEDS))
    vector.reset(seed=list(SEEDS))
    reached = np.zeros(len(SEEDS), dtype=int)
    for step in range(max(len(episode.actions) for episode in episodes)):
        last = [min(step, len(episode.actions) - 1) for episode in episodes]
        rows = zip(episodes, last, strict=True)
        *_, info = vector.step(np.stack([episode.actions[at] for episode, at in rows]))
        reached = np.maximum(reached, info["stage"])
    assert reached.tolist() == info["max_stage"].tolist()


def test_a_state_goes_over_to_one_environment_and_back(several: Callable[..., BatchEnv]) -> None:
    vector, env = several("ball_maze"), make_small("ball_maze")
    vector.reset(seed=SEED)
    vector.step(np.tile(waves(1)[0], (COUNT, 1)))
    state = vector.save_state(1)
    observation, _ = env.get_wrapper_attr("restore_state")(state)
    again, _ = vector.reset(
        options={"states": [state, None], "reset_mask": np.array([True, False])}
    )
    for name, numbers in observation.items():
        np.testing.assert_allclose(again[name][0], numbers, atol=1e-6)
    assert sim_of(env).simulation.variants == vector.simulations.world(0).variants
    env.close()


def test_walls_that_a_board_lacks_are_not_there(several: Callable[..., BatchEnv]) -> None:
    vector = several("ball_maze")
    vector.reset(seed=SEED)
    engine = vector.simulations
    sizes = engine._model.geom_size.numpy()  # type: ignore[attr-defined]
    for number in range(COUNT):
        model = engine.world(number).model
        solid, _ = engine.simulation.touches
        gone = (model.geom_contype == 0) & (solid != 0)
        assert gone.any()
        assert np.array_equal(sizes[number].max(axis=1) <= warp_batch._GRAIN, gone)


def test_images_are_those_of_the_state(several: Callable[..., BatchEnv]) -> None:
    options = {"cameras": ("head",), "image_size": (24, 32)}
    vector, env = several("bin_sort", **options), make_small("bin_sort", **options)
    seen, _ = vector.reset(seed=SEED)
    alone, _ = env.reset(seed=SEED + 1)
    off = np.abs(seen["pixels"]["head"][1].astype(int) - alone["pixels"]["head"])
    assert np.mean(off > 1) < 0.01  # edges fall on other pixels
    env.close()


def test_what_has_no_room_is_an_error_and_a_reset_goes_on(
    several: Callable[..., BatchEnv], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(warp_batch, "CONSTRAINTS", 30)
    vector = several("bin_sort")
    vector.reset(seed=SEED)
    with pytest.raises(SimulationError, match=r"environments \[0, 1\]: contacts had no room"):
        vector.step(vector.action_space.sample())
    vector.reset(seed=SEED)


def test_numbers_that_are_none_are_an_error(several: Callable[..., BatchEnv]) -> None:
    vector = several("bin_sort")
    vector.reset(seed=SEED)
    speeds = vector.simulations.arrays["qvel"].copy()  # type: ignore[attr-defined]
    speeds[1] = np.nan
    engine = vector.simulations
    engine._data.qvel.assign(speeds)  # type: ignore[attr-defined]
    with pytest.raises(SimulationError, match=r"environments \[1\]: numbers are no longer valid"):
        vector.step(vector.action_space.sample())


def test_more_than_memory_holds_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise RuntimeError("Failed to allocate 7 bytes on device 'cuda:0'")

    monkeypatch.setattr(mujoco_warp, "put_data", full)
    with pytest.raises(OptionError, match="cannot step 2 simulations of this model: Failed"):
        duobench.make_vec("bin_sort", COUNT, engine="warp")


def test_a_variant_without_a_shape_that_is_no_box_is_refused() -> None:
    prop = Prop(
        name="thing",
        solid=Solid(shapes=(sphere(0.02),), rgba=RED),
        choice="kind",
        variants={"all": Variant(), "none": Variant(without_shapes=frozenset({0}))},
    )
    with pytest.raises(OptionError, match="boxes in boxes only: thing"):
        warp_batch.WarpBatch(Simulation([prop]), 1)


def test_without_a_card_its_speed_is_measured_against_no_bar() -> None:
    (measured,) = benchmark.measure("bin_sort")
    assert measured.value > 0
    assert measured.at_least is None
    assert f"{benchmark.ON_PROCESSOR} at once" in measured.what
