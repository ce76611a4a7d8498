"""Evaluations on the rehearsal, by an operator who errs as people do: records hold what was meant.

`DUOBENCH_REHEARSAL_EPISODES=9` plays 108 trials, which takes a quarter of an hour.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from duobench.hardware.devices import FaultKind
from duobench.hardware.rig import Rig
from duobench.randomness import EVAL, episode_seed
from duobench.results.suite import find_tasks
from duobench.rig_sessions.session import HELD_BY_OPERATOR
from duobench.tasks import catalog
from duobench.types import CONTROL_HZ
from tests.rig_sessions import rehearsed
from tests.rig_sessions.operator import Stand
from tests.rig_sessions.rehearsal_operator import RehearsalOperator

EPISODES = int(os.environ.get("DUOBENCH_REHEARSAL_EPISODES", "1"))
"""Episodes of each of three policies in each of four tasks."""
TASKS = ("ball_maze", "hinge_chest", "bin_sort", "transfer_cube")
AFTER = 45
"""Control steps after the last command of an expert: 1.5 s for a stage to be pressed."""
LATE_S = 1.2
"""Longest time from a stage to its press that was right at once."""


def quick_rig() -> Rig:
    """The rehearsal without images, whose arms go home as fast as they may."""
    rig = Rig.rehearsal()
    arms = {side: replace(arm, home_fraction=arm.speed_fraction) for side, arm in rig.arms.items()}
    return replace(rig, arms=arms, cameras={})


@pytest.mark.parametrize("task", TASKS)
def test_records_of_a_rehearsal_hold_what_the_operator_meant(task: str, tmp_path: Path) -> None:
    seeds = [episode_seed(task, number, EVAL) for number in range(EPISODES)]
    horizon = rehearsed.learn(task, seeds) + AFTER
    (info,) = find_tasks([task])
    stand = Stand(
        *(tmp_path / "trials", rehearsed.POLICIES),
        rig=quick_rig(),
        task=replace(info, horizon=horizon),
        episodes=EPISODES,
        silence_s=1e9,
        order_seed=1,
    )
    with stand.ending:
        operator = RehearsalOperator(stand, catalog.get(task), TASKS.index(task), holds_in=(1,))
        assert stand.session.run()
    plan = stand.folder.read_plan()
    found = stand.folder.run.read_records(stand.folder.run.read_run())
    by_key = {(record.policy, record.episode): record for record in found}
    trials = plan.trials()
    assert len(trials) == 3 * EPISODES
    for trial in trials:
        record, meant = (
            by_key[plan.policies[trial.policy].policy, trial.episode],
            operator.meant[trial.number],
        )
        judged = record.judged
        assert judged is not None
        is_solved = meant.stage == info.max_stage
        said = record.final_stage, record.success, record.success_at_end
        assert said == (meant.stage, is_solved, is_solved and meant.holds), (trial, meant, judged)
        assert (judged.stopped == HELD_BY_OPERATOR) == meant.was_held
        if not meant.erred:
            for step, stage in record.stage_changes:
                late = step / CONTROL_HZ - meant.reached[stage]
                assert late <= LATE_S, (trial, stage, late)
        print(task, trial.number, record.policy.split(":")[1], meant, judged.stopped, record.steps)
    held = [meant for meant in operator.meant.values() if meant.was_held]
    assert held
    assert FaultKind.CONTACT
