"""The pages on real arms: what they show runs, and numbers are those of the code."""

from pathlib import Path

import pytest

from duobench.hardware.guard import FINGER_MARGIN, MARGIN, TABLE_DEPTH
from duobench.hardware.rig import ArmConfig, Rig
from duobench.hardware.watched import STOP_AFTER_S
from tests.docs.markdown import DOCS, blocks, run, run_python, table, text_of

ARMS, SAFETY = DOCS / "real_arms.md", DOCS / "real_safety.md"


@pytest.mark.parametrize("page", [ARMS, SAFETY], ids=lambda page: page.stem)
def test_programs_run(page: Path, tmp_path: Path) -> None:
    for code in blocks(page, "python"):
        assert run_python(code, tmp_path)


def test_the_command_brings_a_simulated_rig_home(tmp_path: Path) -> None:
    (line,) = blocks(ARMS, "sh")
    words, _, command = line.strip().partition(" | ")
    assert words == "echo home"
    assert "Both arms are home." in run(command, tmp_path, "home\n")


def test_nothing_moves_without_the_word(tmp_path: Path) -> None:
    for more, code in (("", 1), (" --check", 0)):
        command = f"duobench real home --rig simulated --fast{more}"
        said = run(command, tmp_path, "yes\n", code=code)
        assert "everything answers" in said
        assert "Both arms are home." not in said


def test_the_file_is_a_rig_with_the_defaults_of_the_table(tmp_path: Path) -> None:
    (content,) = blocks(ARMS, "json")
    path = tmp_path / "rig.json"
    path.write_text(content)
    rig = Rig.read(path)
    assert len(rig.cameras) == 3
    named = [
        word.strip("` ")
        for row in table(ARMS, "field of an arm")
        for word in row["field of an arm"].split(",")
    ]
    known = set(ArmConfig.__dataclass_fields__) - {"driver", "address"}
    assert set(named) == known
    for row in table(ARMS, "field of an arm"):
        name = row["field of an arm"].strip("`")
        if name in known and row["default"] not in {"true"}:
            assert float(row["default"]) == getattr(ArmConfig(), name)


def test_numbers_are_those_of_the_code() -> None:
    text = text_of(SAFETY)
    assert f"keep {1000 * MARGIN:g} mm from each other" in text
    assert f"fingers keep {1000 * FINGER_MARGIN:g} mm" in text
    assert f"press {1000 * TABLE_DEPTH:g} mm on the table" in text
    assert f"after {STOP_AFTER_S:g} s" in text
    assert "Not yet tried on an arm." in text_of(ARMS)
    assert "tried on an arm yet" in text
