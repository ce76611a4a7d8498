"""What is to be done now after both hands opened at a stage: no step that takes for granted what is
gone."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from duobench.core.types import OPENING_SLOTS, SIDES
from duobench.tasks import catalog
from duobench.tasks.experts.expert import find_script
from duobench.world.objects.maze_board import BASE
from duobench.world.objects.pot import PLATE
from tests.task_harness import TaskHarness, marked
from tests.ways.play import ways_of

LATER = 45
"""Control steps after which is looked: things have fallen, and what is lost counts as lost."""
DONE = "done"
"""Things stand or lie where they belong when both hands open there: nothing is left to do."""
PICK_UP_THE_BLOCK = "Pick up the white block."
GRASP_A_CUP = "Grasp one of the cups with the arm on its side."

EXPECTED = {
    # The holder's finger is under the lid still; the door has no such finger, and shuts.
    "hinge_chest": (
        "Open the lid of the chest with one arm.",
        "Hold the lid open with one arm and pick up the black cube with the other.",
    ),
    "spring_door": ("Open the door of the microwave with one arm.",) * 2,
    # Cups that fall from the hands keep what is in them, and are to be put down.
    "pour_marbles": (
        *(GRASP_A_CUP,) * 4,
        "Put both cups upright on their green squares and let go.",
    ),
    # The open fingers are around the grips, and touch them.
    "ball_maze": (*("Grasp the board with both arms.",) * 2, "Touch the board with one arm."),
    "carry_pot": ("Reach for a handle of the pot.",) * 2,
    "block_balance": ("Pick up the beam.", *("Grasp one block with each arm.",) * 2, DONE),
    # What is joined stays joined when it falls, and either arm may pick it up.
    "join_blocks": (
        "Grasp the light block with one arm and the dark block with the other.",
        "Push the free socket of the dark block onto the peg on the wall and let go of both "
        "blocks.",
    ),
    "transfer_cube": (PICK_UP_THE_BLOCK,) * 3,
    "transfer_gate": (PICK_UP_THE_BLOCK,) * 3,
    "transfer_reorient": ("Pick up the peg.",) * 3,
    # Both arms of the expert work at once: the other cube is over its bowl as well.
    "bin_sort": (*("Pick up one of the cubes.",) * 2, *(DONE,) * 2),
}
"""After both hands opened at each stage of a task, the last one aside."""


@pytest.fixture(scope="module")
def bench(request: pytest.FixtureRequest) -> TaskHarness:
    return TaskHarness(catalog.get(request.param))


@pytest.mark.parametrize(
    ("bench", "stage", "expected"),
    [
        marked(task, stage, text, name=f"{task}-{stage}")
        for task, texts in EXPECTED.items()
        for stage, text in enumerate(texts, 1)
    ],
    indirect=["bench"],
)
def test_after_both_hands_opened_it_is_said_what_to_do_now(
    bench: TaskHarness, stage: int, expected: str
) -> None:
    layout = bench.start(0)
    bench.reach(find_script(bench.task), stage)
    reached = bench.stage
    open_both_hands(bench)
    assert bench.stage >= reached
    assert said_now(bench, bench.task.subinstructions(layout)) == expected


def test_every_task_has_a_row_for_every_stage_but_the_last() -> None:
    assert {task: len(texts) for task, texts in EXPECTED.items()} == {
        task: catalog.get(task).max_stage - 1 for task in catalog.names()
    }


@pytest.mark.parametrize("bench", [marked(name) for name in catalog.names()], indirect=True)
def test_without_a_slip_the_next_stage_is_to_be_done(bench: TaskHarness) -> None:
    bench.start(1)
    for _ in bench.steps(find_script(bench.task)):
        assert bench.progress.standing == bench.stage


def pot_in_hands(bench: TaskHarness) -> bool:
    contacts = bench.sim.contacts
    held = all(contacts.grasped(side, f"pot/{side}_handle") for side in SIDES)
    return held and bench.sim.min_height("pot") > PLATE[2] + 0.015


def board_in_hands(bench: TaskHarness) -> bool:
    held = all(bench.sim.contacts.grasped(side, "board") for side in SIDES)
    return held and bench.stage > 2 and bench.sim.position("board")[2] > BASE + 0.012


@pytest.mark.parametrize(
    ("bench", "way", "in_hands"),
    [
        marked(
            "carry_pot", "slipped from 40 mm above the plate, lifted and put down", pot_in_hands
        ),
        marked(
            "ball_maze", "the board is put down after 2 runs and taken up again", board_in_hands
        ),
    ],
    indirect=["bench"],
)
def test_hands_that_took_it_again_are_told_to_go_on(
    bench: TaskHarness, way: str, in_hands: Callable[[TaskHarness], bool]
) -> None:
    layout, said = bench.start(0), []
    texts = bench.task.subinstructions(layout)
    for _ in bench.steps(ways_of(bench.task.id).SINCERE[way].script, then=20):
        if not bench.progress.success and in_hands(bench):
            said.append(said_now(bench, texts))
    assert set(said) == {texts[bench.task.max_stage - 1]}
    assert bench.progress.success


def open_both_hands(bench: TaskHarness) -> None:
    action = bench.arms.action()
    action[list(OPENING_SLOTS)] = 1.0
    for _ in range(LATER):
        bench.send(action)


def said_now(bench: TaskHarness, texts: dict[int, str]) -> str:
    return DONE if bench.progress.success else texts[bench.progress.standing]
