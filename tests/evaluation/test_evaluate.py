import random
import shutil
from dataclasses import replace
from pathlib import Path

import av
import pytest

from duobench.core.errors import (
    DuoBenchError,
    EvaluationError,
    GoneError,
    OtherRunError,
    PolicyError,
    UnknownNameError,
)
from duobench.evaluation.replay.render import VIDEO, make_missing
from duobench.evaluation.replay.verification import verify
from duobench.evaluation.runners.evaluations import evaluate
from duobench.results.folder import RunFolder
from duobench.results.journal import PARTS, Begun, Ended
from duobench.results.run import Resuming, TimeLimits
from duobench.results.suite import find_tasks
from tests.evaluation import toy_tasks
from tests.evaluation.conftest import assert_same_episodes, compared, small_suite, without_policy
from tests.quick_first import quick_first
from tests.results.samples import key


def written(folder):
    """When each record was written."""
    return {path: path.stat().st_mtime_ns for path in folder.path.glob("records/*/*/*")}


@pytest.mark.slow
def test_results_do_not_depend_on_the_workers(play, reference):
    folder, _ = play("random", workers=3)
    assert compared(folder) == reference


def test_missing_episodes_are_played_and_finished_ones_kept(play, reference):
    folder, _ = play("random")
    for path in (folder.record(key(folder, *each)) for each in (("wave", 2), ("nod", 0))):
        path.unlink()
    kept = written(folder)
    folder.page.unlink()
    folder.summary.unlink()
    play("random")
    assert compared(folder) == reference
    assert kept.items() <= written(folder).items()


def test_run_may_grow_and_then_is_like_one_that_was_that_long(play, reference):
    folder, _ = play("random", episodes=2)
    kept = written(folder)
    play("random", episodes=4)
    assert compared(folder) == reference
    assert kept.items() <= written(folder).items()
    with pytest.raises(OtherRunError, match="episodes 3 instead of 4 or more"):
        play("random", episodes=3)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [0, 1])
def test_policy_that_was_edited_does_not_go_on_with_a_run(play, tmp_path, monkeypatch, workers):
    monkeypatch.syspath_prepend(tmp_path)
    module = f"edited_{workers}"
    path = tmp_path / f"{module}.py"
    path.write_text("from duobench.policy import HoldPolicy\nclass Mine(HoldPolicy): ...\n")
    play(f"{module}:Mine", episodes=1, workers=workers)
    path.write_text("from duobench.policy import HoldPolicy\nclass Mine(HoldPolicy): pass\n")
    with pytest.raises(OtherRunError, match=r"policy's version source \w+ instead of source"):
        play(f"{module}:Mine", episodes=2, workers=workers)


def test_episode_range_moves_the_seeds(play, reference):
    folder, _ = play("random", episodes=2, first_episode=2)
    for name, content in compared(folder).items():
        if name.startswith("records"):
            assert without_policy(content) == without_policy(reference[name])


@pytest.mark.slow
def test_faults_of_a_policy_cost_only_its_episodes_the_same_in_any_process(play):
    tasks, count = find_tasks([toy_tasks.WAVE_NAME]), len(toy_tasks.FAULTS) + 1
    runs = [
        play("Faulty", f"run{workers}", workers=workers, tasks=tasks, episodes=count)
        for workers in (0, 2)
    ]
    assert compared(runs[0][0]) == compared(runs[1][0])
    (one,) = runs[0][1].tasks
    *broken, good = one.records
    assert (good.episode, good.error) == (count - 1, None)
    words = ["SystemExit: 3", "ZeroDivisionError: my policy is broken"]
    words += ["asyncio.exceptions.CancelledError", r"weights-\udcff.bin \x1b[31m", "line"]
    for word, record in zip(words, broken, strict=True):
        assert (record.steps, record.success, record.state_hash) == (3, False, None)
        assert word in record.reason
        assert 0 < len(record.error) < 25_000
        assert "\x1b" not in record.error


@pytest.mark.slow
@pytest.mark.parametrize("workers", [0, 2])
@pytest.mark.parametrize(
    ("policy", "error", "message"),
    [
        ("SeesNowhere", UnknownNameError, "camera 'haed'. Did you mean 'head'"),
        ("no_such_policy_module:make", PolicyError, "no module named 'no_such_policy_module'"),
        (
            "cannot_be_made",
            PolicyError,
            r"(?s)cannot_be_made' cannot be made.*Traceback.*ZeroDivisionError: no weights",
        ),
        ("expert", PolicyError, "'wave' has no scripted expert"),
    ],
)
def test_policy_that_cannot_play_ends_the_run_with_the_same_error(
    play, policy, error, message, workers
):
    with pytest.raises(error, match=message):
        play(policy, workers=workers)


