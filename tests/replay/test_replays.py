from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import duobench
from duobench.envs.sim_env import sim_of
from duobench.replay.render import MOST_REPLAYS as MOST
from duobench.replay.render import choose_few, make_replays
from duobench.results.bundle import read_source
from duobench.results.folder import RunFolder
from duobench.results.report import write_report
from duobench.results.scores import Results
from duobench.results.suite import find_tasks
from duobench.web import track
from duobench.web.geometry import Geometry
from tests.evaluation import toy_tasks
from tests.results.samples import SORT, TURN, key, sample_record, sample_run

Play = Callable[..., tuple[RunFolder, Results]]
WAVE = find_tasks([toy_tasks.WAVE_NAME])


def test_few_of_many_are_of_every_task_and_last_stage() -> None:
    run = sample_run(tasks=(SORT, TURN), episodes=60)
    records = [sample_record(SORT, number, ()) for number in range(50)]
    records += [sample_record(SORT, 50, (5,)), sample_record(TURN, 0, ()), sample_record(SORT, 51)]
    few = choose_few(run, records, ["failures"])
    assert len(few) == MOST
    assert few == [*records[: MOST - 2], *records[50:52]]
    assert choose_few(run, records, ["failures", "sort:40"]) == [
        *records[: MOST - 2],
        records[40],
        *records[50:52],
    ]


def test_replay_shows_where_everything_was(play: Play) -> None:
    folder, _ = play("random", episodes=1, videos=0, tasks=WAVE)
    run, (record,) = read_source(folder.path)
    replays = make_replays(folder, run, [record], import_tasks=True)
    assert (replays.made, replays.there, replays.impossible) == ((record,), (), ())
    path = folder.replay(key(folder, "wave", 0))
    assert path is not None
    shown = track.decode(path.read_bytes())
    assert len(shown) == record.steps + 1
    env = duobench.make(toy_tasks.WAVE, cameras=False)
    env.reset(seed=record.seed)
    simulation = sim_of(env).simulation
    geometry = Geometry(simulation.model)
    assert path.name == f"00000.{geometry.name}.track"
    assert folder.scene(geometry.name).read_bytes() == geometry.data
    targets = record.targets()
    assert targets is not None
    for number, target in enumerate([None, *targets]):
        if target is not None:
            env.step(target)
        there = geometry.poses(simulation.data)[:, :3]
        np.testing.assert_allclose(shown[number, :, :3], there, rtol=0, atol=1e-4)
    env.close()


def test_replays_that_are_there_stay_and_the_page_has_them(play: Play) -> None:
    folder, _ = play("random", episodes=2, videos=0)
    run, records = read_source(folder.path)
    write_report(folder)
    without = folder.page.read_text()
    make_replays(folder, run, records[:1], import_tasks=True)
    told: list[tuple[int, int]] = []
    replays = make_replays(
        folder, run, records[:2], import_tasks=True, progress=lambda *n: told.append(n)
    )
    assert (replays.there, replays.made) == (tuple(records[:1]), tuple(records[1:2]))
    assert told == [(1, 2), (2, 2)]
    write_report(folder)
    page = folder.page.read_text()
    opened = [f'data-replay="replay-{each.task}-{each.episode}"' for each in records]
    assert [page.count(each) > 0 for each in opened] == [True, True, *[False] * len(records[2:])]
    assert "data-replay" not in without
    folder.discard(records[0].key)
    assert folder.replay(records[0].key) is None


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"sent": None}, "no joint targets"),
        ({"stage_changes": ((1, 1),), "final_stage": 1, "success": False}, "comes out differently"),
    ],
)
def test_what_cannot_be_shown_is_told_and_leaves_nothing(
    play: Play, changes: dict[str, Any], why: str
) -> None:
    folder, _ = play("random", episodes=1, videos=0, tasks=WAVE)
    run, (record,) = read_source(folder.path)
    replays = make_replays(folder, run, [replace(record, **changes)], import_tasks=True)
    ((_, reason),) = replays.impossible
    assert why in reason
    assert folder.replay(key(folder, "wave", 0)) is None
