from pathlib import Path

from duobench.replay.verify import verify
from duobench.results.folder import RunFolder
from duobench.results.report import write_report
from duobench.results.source import open_source
from duobench.results.suites.merged import MergedFolder, MergedRun
from duobench.results.suites.shard import Shard
from duobench.runners.evaluate import evaluate
from tests.evaluation.conftest import Play, small_suite


def test_four_shards_one_process_and_two_workers_give_the_same_summary(
    tmp_path: Path, play: Play, reference: dict[str, bytes]
) -> None:
    out = tmp_path / "sharded"
    for number in (1, 2, 3, 4):
        shard = Shard(number=number, count=4)
        for _ in range(2):  # the second call goes on, and finds nothing to do
            evaluate("random", small_suite(), RunFolder(out / shard.folder), workers=0, shard=shard)
    merged = open_source(out)
    assert isinstance(merged, MergedRun)
    write_report(MergedFolder(out, merged), merged)
    folder, _ = play("random", workers=2)
    summaries = [(out / "summary.json").read_bytes(), folder.summary.read_bytes()]
    assert summaries == [reference["summary.json"]] * 2
    names = {f"records/{path.parent.name}/{path.name}": path for path in out.glob("*/records/*/*")}
    assert {name: path.read_bytes() for name, path in names.items()} == {
        name: content for name, content in reference.items() if name.startswith("records")
    }
    assert verify(merged, import_tasks=True).is_verified


def test_shard_without_an_episode_is_no_error(tmp_path: Path) -> None:
    suite = small_suite(episodes=1)
    for number in (1, 2, 3):
        shard = Shard(number=number, count=3)
        evaluate("random", suite, RunFolder(tmp_path / shard.folder), workers=0, shard=shard)
    merged = open_source(tmp_path)
    assert len(merged.read_records(merged.read_run())) == 2