@pytest.mark.slow
def test_broken_episodes_are_played_again_if_that_is_asked_for(play, reference):
    folder, results = play("BreaksOnce")
    assert results.overall.errors == 4
    good = {folder.record(r.key) for one in results.tasks for r in one.records if not r.error}
    kept = {path: time for path, time in written(folder).items() if path in good}
    assert play("BreaksOnce")[1].overall.errors == 4
    assert play("BreaksOnce", resuming=Resuming(retry_broken=True))[1].overall.errors == 0
    assert kept.items() <= written(folder).items()
    assert_same_episodes(folder, reference, 8)


@pytest.mark.parametrize(
    ("limits", "error", "steps"),
    [
        ({"act_timeout": 0.05}, "did not answer within 0.05 s, its limit for one reset or act.", 1),
        ({"episode_timeout": 0.25}, "was not over after 0.25 s, its time limit.", 4),
    ],
)
def test_answer_and_episode_that_take_too_long_fail_the_episode(play, limits, error, steps):
    _, results = play("Dawdles", episodes=1, limits=TimeLimits(**limits))
    for one in results.tasks:
        assert one.records[0].reason.startswith("PolicyTimeoutError: The ")
        assert one.records[0].reason.endswith(error)
        assert 1 <= one.records[0].steps <= steps


@pytest.mark.parametrize(
    "limits", [{"act_timeout": 0}, {"act_timeout": float("nan")}, {"episode_timeout": -1.0}]
)
def test_impossible_time_limit_is_refused(limits):
    with pytest.raises(EvaluationError, match="limits are positive"):
        TimeLimits(**limits)


@pytest.mark.parametrize("workers", quick_first([0, 1]))
def test_there_may_be_no_time_limit(play, workers):
    limits = TimeLimits(act_timeout=float("inf"), episode_timeout=float("inf"))
    folder, results = play("hold", episodes=1, limits=limits, workers=workers)
    assert (results.overall.episodes, results.overall.errors) == (2, 0)
    assert folder.read_run().limits == limits


