"""Evaluations on the rehearsal, by an operator who errs as people do: records hold what was meant.

`DUOBENCH_REHEARSAL_EPISODES=9` plays 108 trials, and `--log-cli-level=INFO` tells what happened.
"""

from __future__ import annotations

import logging
import math
import os
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from duobench.core.randomness import EVAL, episode_seed
from duobench.core.types import CONTROL_HZ
from duobench.data import DataSet
from duobench.real.sessions.recording import RigRecording, find_policy
from duobench.real.sessions.session import HELD_BY_OPERATOR
from duobench.results.labels import FaultKind
from duobench.results.suite import find_tasks
from duobench.tasks import catalog
from tests.real.rigs import new_rig, quick_rig
from tests.real.sessions import rehearsed
from tests.real.sessions.operator import Stand
from tests.real.sessions.rehearsal_operator import RehearsalOperator
from tests.real.sessions.test_recording import Script
from tests.teleop.test_real import Bench

EPISODES = int(os.environ.get("DUOBENCH_REHEARSAL_EPISODES", "1"))
"""Episodes of each of three policies in each of four tasks."""
TASKS = ("ball_maze", "hinge_chest", "bin_sort", "transfer_cube")
CARRIES = "ball_maze"
"""The task in which something is in the air for most of the time."""
ENOUGH = 9
"""Episodes in which drops and reflexes are certain."""
HOLDS = (1, 10, 20)
"""Numbers of trials in which the operator holds the arms."""
AFTER = 45
"""Control steps after the last command of an expert: 1.5 s for a stage to be pressed."""
LATE_S = 1.2
"""Longest time from a stage to its press that was right at once."""


@pytest.mark.long
@pytest.mark.parametrize("task", TASKS)
def test_records_of_a_rehearsal_hold_what_the_operator_meant(task: str, tmp_path: Path) -> None:
    seeds = [episode_seed(task, number, EVAL) for number in range(EPISODES)]
    horizon = rehearsed.learn(task, seeds) + AFTER
    (info,) = find_tasks([task])
    stand = Stand(
        tmp_path / "trials",
        rehearsed.POLICIES,
        rig=quick_rig(),
        task=replace(info, horizon=horizon),
        episodes=EPISODES,
        silence_s=1e9,
        order_seed=1,
    )
    with stand.ending:
        operator = RehearsalOperator(stand, catalog.get(task), TASKS.index(task), HOLDS)
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
    everything = operator.meant.values()
    assert any(meant.was_held for meant in everything)
    if EPISODES >= ENOUGH:
        assert task != CARRIES or any(meant.has_dropped for meant in everything)
        assert any(record.judged.fault == FaultKind.CONTACT for record in found if record.judged)
    faults = [str(record.judged.fault) for record in found if record.judged and record.judged.fault]
    stages = Counter(meant.stage for meant in everything)
    tally = (
        f"{task}: {len(trials)} trials, stages {dict(sorted(stages.items()))}, "
        f"{sum(meant.was_held for meant in everything)} held, {Counter(faults)}, "
        f"{sum(meant.has_dropped for meant in everything)} dropped, "
        f"{sum(meant.erred for meant in everything)} wrong presses"
    )
    logging.getLogger(__name__).info(tally)


@pytest.mark.slow
def test_recording_on_a_rehearsal_solves_the_task(
    tmp_path: Path, demonstrations: Callable[..., Path]
) -> None:
    """The terminal of `real record` is answered; the objects of the world are really moved."""
    (demonstration,) = DataSet(demonstrations("bin_sort")).episodes()
    duo = new_rig(quick_rig())
    source, script = find_policy(str(demonstration)), Script("ahpk", {})
    data = DataSet.open(tmp_path)
    options = {"horizon": 320, "episodes": 1}
    with closing(RigRecording(duo, "bin_sort", data, source, script, **options)) as recording:
        assert recording.run() == 1
        assert duo.world is not None
        simulation, layout = duo.world.simulation, recording._layout
        moved = {
            name: math.dist(simulation.position(name), layout.poses[name].translation)
            for name in ("white_cube", "black_cube")
        }
        assert min(moved.values()) > 0.1, "both lie in their bowls"
    assert any("white_cube" in text for text in script.asked)
    (episode,) = data.recordings()
    assert episode.info.rig is not None
    assert set(episode.info.rig.drivers) == {"rehearsal"}


def test_teleoperation_finds_the_objects_where_the_layout_says(tmp_path: Path) -> None:
    bench = Bench(tmp_path, rig=quick_rig(), task="bin_sort", episodes=1)
    world, layout = bench.duo.world, bench.session.env.base.layout
    assert world is not None
    assert layout.poses
    for name, pose in layout.poses.items():
        assert math.dist(world.simulation.position(name), pose.translation) < 0.02
    bench.session.close()
