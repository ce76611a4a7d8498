"""A policy is apart from the simulator, and is asked once before anything is played or written."""

import pytest

from duobench.errors import OtherRunError, PolicyError
from duobench.policy import Batching
from duobench.results.journal import Ended
from tests.evaluation import toy_batches, toy_tasks
from tests.evaluation.conftest import assert_same_episodes, compared
from tests.runners.test_batches import episodes, named


@pytest.mark.parametrize("workers", [1, 2])
def test_policy_that_searches_its_process_finds_no_simulator(play, reference, workers):
    folder, results = play("Searches", workers=workers)
    assert results.overall.errors == 0
    assert_same_episodes(folder, reference, 8)


def test_batch_policy_that_searches_its_process_finds_no_simulator(play):
    runs = [
        play(named(policy, Batching(size=2)), policy.__name__, workers=2, episodes=2)
        for policy in (toy_batches.Searches, toy_batches.Wanders)
    ]
    assert [results.overall.errors for _, results in runs] == [0, 0]
    searched, plain = (episodes(folder) for folder, _ in runs)
    assert searched == plain


def test_policy_in_the_process_of_the_simulator_finds_it(play):
    with pytest.raises(PolicyError, match=r"(?s)does not answer the first .*RuntimeError: found"):
        play("Searches", workers=0)


@pytest.mark.parametrize(
    ("policy", "workers", "message"),
    [("IsTooWide", 0, "17"), ("IsTooWide", 1, "17"), ("DiesAtOnce", 1, "process ended")],
)
def test_policy_that_cannot_answer_is_refused_before_anything_is_written(
    play, tmp_path, policy, workers, message
):
    with pytest.raises(PolicyError, match=rf"(?s)does not answer .*first observation.*{message}"):
        play(policy, workers=workers)
    assert not (tmp_path / "run" / "run.json").exists()


def test_run_of_nothing_but_errors_gives_way_to_a_changed_policy(play, reference):
    _, results = play("RaisesInTheSecondAnswer", workers=1)
    assert results.overall.errors == results.overall.episodes == 8
    folder, results = play("random")
    assert results.overall.errors == 0
    assert compared(folder) == reference


def test_run_with_one_good_episode_is_kept_unless_it_is_begun_anew(play, reference):
    folder, _ = play("BreaksOnce")
    stranger = folder.path / "notes.txt"
    stranger.write_text("mine")
    with pytest.raises(OtherRunError, match="another evaluation"):
        play("random")
    again, _ = play("random", fresh=True)
    assert stranger.read_text() == "mine"
    stranger.unlink()
    assert compared(again) == reference


def test_nothing_is_removed_where_there_is_no_run(play, tmp_path):
    mine = tmp_path / "run" / "records" / "wave" / "00000.json"
    mine.parent.mkdir(parents=True)
    mine.write_text("mine")
    with pytest.raises(OtherRunError, match="holds no evaluation"):
        play("random", fresh=True)
    assert mine.read_text() == "mine"


def test_time_of_the_policy_is_known_apart_from_waiting_for_it(play):
    folder, results = play("Dawdles", workers=1, episodes=1)
    times = [entry.times for entry in folder.entries() if isinstance(entry, Ended)]
    assert len(times) == 2
    for each in times:
        assert each is not None
        assert each.policy >= 0.1 * (toy_tasks.HORIZON - 1)
        assert each.waiting > 0
    assert results.overall.errors == 0