@pytest.mark.usefixtures("play")
def test_policy_that_moves_elsewhere_does_not_take_the_records_along(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = RunFolder(Path("relative"))
    results = evaluate(f"{toy_tasks.__name__}:Moves", small_suite(episodes=1), folder, workers=0)
    assert Path.cwd() == tmp_path / "marks"
    assert results.overall.episodes == 2
    assert len(list((tmp_path / "relative" / "records").glob("*/*/*.json"))) == 2


def test_policy_with_global_generators_is_repeatable(play):
    folders = []
    for name in ("a", "b"):
        random.seed(name)
        folders.append(play("UsesGlobalGenerators", name, episodes=1)[0])
    assert compared(folders[0]) == compared(folders[1])


@pytest.mark.long
@pytest.mark.parametrize("workers", [0, 1])
def test_look_is_that_of_environment_video_and_record(play, workers):
    plain, _ = play("Sees", "plain", episodes=1, videos=1)
    folder, results = play("Sees", episodes=1, videos=1, look="dark", workers=workers)
    assert results.overall.errors == 0
    for one in results.tasks:
        (record,) = one.records
        assert record.versions["renderer"]
        config = record.config
        assert (config.cameras, config.image_size, config.look) == (("head",), (24, 32), "dark")
        brightness = []
        for run in (folder, plain):
            with av.open(run.video(key(run, one.task.id, 0))) as container:
                frame = next(container.decode(video=0))
            brightness.append(frame.to_ndarray(format="rgb24").mean())
        assert 1.3 * brightness[0] < brightness[1]


@pytest.mark.slow
def test_depth_parts_and_a_camera_of_ones_own_go_from_policy_to_record_and_page(play, monkeypatch):
    """What is seen is played, recorded, verified, shown in a video that can be made again."""
    folder, results = play("Measures", episodes=1, videos=1)
    assert results.overall.errors == 0
    (record, *_) = (record for one in results.tasks for record in one.records)
    config = record.config
    assert config.cameras == ("head", replace(toy_tasks.SIDE, size=(24, 32)))
    assert (config.depth, config.segmentation) == (("side", "left_wrist"), ("head",))
    assert config.image_sizes == {"head": (24, 24)}
    assert folder.read_run().candidate.metadata == toy_tasks.Measures.metadata
    assert folder.read_run().candidate.privileged, "parts are known to a simulation alone"
    page = folder.page.read_text()
    for words in ("cameras of its own (side)", "depth (side, left_wrist)", "segmentation (head)"):
        assert words in page
    video = folder.video(record.key)
    before = video.read_bytes()
    with av.open(video) as container:
        assert container.streams.video[0].width > 640
    video.unlink()
    done = make_missing(folder, folder.read_run(), [record], VIDEO, import_tasks=True)
    assert done.made == (record,)
    assert video.read_bytes() == before
    assert verify(folder, import_tasks=True).is_verified
    moved = replace(toy_tasks.SIDE, fovy_deg=50.0)
    other = replace(toy_tasks.Measures.metadata, cameras=("head", moved))
    monkeypatch.setattr(toy_tasks.Measures, "metadata", other)
    with pytest.raises(OtherRunError, match=r"policy's cameras .*fovy_deg=50.* instead of"):
        play("Measures", episodes=1)


@pytest.mark.slow
def test_a_video_may_have_a_look_of_its_own_and_nothing_else_has_it(play):
    plain, results = play("random", episodes=1, videos=1)
    shown, others = play("random", "shown", episodes=1, videos=1, video_look="dark")
    assert results.overall == others.overall
    for one in others.tasks:
        assert one.records[0].config.look == "default"
        files = [run.video(key(run, one.task.id, 0)).read_bytes() for run in (plain, shown)]
        assert files[0] != files[1]
    with pytest.raises(UnknownNameError, match="'dark'"):
        play("random", "unknown", episodes=1, videos=1, video_look="drak")


@pytest.mark.slow
def test_first_episodes_have_videos_the_same_in_any_process(play):
    folder, results = play("random", videos=1, episodes=2)
    videos = sorted(folder.path.glob("videos/*/*/*.webm"))
    assert videos == [folder.video(key(folder, "nod", 0)), folder.video(key(folder, "wave", 0))]
    page = folder.page.read_text()
    for one in results.tasks:
        with av.open(folder.video(key(folder, one.task.id, 0))) as container:
            images = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
        assert len(images) == 1 + (one.records[0].steps + 1) // 2
        assert all(image.std() > 10 for image in images)
        assert f'src="videos/{one.task.id}/random.sim.none.default/00000.webm"' in page
    other, _ = play("random", "other", videos=1, episodes=2, workers=1)
    for path in videos:
        assert (other.path / path.relative_to(folder.path)).read_bytes() == path.read_bytes()


@pytest.mark.long
@pytest.mark.parametrize("workers", [0, 1])
def test_time_is_noted_with_what_it_was_spent_on(play, workers):
    folder, _ = play("Glances", videos=1, episodes=2, workers=workers)
    notes = [entry for entry in folder.entries() if isinstance(entry, Ended)]
    played = [(task, episode) for task in ("nod", "wave") for episode in (0, 1)]
    assert sorted((note.task, note.episode) for note in notes) == played
    for note in notes:
        times = note.times
        assert sum(getattr(times, name) for name in PARTS) < times.total + 0.01
        assert all((times.simulation, times.rendering, times.policy))
        assert (bool(times.waiting), bool(times.video)) == (bool(workers), note.episode == 0)
        assert (note.workers, note.attempt) == (workers, 1)


class Counts:
    """Counts what an observer is told."""

    def __init__(self):
        self.finished, self.told = [], []

    def on_run_start(self, run, finished):
        assert run.candidate.policy == "hold"
        self.finished.append(len(finished))

    def on_episode(self, played):
        self.told.append((played.task, played.episode))


def test_observers_hear_of_every_record_once(play):
    counts = Counts()
    folder, _ = play("hold", episodes=2, observers=[counts])
    assert counts.told == [("wave", 0), ("wave", 1), ("nod", 0), ("nod", 1)]
    folder.record(key(folder, "nod", 0)).unlink()
    play("hold", episodes=2, observers=[counts])
    assert counts.finished == [0, 3]
    assert counts.told[4:] == [("nod", 0)]
    begun = [(one.task, one.attempt) for one in folder.entries() if isinstance(one, Begun)]
    assert begun == [("wave", 1), ("wave", 1), ("nod", 1), ("nod", 1), ("nod", 2)]


def test_records_that_vanish_during_the_run_are_an_error(play, tmp_path):
    class Removes(Counts):
        def on_episode(self, played):
            if played.episode == 1:
                folder = RunFolder(tmp_path / "run")
                folder.record(key(folder, played.task, 0)).unlink()

    with pytest.raises(EvaluationError, match=r"2 of 4 records are missing .*plays what is miss"):
        play("hold", episodes=2, observers=[Removes()])


class Removes:
    """Removes a folder after the first episode."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def on_run_start(self, run, finished):
        """Nothing is shown."""

    def on_episode(self, _played):
        """Somebody cleans up."""
        shutil.rmtree(self._folder)


@pytest.mark.parametrize("part", ["", "attempts"])
def test_folder_that_is_removed_while_it_is_played_is_said_to_be_gone(play, tmp_path, part):
    path = tmp_path / "run"
    gone = Removes(path / part)
    with pytest.raises(
        GoneError, match=f"{path / part} was removed|there is no folder {path / part}"
    ) as said:
        play("hold", observers=[gone])
    assert "Nothing finished is lost" not in str(said.value)
    if not part:
        assert not path.exists()
    play("hold")


@pytest.mark.parametrize("there", [None, "empty", "mine"])
def test_start_that_fails_leaves_no_new_folder(play, tmp_path, there):
    path = tmp_path / "deep" / "run"
    if there is not None:
        path.mkdir(parents=True)
    if there == "mine":
        (path / "thesis.txt").touch()
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(DuoBenchError):
        play("nomod:Foo", name="deep/run")
    assert sorted(tmp_path.rglob("*")) == before
