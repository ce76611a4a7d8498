"""A misspelt name in a stage is an error when the environment is made, not at success."""

from dataclasses import replace
from typing import Any

import pytest

import duobench
from duobench.core.errors import LayoutError, UnknownNameError
from duobench.core.types import Side
from duobench.tasks import Task, catalog
from duobench.tasks.stages import predicates
from duobench.tasks.stages.logic import Predicate, all_of, any_of, held_for, since
from duobench.tasks.stages.predicates import (
    grasped,
    hinge_open,
    raised,
    released,
    rests_on,
    still,
    variant,
)
from tests.envs.tools import TASK


def changed(name: str, **fields: Any) -> Task:
    """A task whose last stage has other fields."""
    task = catalog.get(name)
    *others, last = task.stages
    return replace(task, stages=(*others, replace(last, **fields)))


@pytest.mark.parametrize(
    "predicate",
    [
        # What the first constraint decides hides the others while an episode runs.
        all_of(rests_on("white_cube", "white_bowl"), released("white_cbue")),
        any_of(released("black_cube"), released("white_cbue")),
        rests_on("black_cube", "white_cbue"),
        predicates.off_table("black_cube", "white_bowl", "white_cbue"),
        predicates.lifted_by_any("black_cube", "white_cbue"),
        ~released("white_cbue"),
        since(grasped(Side.LEFT, "black_cube"), reset=released("white_cbue")),
        held_for(released("white_cbue"), 0.5),
        still("white_cbue"),
        raised("white_cbue", 0.1),
    ],
    ids=repr,
)
def test_the_near_ones_are_named(predicate: Predicate) -> None:
    task = changed(TASK, holds=predicate)
    words = rf"^Stage '{task.stages[-1].name}': .*'white_cbue'.*Did you mean 'white_cube'"
    with pytest.raises(UnknownNameError, match=words):
        duobench.make(task, cameras=False)


RIGHT = variant("empty", "right")


@pytest.mark.parametrize(
    ("name", "holds", "words"),
    [
        (TASK, still("tabel"), "object 'tabel'"),
        (TASK, raised("table", 0.1), "object 'table'.*white_cube"),
        (TASK, hinge_open("white_bowl", 0.1), "hinge 'white_bowl'"),
        ("spring_door", hinge_open("microwave/dor", 0.1), "Did you mean 'microwave/door'"),
        ("ball_maze", variant("boardd", "1"), "variant 'boardd'. Did you mean 'board'"),
        ("ball_maze", ~variant("board", "one"), "value of variant 'board' 'one'.*Known: 0, 1,"),
        ("pour_marbles", RIGHT & variant("full", "rihgt"), "'rihgt'. Did you mean 'right'"),
        ("ball_maze", None, "instruction 'baord'. Did you mean 'board'"),
    ],
)
def test_every_other_name_is_checked(name: str, holds: Predicate | None, words: str) -> None:
    change = {"holds": holds} if holds is not None else {"instruction": "Take board {baord}."}
    with pytest.raises(UnknownNameError, match=words):
        duobench.make(changed(name, **change), cameras=False)


# In bin_sort `accept` needs the pose, in pour_marbles `arrange` that of one cup.
@pytest.mark.parametrize(
    "path",
    [f"{TASK}/white_cube", "pour_marbles/left_cup", "pour_marbles/right_cup", "transfer_cube/cube"],
)
def test_every_object_needs_a_placement(path: str) -> None:
    name, prop = path.split("/")
    task = catalog.get(name)
    placements = {key: value for key, value in task.placements.items() if key != prop}
    with pytest.raises(LayoutError, match=f"no placement for '{prop}'"):
        duobench.make(replace(task, placements=placements), cameras=False)
