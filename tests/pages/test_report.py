import os
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dev.tools.pages import DESKTOP, PHONE, VIEWS, View, measure, paper, screenshot, violations
from duobench.core.codecs import VP9
from duobench.core.video import write_video
from duobench.policy import PolicyMetadata
from duobench.results.journal import PARTS, EpisodeTimes
from duobench.results.report import write_report
from tests.results.samples import SORT, TURN, key, sample_folder, sample_record, sample_run

AXE = Path(os.environ["DUOBENCH_AXE"])
FRAMES = [np.full((96, 128, 3), shade, np.uint8) for shade in (20, 80, 140)]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Report of a privileged, unfinished run with everything that a report can show."""
    metadata = PolicyMetadata(name="mine", version="1", object_state=True)
    run = sample_run(episodes=9, metadata=metadata)
    records = [
        sample_record(SORT, 0, clipped=3),
        sample_record(SORT, 1, (5,), unmet=("cube is 20 mm above bowl, not at most 12 mm",)),
        sample_record(SORT, 2, (5,), unmet=("cube is 31 mm above bowl, not at most 12 mm",)),
        sample_record(SORT, 3, (5, 9), unmet=("left touches cube", "a " + "very " * 60 + "long")),
        sample_record(TURN, 0, (), error="Traceback\n  " + "x" * 200 + "\nValueError: no\n"),
        sample_record(TURN, 1, (3,), versions={"python": "3.13"}),
    ]
    folder = sample_folder(tmp_path_factory.mktemp("run"), run, records)
    times = EpisodeTimes(total=9, **dict.fromkeys(PARTS, 1.0))
    with folder.writer() as journal:
        journal.start("duobench eval --policy mine", 2)
        for record in records:
            journal.end(record, times)
    for episode in (0, 1):
        path = folder.video(key(folder, SORT.id, episode))
        path.parent.mkdir(parents=True, exist_ok=True)
        write_video(FRAMES, path, VP9, Fraction(15))
    write_report(folder)
    return folder.page


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.name)
def test_no_rule_of_accessibility_is_broken(page: Path, view: View) -> None:
    assert [(each["id"], each["nodes"]) for each in violations(page, AXE, view)] == []


def test_broken_rules_are_found(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text('<!doctype html><html><body><img src="x.png"></body></html>')
    assert "image-alt" in [each["id"] for each in violations(page, AXE, DESKTOP)]


def test_phone_shows_the_success_rate_first_and_no_more_than_its_width(page: Path) -> None:
    width, bottom, figure = measure(
        page,
        PHONE,
        "[document.documentElement.scrollWidth,"
        " document.querySelector('.numbers dd').getBoundingClientRect().bottom,"
        " document.querySelector('.numbers dd').textContent.trim().slice(0, 6)]",
    )
    assert width == PHONE.width
    assert bottom < PHONE.height
    assert figure == "33.3 %"


def test_filter_leaves_failed_episodes(page: Path) -> None:
    before, after = measure(
        page,
        DESKTOP,
        """(() => {
          const list = document.querySelector('details.episodes');
          const shown = () => [...list.querySelectorAll('tbody tr')]
            .filter((row) => row.getClientRects().length).length;
          list.open = true;
          const counts = [shown()];
          list.querySelector('input').click();
          return [...counts, shown()];
        })()""",
    )
    assert (before, after) == (6, 4)


def test_link_to_an_episode_unfolds_the_list(page: Path) -> None:
    assert measure(
        page,
        DESKTOP,
        """(() => {
          location.hash = '#sort-2';
          reveal();
          return document.querySelector('details.episodes').open;
        })()""",
    )


def test_page_can_be_shown_and_printed(page: Path, tmp_path: Path) -> None:
    screenshot(page, DESKTOP, tmp_path / "desktop.png")
    with Image.open(tmp_path / "desktop.png") as image:
        assert image.size == (DESKTOP.width, DESKTOP.height)
        assert len(image.convert("RGB").getcolors(1 << 24) or ()) > 10
    paper(page, tmp_path / "paper.pdf")
    assert (tmp_path / "paper.pdf").read_bytes().startswith(b"%PDF")


def test_paper_is_as_wide_as_the_page_and_shows_errors(page: Path) -> None:
    """A rule of style for paper holds on paper alone: here the style sheet is that of paper."""
    text = page.read_text(encoding="utf-8")
    printed = page.with_name("printed.html")
    printed.write_text(text.replace("@media print", "@media all"), encoding="utf-8")
    sheet = View(name="paper", width=720, height=1000)
    try:
        cut, is_open, posters = measure(
            printed,
            sheet,
            """(() => {
              dispatchEvent(new Event('beforeprint'));
              const wide = [...document.querySelectorAll('.wide')];
              return [wide.filter((part) => part.scrollWidth > part.clientWidth + 1).length,
                [...document.querySelectorAll('details.error')].every((part) => part.open),
                [...document.querySelectorAll('video')].every((video) => video.poster)];
            })()""",
        )
    finally:
        printed.unlink()
    assert (cut, is_open, posters) == (0, True, True)
