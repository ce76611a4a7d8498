from collections.abc import Callable
from dataclasses import replace
from typing import Any

import av
import numpy as np
import pytest

import duobench
from duobench.core.errors import EvaluationError, UnknownNameError
from duobench.envs.sim_env import sim_of
from duobench.evaluation.replay.render import (
    MOST_REPLAYS as MOST,
    REPLAY,
    VIDEO,
    choose,
    choose_few,
    make_missing,
)
from duobench.results.bundle import read_source
from duobench.results.folder import RunFolder
from duobench.results.report import write_report
from duobench.results.scores import Results
from duobench.results.suite import find_tasks
from duobench.web import track
from duobench.web.geometry import Geometry
from tests.evaluation import toy_tasks
from tests.quick_first import quick_first
from tests.results.samples import SORT, TURN, key, sample_record, sample_run

Play = Callable[..., tuple[RunFolder, Results]]
RUN = sample_run(tasks=(SORT, TURN), episodes=3)
WAVE = find_tasks([toy_tasks.WAVE_NAME])
RECORDS = [
    sample_record(SORT, 0),
    sample_record(SORT, 1, (5,)),
    sample_record(TURN, 0, ()),
    sample_record(TURN, 2, (3,)),
]


@pytest.mark.parametrize(
    ("words", "chosen"),
    [
        (["failures"], [1, 2]),
        (["all"], [0, 1, 2, 3]),
        (["turn:2", "sort:0"], [0, 3]),
        (["failures", "turn:0", "sort:00"], [0, 1, 2]),
    ],
)
def test_words_choose_episodes_in_the_order_of_the_run(words, chosen):
    assert choose(RUN, RECORDS, words) == [RECORDS[number] for number in chosen]


@pytest.mark.parametrize(
    ("word", "error", "message"),
    [
        ("failed", EvaluationError, "'all' or TASK:EPISODE such as sort:0; got 'failed"),
        ("sort:x", EvaluationError, "got 'sort:x'"),
        ("sort:-1", EvaluationError, "got 'sort:-1'"),
        ("srot:1", UnknownNameError, "sort"),
        ("turn:1", EvaluationError, "Episode 1 of turn is not finished"),
    ],
)
def test_other_words_are_refused(word, error, message):
    with pytest.raises(error, match=message):
        choose(RUN, RECORDS, [word])


def made_anew(folder: RunFolder, what: str = VIDEO, **changes: Any) -> Any:
    """What becomes of all episodes, changed, and what the progress was told."""
    run, records = read_source(folder.path)
    told: list[tuple[int, int]] = []
    records = [replace(record, **changes) for record in records]
    made = make_missing(
        folder, run, records, what, import_tasks=True, progress=lambda *n: told.append(n)
    )
    return made, told


@pytest.fixture
def one(play: Callable[..., Any]) -> tuple[RunFolder, Any, Any]:
    """A run of one episode, without a video, and its record."""
    folder, _ = play("random", episodes=1, videos=0, tasks=WAVE)
    run, (record,) = read_source(folder.path)
    return folder, run, record


@pytest.mark.long
def test_video_made_later_is_that_of_the_evaluation(play):
    folder, _ = play("Glances", episodes=2, videos=2)  # which end in the middle of a chunk
    paths = sorted(folder.path.glob("videos/*/*/*.webm"))
    before = [path.read_bytes() for path in paths]
    assert len(before) == 4
    for path in paths:
        path.unlink()
    videos, told = made_anew(folder)
    assert [path.read_bytes() for path in paths] == before
    assert (len(videos.made), videos.there, videos.impossible) == (4, (), ())
    assert told == [(done, 4) for done in range(5)]


@pytest.mark.slow
def test_video_made_later_may_have_another_look(play):
    folder, _ = play("random", episodes=1, videos=1, video_look="dark", tasks=WAVE)
    path = folder.video(key(folder, "wave", 0))
    before = path.read_bytes()
    path.unlink()
    run, records = read_source(folder.path)
    make_missing(folder, run, records, VIDEO, import_tasks=True, video_look="dark")
    assert path.read_bytes() == before


def test_video_that_is_there_stays(play):
    folder, _ = play("random", episodes=2, videos=0)
    path = folder.video(key(folder, "nod", 1))
    path.parent.mkdir(parents=True)
    path.write_bytes(b"mine")
    videos, told = made_anew(folder)
    assert path.read_bytes() == b"mine"
    assert [(each.task, each.episode) for each in videos.there] == [("nod", 1)]
    assert len(videos.made) == 3
    assert told == [(done, 4) for done in range(1, 5)]


