"""What pages show works as it stands there: their commands, then their code, in their order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
import pytest

from duobench.data import DataSet, ImageSource, transitions
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
    "own_learners": Shown(
        code={0: ("(", "environment_state", "True"), 2: (", 96, 96, 3)",)},
        commands={0: ("2 episodes",)},
        files=("bin_sort.hdf5", "left_wrist.npy", "rows.npz"),
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
    "teleoperation": Shown(code={0: ("waiting 0 Lead a tool", "\nrecording 3", "1 episodes\n")}),
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
    if name == "own_learners":
        check_learners(tmp_path)
    if name == "object_states":
        assert RunFolder(tmp_path / "runs" / "states").read_run().candidate.config.object_state


def check_learners(folder: Path) -> None:
    """What learners of one's own read is what was recorded."""
    found = [*transitions(DataSet.open(folder / "demos"), "bin_sort")]
    images = np.load(folder / "head.npy", mmap_mode="r")
    source = ImageSource("bin_sort", cameras="head", size=96)
    second = len(range(0, len(found[0].action), 3))
    for place, one, row in ((1, found[0], 3), (second + 2, found[1], 6)):
        shown = source.images(one.recording, row)["head"]
        np.testing.assert_array_equal(images[place], shown)
        chunk = np.load(folder / "rows.npz")["action"][place]
        np.testing.assert_array_equal(chunk, one.action[row : row + 30])
    source.close()
    with h5py.File(folder / "bin_sort.hdf5") as file:
        assert file["data"].attrs["total"] == sum(len(one.action) for one in found)
        for number, one in enumerate(found):
            demo = file[f"data/demo_{number}"]
            np.testing.assert_array_equal(demo["actions"], one.action)
            np.testing.assert_array_equal(demo["obs/tcp_pose"][1:], demo["next_obs/tcp_pose"][:-1])
            assert demo["obs/head_image"].shape == (len(one.action), 84, 84, 3)
            assert np.flatnonzero(demo["dones"]).tolist() == [len(one.action) - 1]


def test_the_file_of_leader_arms_is_one(tmp_path: Path) -> None:
    (text,) = blocks(page_of("teleoperation"), "toml")
    path = tmp_path / "gello.toml"
    path.write_text(text)
    assert GelloConfig.read(path).left.signs[5] == -1
