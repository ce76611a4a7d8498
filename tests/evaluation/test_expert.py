from pathlib import Path

from duobench.evaluation.folder import RunFolder
from duobench.evaluation.runner import evaluate
from duobench.evaluation.suite import describe
from tests.evaluation.conftest import small_run


def test_experts_score_the_same_with_one_worker_and_with_two(tmp_path: Path) -> None:
    run = small_run("expert", tasks=describe(["bin_sort", "carry_pot"]), episodes=2)
    one, two = (
        evaluate(run, RunFolder(tmp_path / str(workers)), workers=workers) for workers in (1, 2)
    )
    assert one == two
    assert one.overall.episodes == 4
    assert one.overall.errors == 0
    assert one.overall.successes > 0
    fingerprints = {record.fingerprint for task in one.tasks for record in task.records}
    assert len(fingerprints) == 4
