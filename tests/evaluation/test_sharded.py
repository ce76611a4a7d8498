"""One folder, many writers: whoever wrote what, the run is the same."""

import shutil
import subprocess
import sys
from typing import Any

import pytest

from duobench.core.errors import EvaluationError, LockedError, OtherRunError
from duobench.evaluation.replay.verification import verify
from duobench.evaluation.runners.evaluations import evaluate
from duobench.policy import PolicyMetadata
from duobench.results.bundle import open_source, read_source, write_bundle
from duobench.results.comparison import compare
from duobench.results.folder import RunFolder
from duobench.results.report import write_report
from duobench.results.run import WHOLE, Resuming, Run, Shard
from duobench.tasks.shifts.shift import every_shift
from tests.evaluation import toy_tasks
from tests.evaluation.conftest import compared, small_suite
from tests.results.samples import SORT, sample_folder, sample_records, sample_run, without_times

QUARTERS = [Shard(number=number, count=4) for number in (1, 2, 3, 4)]


def contents(folder: RunFolder) -> dict[str, bytes]:
    """Every file of a folder but what its writers noted, without times on pages."""
    found = {
        str(path.relative_to(folder.path)): path.read_bytes()
        for path in folder.path.rglob("*.*")
        if path.is_file() and path.suffix != ".jsonl"
    }
    pages = [name for name, content in found.items() if b'<section id="times">' in content]
    return found | {name: without_times(found[name].decode()).encode() for name in pages}


def written(folder: RunFolder, shard: Shard = WHOLE, policy: str = "random", **options: Any) -> Any:
    """What a writer plays of the small suite."""
    suite = options.pop("suite", small_suite())
    return evaluate(policy, suite, folder, shard=shard, **{"workers": 0} | options)


# --- shards --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text", ["0/4", "5/4", "1/0", "1", "1/2/3", "a/b", "-1/4", "1/99999", " 1/4", ""]
)
def test_shard_that_does_not_exist_is_refused(text):
    with pytest.raises(EvaluationError):
        Shard.parse(text)


def test_shards_deal_every_episode_once_and_never_move_one():
    for count in (1, 2, 3, 7, 40):
        shards = [Shard(number=number, count=count) for number in range(1, count + 1)]
        before: dict[Shard, set] = {shard: set() for shard in shards}
        for episodes in (1, 4, 9):
            run = sample_run(episodes=episodes, first_episode=3)
            parts = {shard: set(run.episode_keys(shard)) for shard in shards}
            assert sum(map(len, parts.values())) == run.size
            assert set.union(*parts.values()) == set(run.episode_keys())
            assert all(before[shard] <= parts[shard] for shard in shards)
            before = parts
        sizes = [sum(run.counts(shard).values()) for shard in shards]
        assert max(sizes) - min(sizes) <= len(run.suite.tasks)
    for one in QUARTERS:
        for other in (*QUARTERS, WHOLE, Shard(number=1, count=3), Shard(number=1, count=2)):
            shared = set(run.episode_keys(one)) & set(run.episode_keys(other))
            assert one.overlaps(other) == other.overlaps(one)
            assert one.overlaps(other) or not shared


@pytest.mark.slow
def test_four_shards_one_process_and_two_workers_give_the_same_summary(tmp_path, reference):
    folder = RunFolder(tmp_path / "run")
    for shard in QUARTERS:
        assert not folder.page.exists()
        for workers in (0, 2):  # the second call goes on, and finds nothing to do
            assert written(folder, shard, workers=workers).overall.episodes == 2
    assert compared(folder) == reference
    assert [shard.writer for shard in folder.writers] == [shard.writer for shard in QUARTERS]
    assert verify(folder, import_tasks=True).is_verified


def test_shard_without_an_episode_is_no_error(tmp_path):
    folder = RunFolder(tmp_path)
    for number in (1, 2, 3):
        written(folder, Shard(number=number, count=3), suite=small_suite(episodes=1))
    assert len(folder.read_records(folder.read_run())) == 2


