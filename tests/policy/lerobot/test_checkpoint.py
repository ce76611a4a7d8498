from pathlib import Path

import pytest

from duobench.errors import PolicyError
from duobench.policy.lerobot import checkpoint

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


def test_a_whole_checkpoint_is_found(folder: Path) -> None:
    assert checkpoint.find(str(folder)) == folder


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
