"""Shards: parts of a run, and all of them as one run again."""

import re
from itertools import chain
from pathlib import Path

import pytest

from duobench.cli import main
from duobench.errors import DuoBenchError, EvaluationError
from duobench.results.folder import RunFolder
from duobench.results.metrics import summarize
from duobench.results.report import summary_json
from duobench.results.run import Run
from duobench.results.source import open_source, open_sources, read_source
from duobench.results.suites.shard import Shard
from tests.results.samples import sample_folder, sample_records, sample_run


def shard_run(number: int, count: int, **changes: object) -> Run:
    return sample_run(shard=Shard(number=number, count=count), **changes)


def folder(parent: Path, run: Run) -> RunFolder:
    """The folder of a shard with its records."""
    assert run.shard is not None
    wanted = {(each.task.id, each.index) for each in run.episodes()}
    whole = sample_records(sample_run(episodes=run.suite.episodes))
    records = [record for record in whole if (record.task, record.episode) in wanted]
    return sample_folder(parent / run.shard.folder, run, records)


def test_shards_deal_every_episode_once_and_never_move_one() -> None:
    dealt = [[(e.task.id, e.index) for e in shard_run(n, 4).episodes()] for n in (1, 2, 3, 4)]
    assert sorted(chain.from_iterable(dealt)) == sorted(
        (e.task.id, e.index) for e in sample_run().episodes()
    )
    assert [len(part) for part in dealt] == [3, 3, 3, 3]
    grown = [(e.task.id, e.index) for e in shard_run(2, 4, episodes=9).episodes()]
    assert set(dealt[1]) < set(grown)
    assert [shard_run(n, 4).size for n in (1, 2, 3, 4)] == [3, 3, 3, 3]


@pytest.mark.parametrize("text", ["0/4", "5/4", "1/0", "1", "a/b", "1/4/2", "-1/4", "1/99999"])
def test_shard_that_does_not_exist_is_refused(text: str) -> None:
    with pytest.raises(EvaluationError, match="hard"):
        Shard.parse(text)


def test_shards_read_together_are_the_run(tmp_path: Path) -> None:
    for number in (3, 1, 4, 2):
        folder(tmp_path, shard_run(number, 4, command=f"duobench eval --shard {number}/4 --out x"))
    run = sample_run(command="duobench eval --out x")
    paths = sorted(tmp_path.iterdir())
    for sources in ([tmp_path], paths, paths[::-1], [tmp_path / "shard-*"]):
        merged = open_sources(sources)
        assert merged.read_run() == run
        assert merged.read_records(run) == sample_records(run)
    whole = summarize(run.suite.tasks, sample_records(run))
    assert summary_json(*read_summary(tmp_path)) == summary_json(run, whole)


def read_summary(path: Path) -> tuple[Run, object]:
    run, records = read_source(path)
    return run, summarize(run.suite.tasks, records)


def test_unfinished_shards_are_an_unfinished_run(tmp_path: Path) -> None:
    for number in (1, 2):
        folder(tmp_path, shard_run(number, 2))
    (tmp_path / "shard-1-of-2" / "records" / "lift" / "00000.json").unlink()
    merged = open_source(tmp_path)
    assert len(merged.read_records(merged.read_run())) == 11


def test_what_is_no_whole_run_is_refused(tmp_path: Path) -> None:
    one, two = (folder(tmp_path / "a", shard_run(n, 3)) for n in (1, 2))
    with pytest.raises(EvaluationError, match="Of 3 shards 1 are missing: number 3"):
        open_source(tmp_path / "a")
    copy = folder(tmp_path / "b", shard_run(2, 3))
    with pytest.raises(EvaluationError, match="are both shard 2/3"):
        open_sources([one.path, two.path, copy.path])
    halves = folder(tmp_path / "c", shard_run(2, 2))
    with pytest.raises(EvaluationError, match=r"one of 3 shards, .* one of 2: they overlap"):
        open_sources([one.path, halves.path])
    other = folder(tmp_path / "d", shard_run(3, 3, policy="other"))
    with pytest.raises(EvaluationError, match=r"different runs: .*policy mine instead of other"):
        open_sources([one.path, two.path, other.path])
    longer = folder(tmp_path / "e", shard_run(3, 3, episodes=5))
    with pytest.raises(EvaluationError, match=r"different runs: .*episodes 4 instead of 5 or more"):
        open_sources([one.path, two.path, longer.path])
    whole = sample_folder(tmp_path / "f", sample_run(), [])
    with pytest.raises(EvaluationError, match="is a whole run, no shard"):
        open_sources([one.path, whole.path])
    with pytest.raises(EvaluationError, match="is shard 1/3 of a run alone"):
        read_source(one.path)
    with pytest.raises(DuoBenchError, match="No folder with a run matches"):
        open_sources([tmp_path / "nothing*"])


def test_episode_of_another_shard_is_no_part_of_one(tmp_path: Path) -> None:
    one = folder(tmp_path, shard_run(1, 2))
    foreign = next(e for e in shard_run(2, 2).episodes())
    path = one.record(foreign.task.id, foreign.index)
    path.parent.mkdir(exist_ok=True)
    path.write_text("{}")
    assert len(one.read_records(one.read_run())) == one.read_run().size


def test_page_of_a_shard_says_so_and_that_of_all_shows_the_whole(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in (1, 2):
        folder(tmp_path, shard_run(number, 2))
    main(["report", str(tmp_path / "shard-1-of-2")])
    page = (tmp_path / "shard-1-of-2" / "index.html").read_text()
    assert "Shard 1 of 2: a part of a run" in page
    for _ in range(2):
        main(["report", str(tmp_path)])
    page = (tmp_path / "index.html").read_text()
    assert "Shard" not in page
    assert "not finished" not in page
    assert re.search(r"12\s+of\s+12 episodes|of 12 episodes", page)
    main(["bundle", str(tmp_path), "--out", str(tmp_path / "all.duobench.zip")])
    assert "12 records" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="is shard 1/2 of a run alone"):
        main(["bundle", str(tmp_path / "shard-1-of-2")])
    words = ["eval", "--policy", "hold", "--out", str(tmp_path / "shard-1-of-2")]
    with pytest.raises(SystemExit, match="holds a run, so that shards"):
        main([*words, "--shard", "1/2"])