@pytest.mark.slow
def test_folders_of_two_machines_are_merged_by_copying(tmp_path, reference):
    machines = [RunFolder(tmp_path / name) for name in ("one", "two")]
    for shard in QUARTERS:
        written(machines[shard.number % 2], shard)
    assert machines[0].description.read_bytes() == machines[1].description.read_bytes()
    for order in (machines, machines[::-1]):
        out = RunFolder(tmp_path / f"from {order[0].path.name}")
        for machine in order:
            subprocess.run(["cp", "-r", f"{machine.path}/.", str(out.path)], check=True)
        write_report(out)
        assert compared(out) == reference
        write_bundle(out, tmp_path / "both.zip")
        assert read_source(tmp_path / "both.zip") == read_source(out.path)
    # Whoever plays the rest of one machine's folder finds what the other one has left to do.
    written(machines[0])
    assert compared(machines[0]) == reference


@pytest.mark.long
def test_run_under_every_shift_is_the_same_in_shards_and_on_two_machines(tmp_path):
    suite = small_suite(tasks=small_suite().tasks[:1], episodes=2, shifts=tuple(every_shift()))
    whole, parts, other = (RunFolder(tmp_path / name) for name in ("whole", "parts", "other"))
    written(whole, policy="hold", suite=suite)
    assert len(whole.read_records(whole.read_run())) == 41 * 2
    for number, folder in enumerate((parts, other), 1):
        written(folder, Shard(number=number, count=2), "hold", suite=suite)
    shutil.copytree(other.path, parts.path, dirs_exist_ok=True)
    write_report(parts)
    assert {*contents(whole)} >= {"robustness.json", "run.json", "index.html"}
    assert contents(parts) == contents(whole)
    found = verify(parts, import_tasks=True)
    assert (len(found.findings), found.is_verified, found.missing) == (82, True, 0)


# --- kills, and writers that meet ----------------------------------------------------------------

WRITER = """
import sys
from pathlib import Path
from duobench.results.folder import RunFolder
from duobench.results.run import Shard
from duobench.evaluation.runners.evaluations import evaluate
from tests.evaluation.conftest import small_suite

evaluate("random", small_suite(), RunFolder(Path(sys.argv[1])), workers=1,
         shard=Shard.parse(sys.argv[2]))
"""


@pytest.mark.long
def test_writers_side_by_side_that_are_killed_and_go_on_give_the_same_bytes(tmp_path, reference):
    folder = RunFolder(tmp_path / "run")
    words = [sys.executable, "-c", WRITER, str(folder.path)]
    writers = [subprocess.Popen([*words, str(shard)]) for shard in QUARTERS]
    while not folder.has_records:
        assert writers[0].poll() is None
    for writer in writers[:2]:
        writer.kill()
    assert [writer.wait() for writer in writers][2:] == [0, 0]
    for shard in QUARTERS[:2]:
        subprocess.run([*words, str(shard)], check=True)
    assert compared(folder) == reference


@pytest.mark.parametrize("other", [Shard(number=2, count=4), WHOLE, Shard(number=2, count=6)])
def test_a_second_writer_of_the_same_episodes_is_kept_out(tmp_path, other):
    folder = RunFolder(tmp_path)
    with folder.writer(QUARTERS[1]):
        with pytest.raises(LockedError, match=r"Another process is writing into .*2-of-4\.jsonl"):
            written(folder, other)
        with folder.writer(QUARTERS[2]):
            assert [shard.number for shard in folder.writers] == [2, 3]
    with folder.writer(other):
        pass


# --- growing, beginning anew, and other runs -----------------------------------------------------


def run_in(folder: RunFolder, run: Run, *, shard: Shard = WHOLE) -> None:
    """Write all records of a shard of a made-up run."""
    ours = set(run.episode_keys(shard))
    with folder.writer(shard):
        folder.begin(run, shard)
        for record in sample_records(run):
            if record.key in ours:
                folder.write(record)


def test_run_grows_by_whichever_writer_and_never_shrinks(tmp_path):
    folder, shifts = RunFolder(tmp_path), list(every_shift())
    run_in(folder, sample_run(episodes=2), shard=QUARTERS[0])
    run_in(folder, sample_run(episodes=3, shifts=(shifts[7],)), shard=QUARTERS[1])
    run = folder.read_run()
    assert (run.suite.episodes, run.suite.shifts) == (3, (shifts[0], shifts[7]))
    with pytest.raises(OtherRunError, match="episodes 2 instead of 3 or more"):
        folder.begin(sample_run(episodes=2), QUARTERS[0])


