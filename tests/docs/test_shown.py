"""What pages show works as it stands there: their commands, then their code, in their order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from duobench.results.folder import RunFolder
from duobench.teleop.leaders.gello import GelloConfig
from tests.docs.markdown import blocks, modules, page_of, run, run_python


@dataclass(frozen=True, kw_only=True)
class Shown:
    """What commands and code of a page print, by their number, and files that they write."""

    commands: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    code: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    files: tuple[str, ...] = ()


PAGES = {
    "object_states": Shown(
        commands={0: ("my_states:MyStates (privileged)",)}, code={0: ("white_cube_x 0.",)}
    ),
    "publish": Shown(
        commands={-1: ("Upload: hf upload me/my-demos demos --repo-type dataset",)},
        files=("demos/README.md", "demos/pictures/bin_sort.jpg"),
    ),
    "recording": Shown(
        commands={-1: ("1 episode, 0 problems",)},
        code={0: ("00000.parquet 30 steps", "cut=True"), 1: ("(96, 96, 3)", "bit-exact: True")},
    ),
    "robustness": Shown(
        commands={
            0: ("5 of 5 episodes",),
            1: ("5 episodes: exact 5,", "Verified."),
            2: ("Report: runs/robust/",),
        }
    ),
    "scale": Shown(
        commands={
            2: ("Report: runs/hold/index.html",),
            3: ("3 episodes: exact 3",),
            4: ("3 records",),
        }
    ),
    "teleoperation": Shown(code={0: ("waiting 0 Squeeze", "\nrecording 3", "1 episodes\n")}),
    "verification": Shown(
        commands={1: ("2 episodes: exact 2,",), 3: ("Verified.\n",)},
        code={0: ("True\n",)},
        files=("expert-report/index.html",),
    ),
}


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("name", PAGES)
def test_what_a_page_shows_works(name: str, tmp_path: Path) -> None:
    page, shown = page_of(name), PAGES[name]
    for file, code in modules(page).items():
        (tmp_path / file).write_text(code, encoding="utf-8")
    commands = blocks(page, "sh")[0].splitlines() if shown.commands else []
    said = [run(line, tmp_path) for line in commands]
    programs = [code for code in blocks(page, "python") if code not in modules(page).values()]
    printed = [run_python(code, tmp_path) for code in programs if shown.code]
    for outputs, expected in ((said, shown.commands), (printed, shown.code)):
        for number, words in expected.items():
            rest = outputs[number]
            for word in words:
                assert word in rest, outputs[number]
                rest = rest.partition(word)[2]
    assert [file for file in shown.files if not (tmp_path / file).exists()] == []
    if name == "object_states":
        assert RunFolder(tmp_path / "runs" / "states").read_run().candidate.config.object_state


def test_the_file_of_leader_arms_is_one(tmp_path: Path) -> None:
    (text,) = blocks(page_of("teleoperation"), "toml")
    path = tmp_path / "gello.toml"
    path.write_text(text)
    assert GelloConfig.read(path).left.signs[5] == -1
