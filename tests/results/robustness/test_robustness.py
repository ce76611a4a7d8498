import json
from pathlib import Path
from typing import Any

import pytest

from duobench.cli import main
from duobench.errors import EvaluationError, OtherRunError
from duobench.results.robustness.conditions import conditions_in, read_robustness
from duobench.results.robustness.figure import levels_figure
from duobench.results.robustness.report import write_robustness
from duobench.results.run import Run
from duobench.shifts.shift import NO_SHIFT, Shift
from tests.results.samples import CONFIG, sample_folder, sample_records, sample_run

SHIFTS = (
    NO_SHIFT,
    *(Shift(axis=axis, level=level) for axis in ("look", "all") for level in (1, 5)),
)


def condition(parent: Path, shift: Shift, seed: int = 0, **changes: Any) -> Run:
    from dataclasses import replace

    run = sample_run(**changes).under(shift)
    config = replace(CONFIG, shift=shift)
    records = [
        replace(each, config=config, policy=run.policy) for each in sample_records(run, seed)
    ]
    records = [
        replace(each, execution=run.suite.execution_of(each.task, shift)) for each in records
    ]
    sample_folder(parent / shift.name, run, records)
    return run


@pytest.fixture
def played(tmp_path: Path) -> Path:
    for seed, shift in enumerate(SHIFTS):
        condition(tmp_path / "mine", shift, seed)
    return tmp_path / "mine"


def test_conditions_are_read_by_their_folders(played: Path) -> None:
    found = read_robustness(played)
    assert tuple(found.conditions) == SHIFTS
    assert found.axes == ["look", "all"]
    assert found.levels("look") == [0, 1, 5]
    assert found.missing == 0
    assert found.score("look", 2) is None
    for shift in SHIFTS:
        score = found.score(shift.axis, shift.level)
        assert score == found.conditions[shift].results.overall
    assert found.task("look", 1, "sort").score.episodes == 4
    assert conditions_in(played / "none") == {}


def test_page_and_document_have_the_numbers(played: Path) -> None:
    (played / "look-1" / "records" / "sort" / "00000.json").unlink()
    page = write_robustness([read_robustness(played)], played).read_text()
    assert "1 episode\nhave no record" in page
    assert 'href="look-5/index.html"' in page
    assert page.count("<h3>") == 2
    document = json.loads((played / "robustness.json").read_text())
    (one,) = document["policies"]
    assert list(one["conditions"]) == [shift.name for shift in SHIFTS]
    assert one["conditions"]["look-1"]["episodes"] == 11
    before = (played / "index.html").read_bytes()
    write_robustness([read_robustness(played)], played)
    assert (played / "index.html").read_bytes() == before


def test_several_policies_lie_over_each_other(played: Path, tmp_path: Path) -> None:
    for seed, shift in enumerate(SHIFTS[:3]):
        condition(tmp_path / "other", shift, 9 + seed, policy="other")
    words = [f"small={played}", str(tmp_path / "other"), "--out", str(tmp_path / "both")]
    main(["compare", *words])
    page = (tmp_path / "both" / "index.html").read_text()
    assert "small: all tasks" in page
    assert "other: all tasks" in page
    assert "none/index.html" not in page
    figure = levels_figure([read_robustness(played), read_robustness(tmp_path / "other")])
    panels = [axes for axes in figure.axes if axes.get_visible()]
    assert [panel.get_title(loc="left") for panel in panels] == ["look", "all axes"]
    assert [len(panel.get_lines()) for panel in panels] == [2, 1]
    with pytest.raises(OtherRunError, match="holds no evaluation under shifts"):
        write_robustness([read_robustness(played)], tmp_path)


def test_what_does_not_belong_together_is_refused(
    played: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    condition(played, Shift(axis="camera", level=1), policy="other")
    with pytest.raises(EvaluationError, match=r"camera-1 is of another evaluation.*policy mine"):
        read_robustness(played)
    (played / "camera-1").rename(played / "camera-2")
    with pytest.raises(EvaluationError, match="holds episodes with camera at level 1"):
        read_robustness(played)
    with pytest.raises(SystemExit, match="holds 6 conditions, each a run of its own"):
        main(["bundle", str(played)])
    with pytest.raises(SystemExit, match="no folder of the suite robust, as others are"):
        main(["compare", str(played), str(played / "none"), "--out", str(tmp_path / "c")])
    assert not capsys.readouterr().err
