"""Tables that sort and episodes that filter: by keyboard, and without JavaScript all is there."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from dev.tools.pages import PHONE, View
from duobench.policy import PolicyMetadata
from duobench.results.comparison import compare, write_comparison
from duobench.results.folder import RunFolder
from duobench.results.records import Record
from duobench.results.report import write_report
from duobench.results.suite import find_tasks
from tests.pages.windows import opened
from tests.results.samples import sample_folder, sample_record, sample_run

LAPTOP = View(name="laptop", width=1440, height=900)
UNMET = ("left touches cube", "cube is 20 mm above bowl")
BOTTOM = "[...document.querySelectorAll('.results tr')].at(-1).getBoundingClientRect().bottom"
"""Where the results end, in CSS pixels from the top of the page."""


def played(folder: Path, name: str, share: float, *, privileged: bool) -> RunFolder:
    """A run of all tasks by a policy with noise, which succeeds in more episodes task by task."""
    tasks = find_tasks(())
    metadata = PolicyMetadata(name=name, version="1", object_state=privileged)
    run = sample_run(tasks=tasks, episodes=4, policy=name, metadata=metadata)
    records: list[Record] = []
    for task, episode in product(tasks, range(4)):
        won = episode < share * tasks.index(task)
        reached = tuple(range(1, task.max_stage + 1)) if won else (1,) * (episode % 2)
        unmet = () if won else UNMET[: 1 + episode % 2]
        records.append(sample_record(task, episode, reached, policy=name, unmet=unmet))
    records[0] = sample_record(tasks[0], 0, (), "Traceback\nValueError: no\n", policy=name)
    return sample_folder(folder, run, records)


@pytest.fixture(scope="module")
def comparison(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Six policies in all tasks, three of them privileged."""
    folder = tmp_path_factory.mktemp("runs")
    sources = [
        str(played(folder / f"{n}", f"package.of_mine:Policy{n}", n / 10, privileged=n > 2).path)
        for n in range(6)
    ]
    return write_comparison(compare(sources), folder / "all").as_uri()


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A report, whose notices say that the policy is privileged, has noise and made an error."""
    folder = played(tmp_path_factory.mktemp("run"), "mine", 0.4, privileged=True)
    write_report(folder)
    return folder.page.as_uri()


@contextmanager
def without_scripts(window: Browser, url: str) -> Iterator[Page]:
    context = window.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(url)
    yield page
    context.close()


def column(page: Page, table: str, number: int) -> list[str]:
    """What a column of a table shows, row by row."""
    rows = page.locator(f"{table} tbody tr:visible").all()
    return [row.locator("th, td").nth(number).inner_text() for row in rows]


def test_results_end_within_the_first_screen_of_a_laptop(
    window: Browser, report: str, comparison: str
) -> None:
    for url in (report, comparison):
        with opened(window, url, LAPTOP) as page:
            assert page.locator(".notice").count() >= 1
            assert page.evaluate(BOTTOM) <= LAPTOP.height
            assert page.evaluate("document.documentElement.scrollWidth") == LAPTOP.width
        with opened(window, url, PHONE) as page:
            assert page.evaluate("document.documentElement.scrollWidth") == PHONE.width


def test_keys_sort_a_table_both_ways_and_back(window: Browser, report: str) -> None:
    with opened(window, report, LAPTOP) as page:
        before = column(page, ".results", 0)
        button = page.get_by_role("button", name="Success / %")
        head = page.locator(".results th", has=button)
        button.focus()
        shown: list[list[str]] = []
        states: list[str | None] = []
        for _ in range(3):
            page.keyboard.press("Enter")
            shown.append(column(page, ".results", 0))
            states.append(head.get_attribute("aria-sort"))
        assert states == ["descending", "ascending", None]
        down, up, again = shown
        assert len(down) == 11 + 1
        assert down[-1] == up[-1] == "All tasks"
        assert set(down) < set(before)
        assert again == before
        page.keyboard.press("Space")
        rates = [float(cell) for cell in column(page, ".results", 1)[:-1]]
        assert rates == sorted(rates, reverse=True)
        assert len(set(rates)) > 3
        page.get_by_role("button", name="Task", exact=True).click()
        names = column(page, ".results", 0)[:-1]
        assert names == sorted(names)
        assert page.locator("[aria-sort]").count() == 1


def test_rows_of_a_comparison_sort_by_a_policy(window: Browser, comparison: str) -> None:
    with opened(window, comparison, LAPTOP) as page:
        page.locator(".results button.sort").first.press("Enter")
        names = column(page, ".results", 0)
        assert names[:-1] == sorted(names[:-1])
        assert len(names) == 11 + 1


def test_keys_filter_episodes_by_task_stage_and_constraint(window: Browser, report: str) -> None:
    with opened(window, report, LAPTOP) as page:
        page.get_by_text("All 44 episodes").press("Enter")
        rows = page.locator("details.episodes tbody tr:visible")
        count = page.locator("output")
        assert (rows.count(), count.inner_text()) == (44, "44 of 44 episodes")
        page.get_by_label("failed ones only").press("Space")
        failed = rows.count()
        assert count.inner_text() == f"{failed} of 44 episodes"
        assert page.locator("details.episodes tr.success:visible").count() == 0
        page.get_by_role("combobox", name="Did not hold").select_option("cube is … mm above bowl")
        assert 0 < rows.count() < failed
        assert all("20 mm" in text for text in rows.all_inner_texts())
        page.get_by_role("combobox", name="Last stage").select_option("1")
        titles = set(column(page, "details.episodes", 0))
        assert len(titles) > 1
        page.get_by_role("combobox", name="Task").press("ArrowDown")
        assert set(column(page, "details.episodes", 0)) < titles
        page.evaluate("location.hash = 'bin_sort-3'")
        page.wait_for_function("document.querySelector('output').value == '44 of 44 episodes'")
        page.get_by_role("combobox", name="Last stage").select_option("1")
        page.get_by_role("button", name="show all").press("Enter")
        page.wait_for_function("document.querySelector('output').value == '44 of 44 episodes'")
        page.get_by_role("combobox", name="Did not hold").select_option("failed with an error")
        assert rows.count() == 1


def test_count_of_a_stage_leads_to_its_episodes(window: Browser, report: str) -> None:
    with opened(window, report, LAPTOP) as page:
        link = page.locator("section.task .count a").first
        number = int(link.inner_text())
        link.press("Enter")
        page.wait_for_function("document.querySelector('details.episodes').open")
        assert page.locator("details.episodes tbody tr:visible").count() == number


def test_without_scripts_everything_is_there(window: Browser, report: str, comparison: str) -> None:
    with without_scripts(window, report) as page:
        assert page.locator("button.sort, form.filter:visible, .sorting:visible").count() == 0
        assert page.locator(".results tbody tr:visible").count() == 11 + 4 + 1
        page.get_by_text("All 44 episodes").press("Enter")
        assert page.locator("details.episodes tbody tr:visible").count() == 44
    with without_scripts(window, comparison) as page:
        rows = page.locator(".pairs tbody tr")  # first those within a group
        assert rows.count() == 15
        assert "Policy5" in rows.nth(8).inner_text()
        tests = page.locator("#tests-A-F")
        assert not tests.is_visible()
        rows.nth(8).get_by_role("link").press("Enter")
        assert tests.is_visible()
