"""The baselines on object states: recorded, exported and played as a reader would."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import duobench
from duobench.data import DataSet, Recording
from duobench.evaluation.rollout import rollout
from duobench.results.folder import RunFolder
from tests.docs.markdown import ROOT

EXAMPLES = ROOT / "examples" / "object_states"
TASK = "carry_pot"
EXPORT = ("--per-task", "--cameras", "none", "--object-state", "--action", "cartesian")


def run(*words: str, folder: Path) -> str:
    program = str(Path(sys.executable).with_name("duobench"))
    done = subprocess.run(
        [program, *words], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def exports(tmp_path_factory: pytest.TempPathFactory, demonstrations: Callable[..., Path]) -> Path:
    folder = tmp_path_factory.mktemp("baselines")
    (folder / "demos").symlink_to(demonstrations(TASK, episodes=2))
    run("export", "lerobot", "demos", "--out", "exports", *EXPORT, folder=folder)
    return folder / "exports"


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch, exports: Path) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    monkeypatch.setenv("CHECKPOINT", str(exports / TASK))


@pytest.mark.usefixtures("example")
def test_nearest_state_does_again_what_was_shown(exports: Path) -> None:
    from nearest import Nearest  # pyright: ignore[reportMissingImports]

    env = duobench.make(
        TASK, cameras=False, object_state=True, action_mode="cartesian", split="train"
    )
    policy = Nearest()
    for path in DataSet.open(exports.with_name("demos")).episodes():
        rollout(env, policy, seed=Recording.read_info(path).seed or 0)
        assert env.get_wrapper_attr("judge").stage == 3


@pytest.mark.usefixtures("example")
def test_nearest_state_is_evaluated_as_a_privileged_policy(exports: Path) -> None:
    for name in ("nearest.py", "demonstrations.py"):
        (exports / name).write_text((EXAMPLES / name).read_text())
    words = ("--policy", "nearest:Nearest", "--tasks", TASK, "--episodes", "1", "--workers", "1")
    shown = run("eval", *words, "--out", "runs", folder=exports)
    assert "nearest:Nearest (privileged)" in shown
    (record,) = RunFolder(exports / "runs").read_records(RunFolder(exports / "runs").read_run())
    assert record.error is None
    assert record.steps > 0


@pytest.mark.usefixtures("example")
def test_grippers_open_late_and_stay_at_what_was_shown() -> None:
    from demonstrations import Grippers  # pyright: ignore[reportMissingImports]

    grippers = Grippers([[0.0, 0.45, 1.0], [0.0, 1.0]])

    def switched(left: float, right: float) -> tuple[float, float]:
        label = np.zeros(20, dtype=np.float32)
        label[9], label[19] = left, right
        grippers.switch(label)
        return round(float(label[9]), 2), float(label[19])

    assert switched(0.8, 0.6) == (1.0, 1.0)
    assert switched(0.4, 0.4) == (0.45, 0.0)
    assert switched(0.1, 0.8) == (0.0, 0.0)
    assert switched(0.4, 0.9) == (0.45, 1.0)
    assert switched(0.9, 0.9) == (0.45, 1.0)
    assert switched(0.95, 0.9) == (1.0, 1.0)


@pytest.mark.usefixtures("example")
def test_demonstrations_are_cut_at_success_and_at_the_release(exports: Path) -> None:
    from demonstrations import (  # pyright: ignore[reportMissingImports]
        Demonstrations,
        opening_columns,
    )

    recordings = list(DataSet.open(exports.with_name("demos")).recordings())
    whole, success, release = (
        Demonstrations.load(exports / TASK, until=until) for until in ("end", "success", "release")
    )
    assert whole.lengths.tolist() == [len(recording) for recording in recordings]
    assert success.lengths.tolist() == [r.success_step for r in recordings]
    assert (release.lengths < success.lengths).all()
    for data in (whole, release):
        last = np.cumsum(data.lengths) - 1
        opened = (data.labels[last] - data.labels[last - 1])[:, opening_columns(data.labels)]
        assert (opened > 0).any() == (data is release)


@pytest.mark.usefixtures("example")
def test_joint_labels_are_played_as_they_are(exports: Path) -> None:
    from demonstrations import action_mode, to_actions  # pyright: ignore[reportMissingImports]

    folder = exports.parent
    words = ("export", "lerobot", "demos", "--out", "joint", *EXPORT[:-1], "joint")
    run(*words, folder=folder)
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]

    data = Demonstrations.load(folder / "joint" / TASK, 1)
    recording = next(DataSet.open(folder / "demos").recordings())
    assert action_mode(data.labels) == "joint"
    assert np.array_equal(to_actions(data.labels), np.float32(recording.action))


@pytest.mark.usefixtures("example")
def test_network_is_trained_and_played(exports: Path, tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed here: make test-lerobot")
    import mlp  # pyright: ignore[reportMissingImports]
    from demonstrations import Demonstrations  # pyright: ignore[reportMissingImports]

    data = Demonstrations.load(exports / TASK)
    errors = [
        mlp.train(data, tmp_path / f"{steps}.npz", seed=0, steps=steps) for steps in (20, 300)
    ]
    assert errors[1] < errors[0] / 2
    mlp.train(data, tmp_path / "again.npz", seed=0, steps=20)
    one, other = (dict(np.load(tmp_path / f"{name}.npz")) for name in ("20", "again"))
    assert all(np.array_equal(one[name], other[name]) for name in one)
    pytest.MonkeyPatch().setenv("CHECKPOINT", str(tmp_path / "300.npz"))
    policy = mlp.MLP()
    policy.reset("", 0)
    env = duobench.make(TASK, cameras=False, object_state=True, action_mode="cartesian")
    chunk = policy.act(env.reset(seed=0)[0])
    assert chunk.shape == (30, 16)
    shown = np.float32(policy._openings[0] + policy._openings[1])
    assert set(np.unique(chunk[:, [7, 15]])) <= set(shown)
