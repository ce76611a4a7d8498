"""The resolver, with small files of known content in real folders and behind real sockets."""

import hashlib
import logging
import socket
from pathlib import Path, PurePosixPath

import mujoco_menagerie
import pytest

from duobench.assets import sources
from duobench.assets.cache import file_path
from duobench.assets.manifest import MeshFile
from duobench.assets.progress import silent
from duobench.assets.resolver import resolve
from duobench.errors import AssetError

CONTENT = {"fr3/one.obj": b"first mesh", "robotiq_2f85/two.stl": b"second mesh"}
MODELS = {"fr3": "franka_fr3", "robotiq_2f85": "robotiq_2f85_v4"}


def described(name: str) -> MeshFile:
    family, _, base = name.partition("/")
    return MeshFile(
        name=name,
        sha256=hashlib.sha256(CONTENT[name]).hexdigest(),
        size=len(CONTENT[name]),
        model=MODELS[family],
        menagerie=PurePosixPath("assets", base),
        wheel=PurePosixPath("somewhere", family, base),
    )


FILES = [described(name) for name in CONTENT]


def put(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


@pytest.mark.parametrize("layout", range(3))
def test_a_chosen_folder_is_read_in_every_layout(sealed, tmp_path, monkeypatch, layout):
    for file in FILES:
        put(tmp_path / "chosen" / file.layouts[layout], CONTENT[file.name])
    monkeypatch.setenv("DUOBENCH_ASSETS", str(tmp_path / "chosen"))
    assert resolve(FILES, silent) == CONTENT
    assert not sealed.exists()  # what lies on this machine is not copied


def test_the_cache_is_read_and_the_folder_comes_first(sealed, tmp_path, monkeypatch):
    for file in FILES:
        put(file_path(sealed, file), CONTENT[file.name])
    assert resolve(FILES, silent) == CONTENT
    monkeypatch.setenv("DUOBENCH_ASSETS", str(tmp_path / "chosen"))
    put(tmp_path / "chosen" / FILES[0].name, CONTENT[FILES[0].name])
    file_path(sealed, FILES[0]).unlink()
    assert resolve(FILES, silent) == CONTENT


def test_wrong_bytes_are_reported_and_the_next_source_is_used(
    sealed, tmp_path, monkeypatch, caplog
):
    put(tmp_path / "chosen" / FILES[0].name, b"first mesH")
    monkeypatch.setenv("DUOBENCH_ASSETS", str(tmp_path / "chosen"))
    for file in FILES:
        put(file_path(sealed, file), CONTENT[file.name])
    with caplog.at_level(logging.WARNING):
        assert resolve(FILES, silent) == CONTENT
    assert str(tmp_path / "chosen" / FILES[0].name) in caplog.text


def test_a_right_file_in_one_layout_wins_over_a_wrong_one_in_another(sealed, tmp_path, monkeypatch):
    del sealed
    put(tmp_path / "chosen" / FILES[0].layouts[0], b"something else")
    put(tmp_path / "chosen" / FILES[0].layouts[1], CONTENT[FILES[0].name])
    monkeypatch.setenv("DUOBENCH_ASSETS", str(tmp_path / "chosen"))
    assert resolve(FILES[:1], silent)[FILES[0].name] == CONTENT[FILES[0].name]


def test_a_checkout_of_menagerie_is_read_and_kept(sealed, tmp_path, monkeypatch):
    for file in FILES:
        put(tmp_path / "checkout" / file.model / file.menagerie, CONTENT[file.name])
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path / "checkout"))
    assert resolve(FILES, silent) == CONTENT
    monkeypatch.delenv("MENAGERIE_ROOT")
    assert resolve(FILES, silent) == CONTENT
    assert sorted(p.name for p in (sealed / "files").iterdir()) == sorted(
        file_path(sealed, file).name for file in FILES
    )


def test_a_damaged_cache_is_repaired_from_the_next_source(sealed, tmp_path, monkeypatch):
    put(file_path(sealed, FILES[0]), b"half of i")
    put(tmp_path / "checkout" / FILES[0].model / FILES[0].menagerie, CONTENT[FILES[0].name])
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path / "checkout"))
    resolve(FILES[:1], silent)
    assert file_path(sealed, FILES[0]).read_bytes() == CONTENT[FILES[0].name]


def test_models_in_the_cache_of_the_menagerie_package_are_used(sealed):
    del sealed
    cache = mujoco_menagerie.Cache()
    for file in FILES:
        folder = cache.model_path(mujoco_menagerie.get(file.model))
        put(folder / file.menagerie, CONTENT[file.name])
        (folder / ".complete").write_text("{}")
    assert resolve(FILES, silent) == CONTENT


def test_a_file_found_nowhere_is_one_error_that_lists_everything_tried(
    sealed, tmp_path, monkeypatch
):
    wrong = tmp_path / "chosen" / FILES[0].name
    put(wrong, b"not it")
    monkeypatch.setenv("DUOBENCH_ASSETS", str(tmp_path / "chosen"))
    with pytest.raises(AssetError) as caught:
        resolve(FILES, silent)
    message = str(caught.value)
    steps = [line for line in message.splitlines() if line.startswith("  ") and ". " in line[:6]]
    assert len(steps) == 4
    assert str(wrong) in steps[0]
    assert str(sealed) in steps[1]
    assert "127.0.0.1:9" in steps[2]
    assert "pip failed" in steps[3]
    assert all(file.name in message for file in FILES)
    assert "set DUOBENCH_ASSETS" in message
    assert "pip download" in message


def test_a_folder_that_does_not_exist_is_named(sealed, tmp_path, monkeypatch):
    del sealed
    monkeypatch.setenv("DUOBENCH_ASSETS", str(tmp_path / "typo"))
    with pytest.raises(AssetError, match="typo is no folder"):
        resolve(FILES, silent)


def test_a_server_that_never_answers_is_given_up(sealed, monkeypatch):
    del sealed
    monkeypatch.setattr(sources, "PROBE_SECONDS", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = "http://{}:{}".format(*server.getsockname())
        monkeypatch.setenv("MENAGERIE_BASE_URL", address)
        with pytest.raises(AssetError, match=f"{address}.* is out of reach"):
            resolve(FILES, silent)
