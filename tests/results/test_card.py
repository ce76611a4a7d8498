"""Cards of checkpoints: numbers of a run of these weights, and of no others, with its bundle."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import pytest

from duobench.core.errors import EvaluationError, PolicyError
from duobench.core.randomness import SALTED
from duobench.envs.execution import ChunkExecution
from duobench.policy import PolicyMetadata
from duobench.policy.lerobot_checkpoint import content_hash
from duobench.results.bundle import BUNDLE_SUFFIX, Bundle, write_bundle
from duobench.results.card import EVALUATION, FIGURE, write_checkpoint_card
from duobench.results.folder import RunFolder
from duobench.results.report import read_parts
from duobench.results.suite import find_tasks
from duobench.tasks.shifts.shift import Shift
from tests.results.samples import CONFIG, sample_folder, sample_records, sample_run

NAME = "us/policy"


def run_of(folder: Path, version: str | None, *, object_state: bool = False) -> RunFolder:
    """A run whose policy has this version."""
    metadata = PolicyMetadata(
        name="mine", version=version, cameras=("head",), object_state=object_state
    )
    config = replace(CONFIG, object_state=object_state)
    run = sample_run(metadata=metadata, config=config)
    return sample_folder(folder, run, sample_records(run))


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    folder = tmp_path / "checkpoint"
    folder.mkdir()
    (folder / "weights.npz").write_bytes(b"weights")
    return folder


VERSION = hashlib.sha256(b"weights").hexdigest()[:16]


def test_card_has_the_numbers_and_the_bundle_of_the_run(tmp_path: Path, weights: Path) -> None:
    run = run_of(tmp_path / "run", VERSION)
    (weights / "training.json").write_text(json.dumps({"seed": 7}))
    text = write_checkpoint_card(weights, run.path, NAME, "mit").read_text(encoding="utf-8")
    assert 'license: "mit"' in text
    assert "sees head." in text
    assert "\ncd checkpoint\nduobench eval --policy " in text  # where its module lies
    assert "| seed | 7 |" in text
    (part,) = read_parts(run)
    for task, score in [*((one.task.id, one.score) for one in part.results.tasks)]:
        assert f"| {task} | 4 | {100 * (score.success_rate or 0):.1f} | " in text
    assert f"| all | 12 | {100 * part.results.overall.successes / 12:.1f} | " in text
    assert (weights / FIGURE).read_bytes().startswith(b"\x89PNG")
    assert Bundle(weights / EVALUATION).read_run() == run.read_run()
    assert hashlib.sha256((weights / EVALUATION).read_bytes()).hexdigest() in text


def test_card_of_a_bundle_is_that_of_its_run(tmp_path: Path, weights: Path) -> None:
    run = run_of(tmp_path / "run", VERSION)
    bundle = tmp_path / f"mine{BUNDLE_SUFFIX}"
    write_bundle(run, bundle)
    text = write_checkpoint_card(weights, bundle, NAME, "mit").read_text(encoding="utf-8")
    assert (weights / EVALUATION).read_bytes() == bundle.read_bytes()
    again = write_checkpoint_card(weights, weights / EVALUATION, NAME, "mit")
    assert again.read_text(encoding="utf-8") == text
    assert write_checkpoint_card(weights, run.path, NAME, "mit").read_text("utf-8") == text


def test_privileged_policies_are_told_to_be_such(tmp_path: Path, weights: Path) -> None:
    run = run_of(tmp_path / "run", VERSION, object_state=True)
    text = write_checkpoint_card(weights, run.path, NAME, "mit").read_text(encoding="utf-8")
    assert "which no camera shows" in text


def test_card_says_under_what_a_run_was_played_and_how_to_play_it(
    tmp_path: Path, weights: Path
) -> None:
    metadata = PolicyMetadata(name="mine", version=VERSION, cameras=("head",))
    run = sample_run(
        metadata=metadata,
        policy="my.py & co:P",
        first_episode=7,
        look="dark",
        shifts=(Shift.parse("physics-5"),),
        execution=ChunkExecution(execute=30, latency=6),
    )
    folder = sample_folder(tmp_path / "run", run, sample_records(run))
    text = write_checkpoint_card(weights, folder.path, NAME, "mit").read_text(encoding="utf-8")
    for words in (
        "Episodes 7 to 10 of each task (look dark, shift physics-5, 30 of a chunk at most",
        "latency of 6 control steps",
        "duobench eval --policy 'my.py & co:P' --tasks ",
        "--episodes 4 --first-episode 7 --look dark --shift physics-5 --execute 30 --latency 6 ",
    ):
        assert words in text


def test_card_of_a_run_that_is_not_finished_is_refused(tmp_path: Path, weights: Path) -> None:
    run = run_of(tmp_path / "run", VERSION)
    run.discard(run.finished(run.read_run())[0])
    with pytest.raises(EvaluationError, match="lacks 1 of 12 episodes"):
        write_checkpoint_card(weights, run.path, NAME, "mit")


def test_code_beside_weights_does_not_stand_for_them(tmp_path: Path, weights: Path) -> None:
    (weights / "mine.py").write_bytes(b"code")
    run = run_of(tmp_path / "run", hashlib.sha256(b"code").hexdigest()[:16])
    with pytest.raises(EvaluationError, match="no evaluation of"):
        write_checkpoint_card(weights, run.path, NAME, "mit")


@pytest.mark.parametrize("text", ["{bad", "[1, 2]", '"x"', "null"])
@pytest.mark.parametrize("name", ["training.json", "train_config.json"])
def test_what_is_known_of_a_training_is_one_object(
    tmp_path: Path, weights: Path, name: str, text: str
) -> None:
    (weights / name).write_text(text)
    with pytest.raises(PolicyError, match=name):
        write_checkpoint_card(weights, run_of(tmp_path / "run", VERSION).path, NAME, "mit")


@pytest.mark.parametrize("version", [None, "1", "0" * 16])
def test_a_run_of_other_weights_is_refused(
    tmp_path: Path, weights: Path, version: str | None
) -> None:
    run = run_of(tmp_path / "run", version)
    with pytest.raises(EvaluationError, match="no evaluation of"):
        write_checkpoint_card(weights, run.path, NAME, "mit")
    assert [path.name for path in weights.iterdir()] == ["weights.npz"]


def test_a_card_does_not_change_what_a_checkpoint_of_lerobot_is(
    tmp_path: Path, weights: Path
) -> None:
    (weights / "config.json").write_text('{"type": "act"}')
    (weights / "model.safetensors").write_bytes(b"tensors")
    (weights / "train_config.json").write_text('{"steps": 5, "dataset": {"repo_id": "us/demos"}}')
    before = content_hash(weights)
    run = run_of(tmp_path / "run", f"checkpoint {before[:16]}, 30 joint actions a chunk")
    text = write_checkpoint_card(weights, run.path, NAME, "mit").read_text(encoding="utf-8")
    assert content_hash(weights) == before
    for row in ("| policy | act |", "| steps | 5 |", "| data set | us/demos |"):
        assert row in text
    assert "--policy lerobot:checkpoint " in text
    assert "cd checkpoint" not in text


def test_a_card_says_the_settings_of_a_checkpoint_of_lerobot(tmp_path: Path, weights: Path) -> None:
    (weights / "config.json").write_text('{"type": "act"}')
    (weights / "model.safetensors").write_bytes(b"tensors")
    run = sample_run(
        policy="lerobot:runs/act?steps=5&device=cuda&action=joint",
        metadata=PolicyMetadata(name="mine", version=content_hash(weights)[:16]),
    )
    folder = sample_folder(tmp_path / "run", run, sample_records(run))
    text = write_checkpoint_card(weights, folder.path, NAME, "mit").read_text(encoding="utf-8")
    assert "--policy 'lerobot:checkpoint?steps=5&action=joint' " in text


def test_tasks_of_ones_own_are_told_and_imported(tmp_path: Path, weights: Path) -> None:
    text = write_checkpoint_card(weights, run_of(tmp_path / "run", VERSION).path, NAME, "mit")
    assert "on tasks that are not of the benchmark (lift, sort, turn)" in text.read_text()
    assert f"\nduobench verify checkpoint/{EVALUATION} --import-tasks\n" in text.read_text()
    metadata = PolicyMetadata(name="mine", version=VERSION)
    run = sample_run(metadata=metadata, tasks=find_tasks(["bin_sort"]))
    folder = sample_folder(tmp_path / "known", run, sample_records(run))
    text = write_checkpoint_card(weights, folder.path, NAME, "mit").read_text(encoding="utf-8")
    assert "not of the benchmark" not in text
    assert f"\nduobench verify checkpoint/{EVALUATION}\n" in text


def test_a_salted_run_is_repeated_with_a_salt(tmp_path: Path, weights: Path) -> None:
    metadata, config = PolicyMetadata(name="mine", version=VERSION), replace(CONFIG, split=SALTED)
    run = sample_run(metadata=metadata, config=config, salt="0" * 64)
    folder = sample_folder(tmp_path / "run", run, sample_records(run))
    text = write_checkpoint_card(weights, folder.path, NAME, "mit").read_text(encoding="utf-8")
    assert " --salt SALT " in text


def test_a_run_under_several_conditions_is_refused_for_that(tmp_path: Path, weights: Path) -> None:
    shifts = (Shift.parse("physics-1"), Shift.parse("physics-5"))
    run = sample_run(metadata=PolicyMetadata(name="mine", version=VERSION), shifts=shifts)
    folder = sample_folder(tmp_path / "run", run, sample_records(run))
    with pytest.raises(EvaluationError, match="has 2 policies or conditions, and a card is about"):
        write_checkpoint_card(weights, folder.path, NAME, "mit")


def test_a_bundle_in_the_cache_of_the_hub_is_replaced_not_written_through(
    tmp_path: Path, weights: Path
) -> None:
    run = run_of(tmp_path / "run", VERSION)
    bundle, cached = tmp_path / f"mine{BUNDLE_SUFFIX}", tmp_path / "blob"
    write_bundle(run, bundle)
    cached.write_bytes(b"of somebody else")
    (weights / EVALUATION).symlink_to(cached)
    write_checkpoint_card(weights, bundle, NAME, "mit")
    assert cached.read_bytes() == b"of somebody else"
    assert (weights / EVALUATION).read_bytes() == bundle.read_bytes()


def test_what_is_known_of_a_training_stays_in_its_cells(tmp_path: Path, weights: Path) -> None:
    run = run_of(tmp_path / "run", VERSION)
    card = write_checkpoint_card(weights, run.path, NAME, "mit")
    assert "| training |" not in card.read_text(encoding="utf-8")
    (weights / "training.json").write_text(json.dumps({"a|b": "c\nd|e", "long": "x" * 10_000}))
    text = write_checkpoint_card(weights, run.path, NAME, "mit").read_text(encoding="utf-8")
    assert "| a\\|b | c d\\|e |" in text
    assert max(map(len, text.splitlines())) < 1000
