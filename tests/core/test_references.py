"""From an import path to what it names."""

from collections.abc import Callable
from pathlib import Path

import pytest

from duobench.core.errors import DuoBenchError, ImportPathError, UnknownNameError
from duobench.core.references import load

MODULE = """
from fractions import Fraction
from pathlib import Path

RED, BLUE, SIZE = "red", "blue", 3

class Mine:
    pass
"""


@pytest.fixture(autouse=True)
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "loaded.py").write_text(MODULE)
    (tmp_path / "raises.py").write_text("1 / 0")
    (tmp_path / "needs.py").write_text("import no_such_library")
    (tmp_path / "leaves.py").write_text("raise SystemExit(3)")
    (tmp_path / "ours" / "sub").mkdir(parents=True)
    for package in ("ours", "ours/sub"):
        (tmp_path / package / "__init__.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)


def is_text(value: object) -> bool:
    return isinstance(value, str)


def test_what_a_path_names_is_imported() -> None:
    assert load("loaded:RED", "colour", is_text) == "red"
    assert load("loaded:Path", "class", callable) is Path


@pytest.mark.parametrize(
    ("path", "what", "fits", "words"),
    [
        (
            "loaded:RDE",
            "colour",
            is_text,
            r"loaded has no colour 'RDE'. Did you mean 'RED'\?.*BLUE, RED",
        ),
        ("loaded:SIZE", "colour", is_text, "whose SIZE is of type int, has no colour.*: BLUE, RED"),
        ("loaded:Yours", "class", callable, r"Known: Mine\.$"),  # the others are only imported
    ],
)
def test_another_attribute_lists_near_misses(
    path: str, what: str, fits: Callable[[object], bool], words: str
) -> None:
    with pytest.raises(UnknownNameError, match=words):
        load(path, what, fits)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("loaded", "'loaded' is no `module:attribute`"),
        ("loaded:", "is no `module:attribute`"),
        (
            "./loaded:RED",
            "names a file. In its folder, the module is found by its name: loaded:RED",
        ),
        ("my/loaded.py:RED", "In this folder, .* name: my.loaded:RED; in its own .*, loaded:RED"),
        ("ours/sub/loaded.py:RED", "In this folder, .* by its name: ours.sub.loaded:RED$"),
        ("sub/../../up/loaded.py:RED", "In its folder, .* by its name: loaded:RED$"),
        ("/lib/ours/loaded.py:RED", "In its folder, .* by its name: loaded:RED$"),
        (":RED", "is no `module:attribute`"),
        (".loaded:RED", "is no `module:attribute`"),
        ("nowhere:RED", "no module named 'nowhere'.*PYTHONPATH"),
        ("nowhere.at.all:RED", "no module named 'nowhere'.*PYTHONPATH"),
        ("raises:RED", r"(?s)'raises' cannot be imported.*raises\.py.*ZeroDivisionError"),
        ("needs:RED", r"(?s)'needs' cannot be imported.*needs\.py.*No module named 'no_such_lib"),
        ("__main__:NO", "another module in each process.* my_script:NO for my_script.py"),
        ("leaves:RED", "(?s)'leaves' cannot be imported.*SystemExit: 3"),
    ],
)
def test_what_cannot_be_imported_is_an_error(path: str, words: str) -> None:
    with pytest.raises(ImportPathError, match=words) as told:
        load(path, "colour", is_text)
    assert isinstance(told.value, DuoBenchError)
    assert "references.py" not in str(told.value)


def test_file_of_a_package_elsewhere_is_named_from_above_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path / "ours" / "sub")
    with pytest.raises(ImportPathError, match=f"In {tmp_path}, .* name: ours.sub.loaded:RED$"):
        load("loaded.py:RED", "colour", is_text)


def test_link_to_a_file_is_a_module_by_its_own_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "link.py").symlink_to(tmp_path / "ours" / "sub" / "loaded.py")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ImportPathError, match=r"In its folder, .* name: link:RED$"):
        load("link.py:RED", "colour", is_text)
