import json
import multiprocessing
from collections.abc import Sequence
from pathlib import Path

import av
import pytest

from duobench.errors import EvaluationError, PolicyError
from duobench.evaluation.folder import RunFolder
from duobench.evaluation.records import EpisodeRecord
from duobench.evaluation.run import Run
from duobench.evaluation.runner import evaluate
from duobench.evaluation.suite import describe
from duobench.randomness import episode_seed
from tests.evaluation import small
from tests.evaluation.conftest import Play, small_run

COMPARED = ("index.html", "summary.json", "run.json")


def compared(folder: RunFolder) -> dict[str, bytes]:
    """Everything that must not depend on how a run was made."""
    paths = [folder.path / name for name in COMPARED]
    paths += [*folder.path.glob("records/*/*"), *folder.path.glob("figures/*")]
    return {str(path.relative_to(folder.path)): path.read_bytes() for path in sorted(paths)}


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = RunFolder(tmp_path_factory.mktemp("reference") / "run")
    results = evaluate(small_run("random"), folder)
    # The comparison is worth something only if episodes differ.
    stages = [record.final_stage for one in results.tasks for record in one.records]
    assert len(set(stages)) > 1
    return compared(folder)


def test_results_do_not_depend_on_the_workers(play: Play, reference: dict[str, bytes]) -> None:
    folder, _ = play("random", workers=3)
    assert compared(folder) == reference
    assert multiprocessing.active_children() == []


def test_missing_episodes_are_played_and_finished_ones_kept(
    play: Play, reference: dict[str, bytes]
) -> None:
    folder, _ = play("random")
    kept = {path: path.stat().st_mtime_ns for path in folder.path.glob("records/*/*")}
    for path in (folder.record("wave", 2), folder.record("nod", 0), folder.page, folder.summary):
        path.unlink()
        kept.pop(path, None)
    play("random")
    assert compared(folder) == reference
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


def test_other_run_is_refused_in_the_same_folder(play: Play) -> None:
    folder, _ = play("random", episodes=1)
    before = compared(folder)
    with pytest.raises(EvaluationError, match="policy: hold instead of random"):
        play("hold", episodes=1)
    assert compared(folder) == before


def test_episode_range_moves_the_seeds(play: Play, reference: dict[str, bytes]) -> None:
    folder, _ = play("random", episodes=2, first_episode=2)
    for name, content in compared(folder).items():
        if name.startswith("records"):
            assert content == reference[name]


def test_dying_workers_are_replaced_and_their_episodes_played_again(
    play: Play, reference: dict[str, bytes], tmp_path: Path
) -> None:
    folder, results = play("DiesOnce", workers=2, episodes=2)
    assert results.overall.errors == 0
    assert len(list((tmp_path / "marks").iterdir())) == results.overall.episodes == 4
    for name, content in compared(folder).items():
        if name.startswith("records"):
            ours = content.decode().replace(f"{small.__name__}:DiesOnce", "random")
            assert ours.encode() == reference[name]


def test_episode_that_always_kills_its_process_is_a_failed_one(play: Play) -> None:
    tasks = describe([small.WAVE_NAME])
    odd = [episode_seed(small.WAVE.id, episode) % 2 for episode in range(20)]
    both = max(odd.index(0), odd.index(1)) + 1  # episodes until there is one of either kind
    folder, results = play("DiesAlways", workers=2, episodes=both, tasks=tasks)
    records = [record for one in results.tasks for record in one.records]
    dead = [record for record in records if record.seed % 2 == 0]
    assert 0 < len(dead) < len(records) == both
    for record in records:
        assert (record.error is not None) == (record in dead)
    for record in dead:
        assert record.error == "The worker process died in each of 3 attempts, last by SIGKILL.\n"
        assert not record.success
    assert json.loads(folder.summary.read_text())["overall"]["errors"] == len(dead)


@pytest.mark.parametrize("workers", [1, 2])
def test_policy_that_raises_costs_only_its_episodes(play: Play, workers: int) -> None:
    _, results = play("Crashes", workers=workers)
    records = [record for one in results.tasks for record in one.records]
    assert len(records) == 8
    assert {record.seed % 2 for record in records} == {0, 1}
    for record in records:
        if record.seed % 2:
            assert record.error is None
            assert record.steps == small.HORIZON
        else:
            assert record.error is not None
            assert record.error.endswith("ZeroDivisionError: my policy is broken\n")
            assert (record.steps, record.success, record.fingerprint) == (3, False, None)


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize(
    ("policy", "message"),
    [
        ("IsSlow", "acts 10 times a second"),
        ("no_such_policy_module:make", "no module named 'no_such_policy_module'"),
    ],
)
def test_policy_that_cannot_play_ends_the_run(
    play: Play, policy: str, message: str, workers: int
) -> None:
    with pytest.raises((PolicyError, EvaluationError), match=message):
        play(policy, workers=workers)
    assert multiprocessing.active_children() == []


