import itertools
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import pytest

from duobench.results.figures import (
    DASHES,
    FIGURES,
    INK,
    SUCCESS,
    for_page,
    ink_on,
    levels,
    plots,
    stage_colours,
)
from duobench.results.scores import summarize
from tests.results.samples import LIFT, TASKS, sample_record, sample_records, sample_run

RUN = sample_run(episodes=8)
FOUND = summarize(RUN.suite.tasks, sample_records(RUN))


def words(svg: str) -> list[str]:
    root = ET.fromstring(svg)
    return ["".join(node.itertext()).strip() for node in root.iter() if node.tag.endswith("text")]


@pytest.mark.slow
def test_same_results_give_the_same_bytes_in_any_process() -> None:
    """Whatever it hashes with, and whenever: there is no date in them."""
    code = "from tests.results.test_figures import FOUND, plots\nprint(repr(plots(FOUND)))"
    printed = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(__file__).parents[2],
        env={**os.environ, "PYTHONHASHSEED": "1"},
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert printed.strip() == repr(plots(FOUND))


@pytest.mark.slow
def test_settings_of_a_user_change_no_figure(tmp_path: Path) -> None:
    """And what a library's caller chose as backend stays."""
    settings = tmp_path / "matplotlibrc"
    settings.write_text("text.usetex: True\naxes.grid: True\nlines.linewidth: 9\n")
    code = "from tests.results.test_figures import FOUND, plots\nprint(repr(plots(FOUND)))\n"
    code += "import matplotlib\nprint(matplotlib.rcParams['backend'])"
    printed = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(__file__).parents[2],
        env={**os.environ, "MATPLOTLIBRC": str(settings), "MPLBACKEND": "svg"},
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert printed.splitlines() == [repr(plots(FOUND)), "svg"]


def test_figures_name_every_task_and_its_success_rate() -> None:
    titles = {task.title for task in TASKS}
    rates = {f"{100 * one.score.successes / one.score.episodes:.1f} %" for one in FOUND.tasks}
    assert titles <= set(words(plots(FOUND)["progress"]))
    assert titles | rates <= set(words(plots(FOUND)["stages"]))


@pytest.mark.parametrize("name", FIGURES)
def test_element_for_a_page_brings_no_style_sheet_and_takes_the_pages_ink(name: str) -> None:
    element = for_page(plots(FOUND)[name])
    root = ET.fromstring(element)
    assert root.get("width") is None
    assert root.get("viewBox")
    assert [word in element for word in ("<style", INK, "currentColor")] == [False, False, True]
    assert words(element) == words(plots(FOUND)[name])
    assert not [node for node in root.iter() if node.tag.endswith("}g") and node.get("id")]


@pytest.mark.parametrize("name", FIGURES)
def test_run_without_records_can_be_plotted(name: str) -> None:
    assert plots(summarize(TASKS, []))[name].rstrip().endswith("</svg>")


@pytest.mark.parametrize("title", [r"$\frac$", "from $5 to $10", "50 % & <more>", "日本語"])
@pytest.mark.parametrize("name", FIGURES)
def test_title_is_shown_as_it_is(name: str, title: str) -> None:
    task = replace(LIFT, title=title)
    assert title in words(plots(summarize([task], [sample_record(task, 0, (1,))]))[name])


@pytest.mark.parametrize("name", FIGURES)
def test_long_title_is_cut(name: str) -> None:
    task = replace(LIFT, title="Long" * 25)
    assert "LongLongLongLongLongLon…" in words(
        plots(summarize([task], [sample_record(task, 0, (1,))]))[name]
    )


def test_curves_have_the_dashes_of_their_legend() -> None:
    score = FOUND.overall
    figure = levels(["look"], [(str(name), {"look": {1: score, 2: score}}) for name in DASHES])
    curves = figure.axes[0].lines
    (legend,) = figure.legends
    patterns = [str(curve._dash_pattern) for curve in curves]
    assert len(set(patterns)) == len(DASHES)
    assert [(curve.get_color(), curve.get_linestyle()) for curve in curves] == [
        (line.get_color(), line.get_linestyle()) for line in legend.get_lines()
    ]


STAGES = range(1, 8)


def luminance(colour: str) -> float:
    """Relative luminance after WCAG 2.2, from sRGB."""
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_stages_get_lighter_and_success_stands_apart() -> None:
    for max_stage in STAGES:
        *failing, last = stage_colours(max_stage)
        assert len(failing) == max_stage
        assert last == SUCCESS
        brightness = [luminance(colour) for colour in failing]
        assert brightness == sorted(set(brightness))


def test_text_on_every_stage_can_be_read() -> None:
    for colour in itertools.chain.from_iterable(map(stage_colours, STAGES)):
        assert contrast(colour, ink_on(colour)) >= 4.5, colour
