import json
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from duobench import policy
from duobench.core.errors import PolicyError, UnknownNameError
from duobench.envs.state_labels import StatePart, names_of
from duobench.evaluation import policies
from duobench.policy import lerobot_checkpoint as checkpoint
from duobench.policy.lerobot_checkpoint import Address, parse

FILES = (
    "config.json",
    "model.safetensors",
    "policy_preprocessor.json",
    "policy_postprocessor.json",
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "policy"
    folder.mkdir()
    for name in FILES:
        (folder / name).write_text(name)
    return folder


@pytest.mark.parametrize("name", FILES)
def test_the_hash_is_that_of_every_file_that_decides(folder: Path, name: str) -> None:
    before = checkpoint.content_hash(folder)
    (folder / "README.md").write_text("words")
    (folder / "train_config.json").write_text("{}")
    assert checkpoint.content_hash(folder) == before
    (folder / name).write_text("other")
    assert checkpoint.content_hash(folder) != before


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file_is_named(folder: Path, name: str) -> None:
    assert checkpoint.find(str(folder)) == folder
    (folder / name).unlink()
    with pytest.raises(PolicyError, match=name):
        checkpoint.find(str(folder))


def test_adapters_alone_are_no_policy(folder: Path) -> None:
    (folder / "adapter_config.json").write_text("{}")
    with pytest.raises(PolicyError, match="merge them"):
        checkpoint.find(str(folder))


@pytest.mark.parametrize("name", ["nowhere", "./nowhere/there", "/nowhere/there", "a/b/c"])
def test_what_is_neither_folder_nor_id_is_never_looked_for_on_the_hub(name: str) -> None:
    with pytest.raises(PolicyError, match="There is no folder"):
        checkpoint.find(name)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("runs/act", Address(checkpoint="runs/act")),
        ("user/name", Address(checkpoint="user/name")),
        ("runs/x?domain=real", Address(checkpoint="runs/x", domain="real")),
        (
            "a:b?steps=10&device=cuda:1&dtype=bfloat16",
            Address(checkpoint="a:b", steps=10, device="cuda:1", dtype="bfloat16"),
        ),
    ],
)
def test_a_name_says_which_checkpoint_and_how_it_runs(text: str, expected: Address) -> None:
    assert parse(text) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "lerobot:PATH_OR_ID"),
        ("?steps=3", "lerobot:PATH_OR_ID"),
        ("a?step=3", "Did you mean 'steps'"),
        ("a?steps=0", "1 or more, got '0'"),
        ("a?steps=ten", "1 or more, got 'ten'"),
        ("a?steps=٣", "1 or more"),
        ("a?device=", "needs one value"),
        ("a?steps=3&steps=4", "needs one value"),
        ("a?domain=rael", "Did you mean 'real'"),
    ],
)
def test_a_name_that_says_nothing_clear_is_rejected(text: str, message: str) -> None:
    error = UnknownNameError if "Did you mean" in message else PolicyError
    with pytest.raises(error, match=message):
        parse(text)


def test_without_lerobot_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [*sys.modules]:
        if name.startswith("duobench.policy.lerobot_model"):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)  # as if it were not installed
    policies.PolicyChoice.parse("lerobot:runs/act")
    with pytest.raises(PolicyError, match=r"pip install '\.\[lerobot\]'"):
        policy.make("lerobot:runs/act")


@pytest.mark.parametrize(
    ("size", "names", "message"),
    [
        (30, None, "tool poses may follow where duobench_names.json"),
        (30, names_of([StatePart.JOINT_VELOCITY]), "joint_velocity, which no environment shows"),
        (44, names_of([*StatePart]), "joint_velocity, which no environment shows"),
        (44, names_of([StatePart.TCP_POSE]), r"shape \(44,\)"),
        (7, [f"joint_{number}" for number in range(7)], r"shape \(7,\)"),
    ],
)
def test_a_state_that_no_environment_shows_is_refused(
    folder: Path, size: int, names: list[str] | None, message: str
) -> None:
    if names is not None:
        text = json.dumps({"observation.state": list(names)})
        (folder / "duobench_names.json").write_text(text)
    config = SimpleNamespace(robot_state_feature=SimpleNamespace(shape=(size,)))
    with pytest.raises(PolicyError, match=message):
        checkpoint.state_parts(folder, config)


def test_sixteen_numbers_are_joints_and_openings_without_names(folder: Path) -> None:
    for feature in (None, SimpleNamespace(shape=(16,))):
        config = SimpleNamespace(robot_state_feature=feature)
        assert checkpoint.state_parts(folder, config) == ()