def test_policy_that_cannot_be_made_ends_the_run_with_its_traceback(play: Play) -> None:
    message = r"(?s)cannot_be_made' cannot be made.*Traceback.*ZeroDivisionError: no weights"
    with pytest.raises(PolicyError, match=message):
        play("cannot_be_made")
    with pytest.raises(EvaluationError, match=message):
        play("cannot_be_made", workers=2)


@pytest.mark.parametrize("workers", [1, 2])
def test_policy_that_exits_breaks_its_episode_and_not_the_run(play: Play, workers: int) -> None:
    _, results = play("Exits", workers=workers, episodes=1)
    errors = [record.error for one in results.tasks for record in one.records]
    assert len(errors) == 2
    for error in errors:
        assert error is not None
        assert "sys.exit(3)" in error
        assert error.endswith("SystemExit: 3\n")


@pytest.mark.parametrize("workers", [1, 2])
def test_broken_episodes_are_played_again_if_that_is_asked_for(
    play: Play, reference: dict[str, bytes], workers: int
) -> None:
    folder, results = play("BreaksOnce", workers=workers)
    broken = results.overall.errors
    assert 0 < broken < 8
    kept = {
        folder.record(record.task, record.episode): record.seed
        for one in results.tasks
        for record in one.records
        if record.error is None
    }
    times = [path.stat().st_mtime_ns for path in kept]
    assert play("BreaksOnce", workers=workers)[1].overall.errors == broken
    _, results = play("BreaksOnce", workers=workers, retry_broken=True)
    assert results.overall.errors == 0
    assert [path.stat().st_mtime_ns for path in kept] == times
    for name, content in compared(folder).items():
        if name.startswith("records"):
            ours = content.decode().replace(f"{small.__name__}:BreaksOnce", "random")
            assert ours.encode() == reference[name]


def test_negative_number_of_workers_is_refused(play: Play, tmp_path: Path) -> None:
    with pytest.raises(EvaluationError, match=r"workers is 1 or more.*got -3"):
        play("random", workers=-3)
    assert not (tmp_path / "run").exists()


def test_workers_that_cannot_start_end_the_run(play: Play) -> None:
    with pytest.raises(EvaluationError, match=r"3 workers in a row died.*SIGKILL.*--workers 1"):
        play("dies_when_made", workers=2)
    assert multiprocessing.active_children() == []


def test_policy_sees_what_it_asked_for(play: Play) -> None:
    _, results = play("Sees", episodes=1)
    assert results.overall.errors == 0
    for one in results.tasks:
        assert one.records[0].versions["renderer"]


def test_first_episodes_are_filmed(play: Play) -> None:
    folder, results = play("random", videos=1, episodes=2)
    films = sorted(folder.path.glob("videos/*/*"))
    assert films == [folder.video("nod", 0), folder.video("wave", 0)]
    page = folder.page.read_text()
    for one in results.tasks:
        with av.open(folder.video(one.task.id, 0)) as container:
            pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
        assert len(pictures) == 1 + (one.records[0].steps + 1) // 2
        assert all(picture.std() > 10 for picture in pictures)
        assert f'src="videos/{one.task.id}/00000.webm"' in page


class Counts:
    """Counts what an observer is told."""

    def __init__(self) -> None:
        self.finished: list[int] = []
        self.told: list[tuple[str, int]] = []

    def on_run_start(self, run: Run, finished: Sequence[EpisodeRecord]) -> None:
        assert run.policy == "hold"
        self.finished.append(len(finished))

    def on_record(self, record: EpisodeRecord) -> None:
        self.told.append((record.task, record.episode))


def test_observers_hear_of_every_record_once(tmp_path: Path) -> None:
    folder, counts = RunFolder(tmp_path / "run"), Counts()
    run = small_run("hold", episodes=2)
    evaluate(run, folder, observers=[counts])
    assert counts.told == [("wave", 0), ("wave", 1), ("nod", 0), ("nod", 1)]
    folder.record("nod", 0).unlink()
    evaluate(run, folder, workers=2, observers=[counts])
    assert counts.finished == [0, 3]
    assert counts.told[4:] == [("nod", 0)]
    lines = folder.timing.read_text().splitlines()
    assert [json.loads(line)["task"] for line in lines] == ["wave", "wave", "nod", "nod", "nod"]
