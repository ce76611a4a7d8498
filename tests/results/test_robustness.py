"""What a run under shifts adds up to, on one page with one of its own for each condition."""

import json
from pathlib import Path
from typing import Any

import pytest

from duobench.cli import main
from duobench.core.errors import EvaluationError, OtherRunError
from duobench.results import figures
from duobench.results.entrants import read_named
from duobench.results.folder import RunFolder
from duobench.results.report import write_report
from duobench.results.robustness import Robustness, robustness_of, write_robustness
from duobench.tasks.shifts.shift import NO_SHIFT, Shift
from tests.results.samples import sample_folder, sample_records, sample_run

SHIFTS = (
    NO_SHIFT,
    *(Shift(axis=axis, level=level) for axis in ("look", "all") for level in (1, 5)),
)


def run_folder(path: Path, shifts: tuple[Shift, ...] = SHIFTS, **changes: Any) -> RunFolder:
    run = sample_run(shifts=shifts, **changes)
    return sample_folder(path, run, sample_records(run))


@pytest.fixture
def played(tmp_path: Path) -> RunFolder:
    return run_folder(tmp_path / "mine")


def read(folder: RunFolder) -> Robustness:
    (one,) = robustness_of(read_named(str(folder.path))[1])
    return one


def test_conditions_are_told_by_their_records(played: RunFolder) -> None:
    found = read(played)
    assert [part.condition.shift for part in found.parts] == list(SHIFTS)
    assert (found.axes, found.missing) == (["look", "all"], 0)
    assert list(found.levels("look")) == [0, 1, 5]
    assert found.at("look", 2) is None
    for part in found.parts:
        shift = part.condition.shift
        assert found.at(shift.axis, shift.level) is part
    result = found.parts[1].results.played("sort")
    assert result is not None
    assert result.score.episodes == 4


@pytest.mark.long
def test_page_and_document_have_the_numbers(played: RunFolder) -> None:
    played.record(read(played).parts[1].records[4].key).unlink()
    write_report(played)
    page = played.page.read_text()
    assert "1 episode\nhave no record" in page
    assert page.count("<h3>") == 2
    for shift in SHIFTS:
        link = f"conditions/mine.sim.{shift.name}.default/index.html"
        assert f'href="{link}"' in page
        assert f"{str(shift).capitalize()}: one of the cond" in (played.path / link).read_text()
    (one,) = json.loads((played.path / "robustness.json").read_text())["policies"]
    assert list(one["conditions"]) == [shift.name for shift in SHIFTS]
    assert one["conditions"]["look-1"]["episodes"] == 11
    summary = played.path / "conditions" / "mine.sim.look-1.default" / "summary.json"
    assert json.loads(summary.read_text())["overall"]["episodes"] == 11
    before = played.page.read_bytes()
    write_report(played)
    assert played.page.read_bytes() == before


def test_several_policies_lie_over_each_other(played: RunFolder, tmp_path: Path) -> None:
    other = run_folder(tmp_path / "other", SHIFTS[:3], policy="other")
    words = [f"small={played.path}", str(other.path), "--out", str(tmp_path / "both")]
    main(["compare", *words])
    page = (tmp_path / "both" / "index.html").read_text()
    said = [words in page for words in ("small: all tasks", "other: all tasks", "/index.html")]
    assert said == [True, True, False]
    runs = [
        (one.title, {axis: one.levels(axis) for axis in one.axes})
        for one in (read(played), read(other))
    ]
    figure = figures.levels(["look", "all"], runs)
    panels = [axes for axes in figure.axes if axes.get_visible()]
    assert [panel.get_title(loc="left") for panel in panels] == ["look", "all axes"]
    assert [len(panel.get_lines()) for panel in panels] == [2, 1]
    with pytest.raises(OtherRunError, match="holds no evaluation under shifts"):
        write_robustness([read(played)], tmp_path)


def test_one_condition_is_chosen_by_its_shift(played: RunFolder, tmp_path: Path) -> None:
    plain = run_folder(tmp_path / "plain", (NO_SHIFT,))
    out = ["--out", str(tmp_path / "c")]
    with pytest.raises(SystemExit, match=r"such as .*mine@none"):
        main(["compare", str(played.path), str(plain.path), *out])
    main(["compare", f"a={played.path}@look-5", f"b={plain.path}", *out])
    page = (tmp_path / "c" / "index.html").read_text(encoding="utf-8")
    assert "shift look at level 5 and no shift" in page
    with pytest.raises(EvaluationError, match="was not played with camera at level 1"):
        read_named(f"{played.path}@camera-1")
    with pytest.raises(EvaluationError, match="Nothing was played under a shift"):
        robustness_of(read_named(str(plain.path))[1])


@pytest.mark.slow
def test_run_that_grows_by_shifts_has_no_page_of_one_condition_left(tmp_path: Path) -> None:
    folder = run_folder(tmp_path, SHIFTS[:1])
    write_report(folder)
    assert folder.summary.exists()
    run_folder(tmp_path, SHIFTS[:2])
    write_report(folder)
    assert not folder.summary.exists()
    assert [path.name for path in (folder.path / "figures").iterdir()] == ["levels.svg"]