def test_images_are_shown_also_where_chunks_are_of_unknown_length(play):
    folder, _ = play("Sees", episodes=1, videos=0)
    made_anew(folder)
    with av.open(folder.video(key(folder, "wave", 0))) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert frames[0].shape == (480, 640 + 320, 3)
    assert len(frames) == 13


def test_episode_that_failed_with_an_error_is_shown_up_to_it(play):
    folder, results = play("RaisesInTheSecondAnswer", episodes=1, videos=0)
    assert results.overall.errors == 2
    videos, _ = made_anew(folder)
    steps = [record.steps for record in videos.made]
    assert len(steps) == 2
    for record in videos.made:
        with av.open(folder.video(key(folder, record.task, 0))) as container:
            assert len(list(container.decode(video=0))) == 1 + record.steps // 2


@pytest.mark.parametrize("what", quick_first([REPLAY, VIDEO]))
@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"sent": None}, "no joint targets"),
        ({"sent": b"x"}, "does not hold as many"),
        ({"stage_changes": ((1, 1),), "final_stage": 1, "success": False}, "comes out differently"),
    ],
)
def test_what_cannot_be_shown_is_told_and_leaves_nothing(one, what, changes, why):
    folder, _, record = one
    ((_, reason),) = made_anew(folder, what, **changes)[0].impossible
    assert why in reason
    assert not folder.video(record.key).exists()
    assert folder.replay(record.key) is None


def test_run_of_another_suite_is_refused(one):
    folder, run, record = one
    other = replace(run, suite=replace(run.suite, version="3"))
    with pytest.raises(EvaluationError, match="of suite 3; this version plays"):
        make_missing(folder, other, [record], VIDEO)


def test_task_of_somebody_else_is_imported_on_request_alone(one):
    folder, run, record = one
    ((_, reason),) = make_missing(folder, run, [record], VIDEO).impossible
    assert reason == f"The task {toy_tasks.WAVE_NAME!r} is not in the benchmark."


def test_few_of_many_are_of_every_task_and_last_stage():
    run = sample_run(tasks=(SORT, TURN), episodes=60)
    records = [sample_record(SORT, number, ()) for number in range(50)]
    records += [sample_record(SORT, 50, (5,)), sample_record(TURN, 0, ()), sample_record(SORT, 51)]
    first, others = records[: MOST - 2], records[50:52]
    assert choose_few(run, records, ["failures"]) == [*first, *others]
    assert choose_few(run, records, ["failures", "sort:40"]) == [*first, records[40], *others]


def test_replay_shows_where_everything_was(one):
    folder, _, record = one
    replays, _ = made_anew(folder, REPLAY)
    assert (replays.made, replays.there, replays.impossible) == ((record,), (), ())
    path = folder.replay(record.key)
    shown = track.decode(path.read_bytes())
    assert len(shown) == record.steps + 1
    env = duobench.make(toy_tasks.WAVE, cameras=False)
    env.reset(seed=record.seed)
    simulation = sim_of(env).simulation
    geometry = Geometry(simulation.model)
    assert path.name == f"00000.{geometry.name}.track"
    assert folder.scene(geometry.name).read_bytes() == geometry.data
    for number, target in enumerate([None, *record.targets()]):
        if target is not None:
            env.step(target)
        there = geometry.poses(simulation.data)[:, :3]
        np.testing.assert_allclose(shown[number, :, :3], there, rtol=0, atol=1e-4)
    env.close()


def test_replays_that_are_there_stay_and_the_page_has_them(play):
    folder, _ = play("random", episodes=2, videos=0)
    run, records = read_source(folder.path)
    write_report(folder)
    without = folder.page.read_text()
    make_missing(folder, run, records[:1], REPLAY, import_tasks=True)
    replays = make_missing(folder, run, records[:2], REPLAY, import_tasks=True)
    assert (replays.there, replays.made) == (tuple(records[:1]), tuple(records[1:2]))
    write_report(folder)
    page = folder.page.read_text()
    opened = [f'data-replay="replay-{each.task}-{each.episode}"' for each in records]
    assert [each in page for each in opened] == [True, True, *[False] * len(records[2:])]
    assert "data-replay" not in without
    folder.discard(records[0].key)
    assert folder.replay(records[0].key) is None
