"""A misspelt object in a stage is an error when the environment is made, not at success."""

from __future__ import annotations

from dataclasses import replace

import pytest

import duobench
from duobench.errors import UnknownNameError
from duobench.stages.predicates import (
    Predicate,
    all_of,
    any_of,
    grasped,
    held_for,
    lifted_by_any,
    off_table,
    released,
    rests_on,
    since,
)
from duobench.tasks import catalog
from duobench.types import Side
from tests.envs.tools import TASK


@pytest.mark.parametrize(
    "predicate",
    [
        # What the first constraint decides hides the others while an episode runs.
        all_of(rests_on("white_cube", "white_bowl"), released("white_cbue")),
        any_of(released("black_cube"), released("white_cbue")),
        rests_on("black_cube", "white_cbue"),
        off_table("black_cube", "white_bowl", "white_cbue"),
        lifted_by_any("black_cube", "white_cbue"),
        ~released("white_cbue"),
        since(grasped(Side.LEFT, "black_cube"), reset=released("white_cbue")),
        held_for(released("white_cbue"), 0.5),
    ],
    ids=repr,
)
def test_the_near_ones_are_named(predicate: Predicate) -> None:
    task = catalog.get(TASK)
    *_, last = task.stages
    misspelt = replace(task, stages=(*task.stages[:-1], replace(last, holds=predicate)))
    with pytest.raises(UnknownNameError, match=r"'white_cbue'.*Did you mean 'white_cube'"):
        duobench.make(misspelt, cameras=False)
