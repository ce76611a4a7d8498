from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from duobench.evaluation.folder import RunFolder
from duobench.evaluation.metrics import Results
from duobench.evaluation.run import Run
from duobench.evaluation.runner import evaluate
from duobench.evaluation.suite import describe
from duobench.evaluation.versions import package_versions
from duobench.randomness import SUITE_VERSION
from tests.evaluation import small

Play = Callable[..., tuple[RunFolder, Results]]


def small_run(policy: str, **changes: Any) -> Run:
    """Run of the two small tasks, without films."""
    fields: dict[str, Any] = {
        "policy": policy,
        "tasks": describe([small.WAVE_NAME, small.NOD_NAME]),
        "episodes": 4,
        "first_episode": 0,
        "videos": 0,
        "suite_version": SUITE_VERSION,
        "versions": package_versions(),
    }
    return Run(**fields | changes)


@pytest.fixture
def play(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Play:
    """Evaluate a policy on the small tasks, in a folder of its own."""
    marks = tmp_path / "marks"
    marks.mkdir()
    monkeypatch.setenv(small.MARKS, str(marks))

    def run(
        policy: str, name: str = "run", workers: int = 1, retry_broken: bool = False, **changes: Any
    ) -> tuple[RunFolder, Results]:
        folder = RunFolder(tmp_path / name)
        if hasattr(small, policy):
            policy = f"{small.__name__}:{policy}"
        return folder, evaluate(
            small_run(policy, **changes), folder, workers=workers, retry_broken=retry_broken
        )

    return run
