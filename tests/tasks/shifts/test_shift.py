import math
from dataclasses import astuple, replace
from itertools import pairwise

import numpy as np
import pytest

from duobench.core.errors import OptionError, UnknownNameError
from duobench.tasks import catalog
from duobench.tasks.shifts import levels
from duobench.tasks.shifts.levels import latency_steps
from duobench.tasks.shifts.samples import (
    UNSCALED,
    EpisodeKey,
    OutsidePlacement,
    kept_paraphrase,
    physics_scale,
    shifted_look,
    shifted_task,
)
from duobench.tasks.shifts.shift import (
    AXES,
    EVERY_AXIS,
    LEVELS,
    NO_SHIFT,
    RENDERER,
    Shift,
    every_shift,
)
from duobench.world.looks.catalog import look as named_look
from duobench.world.looks.look import Look, Material

KEYS = [EpisodeKey(task="bin_sort", seed=seed, split="eval") for seed in range(40)]


def test_names_lead_back_to_shifts() -> None:
    shifts = list(every_shift())
    assert len(shifts) == len(set(shifts)) == 1 + len(AXES) * LEVELS
    assert [Shift.parse(shift.name) for shift in shifts] == shifts


@pytest.mark.parametrize("text", ["look", "look-0", "look-6", "none-1", "look-a", "", "look--1"])
def test_other_names_are_refused(text: str) -> None:
    with pytest.raises(OptionError):
        Shift.parse(text)
    with pytest.raises(UnknownNameError, match="looks"):
        Shift.parse("looks-1")


def test_all_axes_are_every_axis_at_once() -> None:
    shift = Shift(axis="all", level=3)
    assert {shift.level_of(axis) for axis in AXES} == {3}
    assert {Shift(axis="look", level=3).level_of(axis) for axis in AXES} == {0, 3}


def test_levels_rise_along_every_axis() -> None:
    rows = [
        value for name, value in vars(levels).items() if name.isupper() and type(value) is tuple
    ]
    assert len(rows) == 16
    for row in rows:
        assert len(row) == LEVELS + 1
        falls = row is levels.DEPTH_FARTHEST  # the nearer, the less is seen
        assert list(row) == sorted(set(row), reverse=falls)
        assert row[0] in (0, 1, math.inf)


def test_physics_stay_within_their_bounds_in_the_same_direction_at_all_levels() -> None:
    for key in KEYS:
        found = [physics_scale(Shift(axis="physics", level=level), key) for level in range(1, 6)]
        for level, scale in enumerate(found, 1):
            bounds = levels.MASS_FACTORS, levels.FRICTION_FACTORS, levels.SPRING_FACTORS
            for factor, bound in zip(astuple(scale), bounds, strict=True):
                assert 1 / bound[level] <= factor <= bound[level]
        strengths = [abs(np.log(scale.mass)) for scale in found]
        assert strengths == sorted(strengths)
        assert len({scale.mass > 1 for scale in found}) == 1
        assert physics_scale(Shift(axis="look", level=5), key) is UNSCALED


def test_more_episodes_are_reworded_at_every_level_and_all_at_the_last() -> None:
    told = [
        [kept_paraphrase(Shift(axis="instruction", level=level), key, 3) for key in KEYS]
        for level in range(1, 6)
    ]
    counts = [sum(each is not None for each in row) for row in told]
    assert counts == sorted(counts)
    assert counts[-1] == len(KEYS)
    assert set(told[-1]) == {0, 1, 2}
    for lower, higher in pairwise(told):
        assert all(b == a for a, b in zip(lower, higher, strict=True) if a is not None)
    assert kept_paraphrase(Shift(axis="instruction", level=5), KEYS[0], 0) is None


def test_looks_have_one_thing_more_at_every_level() -> None:
    usual = Look()

    def shifted(axis: str, level: int) -> Look:
        return shifted_look(Shift(axis=axis, level=level), KEYS[0], usual)

    looks = first, second, third, fourth, fifth = [shifted("look", level) for level in range(1, 6)]
    assert first.lights == fifth.lights != usual.lights
    assert (first.parts, first.clutter, first.objects) == ({}, 0, {})
    plain = {name: Material(colour=part.colour) for name, part in fifth.parts.items()}
    assert second.parts == plain
    assert third.parts == fifth.parts
    assert fourth.clutter == fifth.clutter > 0 == third.clutter
    assert fifth.objects
    assert not fourth.objects
    for look in looks:
        assert (look.cameras, look.noise, look.blur) == ({}, 0.0, 0.0)
    camera = shifted("camera", 5)
    assert set(camera.cameras) == {"head", "left_wrist", "right_wrist"}
    assert camera == Look(cameras=camera.cameras)
    assert shifted("sensing", 2) == Look(noise=levels.IMAGE_NOISE[2])
    assert shifted("layout", 5) is usual


def test_another_renderer_shows_the_same_and_is_in_no_suite() -> None:
    usual = Look(noise=0.1)

    def shifted(axis: str, level: int) -> Look:
        return shifted_look(Shift(axis=axis, level=level), KEYS[0], usual)

    assert shifted("renderer", 1) == replace(named_look("studio"), noise=0.1)
    for level in range(2, 6):
        other = shifted("look", level - 1)
        parts = named_look("studio").parts if level == 2 else other.parts
        assert shifted("renderer", level) == replace(other, renderer="studio", parts=parts)
    assert shifted("all", 5).renderer == "classic"
    assert RENDERER not in {shift.axis for shift in every_shift()}
    assert list(every_shift(EVERY_AXIS))[-1].axis == RENDERER


@pytest.mark.parametrize("task_id", catalog.names())
def test_layouts_lie_outside_of_the_range_of_training_and_within_the_margin(task_id: str) -> None:
    task = catalog.get(task_id)
    shifted = shifted_task(task, Shift(axis="layout", level=1))
    moved = {name for name, at in shifted.placements.items() if isinstance(at, OutsidePlacement)}
    assert moved
    margin = levels.MARGIN_METRES[1]
    for seed in range(5):
        layout = next(shifted.layouts(seed))
        for name in moved:
            usual, (x, y, _) = task.placements[name], layout.poses[name].translation
            assert not (usual.x.low <= x <= usual.x.high and usual.y.low <= y <= usual.y.high)
            assert usual.x.low - margin <= x <= usual.x.high + margin
            assert usual.y.low - margin <= y <= usual.y.high + margin
        for name in task.placements.keys() - moved:
            still = task.placements[name].sample(np.random.default_rng(0))
            assert layout.poses[name].tquat.tolist() == still.tquat.tolist()
    assert shifted_task(task, NO_SHIFT) is task


def test_a_lowered_task_keeps_the_bounds_of_a_lower_level(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(levels, "LOWERED", {"latency": {"bin_sort": 2}})
    steps = [latency_steps(Shift(axis="latency", level=level), "bin_sort") for level in (1, 2, 5)]
    assert steps == [levels.LATENCY_STEPS[1], levels.LATENCY_STEPS[2], levels.LATENCY_STEPS[2]]
    assert latency_steps(Shift(axis="all", level=5), "carry_pot") == levels.LATENCY_STEPS[5]