def test_another_run_gives_way_only_while_nobody_writes_it(tmp_path):
    folder, run, other = RunFolder(tmp_path), sample_run(), sample_run(policy="other")
    with folder.writer(QUARTERS[0]):
        folder.begin(run, QUARTERS[0])
        with folder.writer(QUARTERS[1]):
            with pytest.raises(OtherRunError, match="policy other instead of mine"):
                folder.begin(other, QUARTERS[1])
            with pytest.raises(LockedError, match="another run"):
                folder.clear(other, QUARTERS[1])
    with folder.writer(QUARTERS[1]):
        folder.begin(other, QUARTERS[1])
    assert folder.read_run() == other


def test_fresh_shard_removes_what_is_its_own_and_the_whole_run_everything(tmp_path):
    folder, run = RunFolder(tmp_path), sample_run()
    run_in(folder, run)
    folder.clear(run, QUARTERS[0])
    left = set(run.episode_keys()) - set(run.episode_keys(QUARTERS[0]))
    assert set(folder.finished(run)) == left
    folder.clear(sample_run(policy="other"), QUARTERS[0])
    assert not folder.has_records
    run_in(folder, sample_run(policy="other"))
    folder.clear(run)
    assert not folder.has_records
    assert sorted(path.name for path in tmp_path.iterdir()) == ["attempts", "run.json"]


def test_every_reader_refuses_a_folder_of_two_runs(tmp_path):
    """Of the same policy in another version, so that not even a name is different."""
    folders = []
    for version, part in (("1", slice(2)), ("2", slice(2, 4))):
        metadata = PolicyMetadata(name="mine", version=version)
        run = sample_run(tasks=(SORT,), metadata=metadata)
        folders.append(sample_folder(tmp_path / version, run, sample_records(run)[part]))
    first = folders[0].read_run()
    shutil.copytree(folders[1].path, folders[0].path, dirs_exist_ok=True)
    path = folders[0].path
    for read in (
        lambda: write_report(folders[0]),
        lambda: verify(folders[0]),
        lambda: write_bundle(folders[0], tmp_path / "x.zip"),
        lambda: compare([str(path), str(folders[1].path)]),
        lambda: read_source(path),
    ):
        with pytest.raises(OtherRunError, match=r"every record of a folder is of one run: its pol"):
            read()
    with pytest.raises(OtherRunError):
        open_source(path).read_records(first)


def test_record_beyond_the_run_is_no_silent_part_of_it(tmp_path):
    """As where the description of a smaller part was copied over that of a larger one."""
    run = sample_run()
    folder = sample_folder(tmp_path, run, sample_records(run))
    small = sample_folder(tmp_path / "small", sample_run(episodes=2), [])
    shutil.copy(small.description, folder.description)
    with pytest.raises(EvaluationError, match=r"says 2 episodes of 3 tasks .* largest|belongs to"):
        read_source(folder.path)


@pytest.mark.slow
def test_fresh_and_retry_work_in_shards(tmp_path, monkeypatch):
    monkeypatch.setenv(toy_tasks.MARKS, str(tmp_path))
    policy, folder = f"{toy_tasks.__name__}:BreaksOnce", RunFolder(tmp_path / "run")
    first = [written(folder, shard, policy) for shard in QUARTERS]
    assert sum(each.overall.errors for each in first) == 4
    kept = {key: folder.record(key).stat().st_mtime_ns for key in folder.read_run().episode_keys()}
    again = [
        written(folder, shard, policy, resuming=Resuming(retry_broken=True))
        for shard in QUARTERS[::-1]
    ]
    assert sum(each.overall.errors for each in again) == 0
    new = [key for key, time in kept.items() if folder.record(key).stat().st_mtime_ns != time]
    assert len(new) == 4
    written(folder, QUARTERS[0], policy, resuming=Resuming(fresh=True))
    attempts = [entry for entry in folder.entries() if getattr(entry, "attempt", 0) > 1]
    assert {entry.key for entry in attempts} <= set(new)
