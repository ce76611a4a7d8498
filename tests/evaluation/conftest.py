import re
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from dev.benchmarks.kills import begun_once
from duobench.evaluation.policies import PolicyChoice
from duobench.evaluation.runners.evaluate import evaluate
from duobench.results.folder import RunFolder
from duobench.results.scores import Results
from duobench.results.suite import Suite, find_tasks
from tests.evaluation import toy_tasks
from tests.results.samples import without_times

Play = Callable[..., tuple[RunFolder, Results]]
SUITE = {field.name for field in fields(Suite)}


def small_suite(**changes: Any) -> Suite:
    """Four episodes of the two small tasks."""
    tasks = find_tasks([toy_tasks.WAVE_NAME, toy_tasks.NOD_NAME])
    return Suite(**{"tasks": tasks, "episodes": 4} | changes)


COMPARED = ("index.html", "summary.json", "run.json")


def compared(folder: RunFolder) -> dict[str, bytes]:
    """Everything that must not depend on how a run was made, had it been made at once."""
    with TemporaryDirectory() as name:
        return _compared(begun_once(folder, Path(name, "run")))


def _compared(folder: RunFolder) -> dict[str, bytes]:
    paths = [folder.path / name for name in COMPARED]
    paths += [*folder.path.glob("records/*/*/*"), *folder.path.glob("figures/*")]
    found = {str(path.relative_to(folder.path)): path.read_bytes() for path in sorted(paths)}
    found["index.html"] = without_times(found["index.html"].decode()).encode()
    return found


@pytest.fixture(scope="session")
def reference(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = RunFolder(tmp_path_factory.mktemp("reference") / "run")
    results = evaluate("random", small_suite(), folder, workers=0)
    # The comparison is worth something only if episodes differ.
    stages = [record.final_stage for one in results.tasks for record in one.records]
    assert len(set(stages)) > 1
    return compared(folder)


def without_policy(content: bytes) -> bytes:
    """A record without its run, what is known of its policy, and its checksum."""
    return re.sub(rb'\n  "(run|policy|policy_version|first_answer|sha256)": .*', b"", content)


def assert_same_episodes(folder: RunFolder, reference: dict[str, bytes], count: int) -> None:
    """Compare records with those of the random policy itself."""
    records = {name: c for name, c in compared(folder).items() if name.startswith("records")}
    assert len(records) == count
    of_random = {_episode(name): content for name, content in reference.items()}
    for name, content in records.items():
        assert without_policy(content) == without_policy(of_random[_episode(name)])


def _episode(name: str) -> tuple[str, str]:
    """Task and index in the name of a record."""
    return name.rpartition("/")[0].rpartition("/")[0], name.rpartition("/")[2]


@pytest.fixture
def play(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Play:
    """Evaluate a policy on the small tasks, in a folder of its own; in this process if not told."""
    marks = tmp_path / "marks"
    marks.mkdir()
    monkeypatch.setenv(toy_tasks.MARKS, str(marks))

    def run(
        policy: str | PolicyChoice, name: str = "run", **arguments: Any
    ) -> tuple[RunFolder, Results]:
        folder = RunFolder(tmp_path / name)
        if getattr(vars(toy_tasks).get(str(policy)), "__module__", "") == toy_tasks.__name__:
            policy = f"{toy_tasks.__name__}:{policy}"
        suite = {key: arguments.pop(key) for key in SUITE & arguments.keys()}
        arguments = {"workers": 0} | arguments
        return folder, evaluate(policy, small_suite(**suite), folder, **arguments)

    return run
