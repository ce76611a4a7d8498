"""Every block of every page is run by a test, or a line beside it says why none runs it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.markdown import PAGES, ROOT, text_of

RUN_BY = {
    "tests/test_readme.py": "README: sh python text; commands: sh python; install: sh",
    "tests/docs/test_citation.py": "README: bibtex",
    "tests/docs/test_add_a_task.py": "add_a_task: sh python xml",
    "tests/docs/test_drawn.py": "looks: python",
    "tests/docs/test_environments.py": "environments: python; other_hardware: python; "
    "reinforcement_learning: python",
    "tests/docs/test_examples.py": "comparison: sh; policies: sh python; "
    "printing: sh python; scale: bash; serving: python toml; viewing: sh python",
    "tests/docs/test_first_teleoperation.py": "teleoperation: none",
    "tests/docs/test_real_pages.py": "real_arms: sh python json; real_cameras: python; "
    "real_evaluation: sh; real_recording: sh; real_safety: python; real_setup: sh python",
    "tests/docs/test_shown.py": "object_states: sh python; own_learners: sh python; "
    "publish: sh; recording: sh python; robustness: sh; scale: sh; teleoperation: python toml; "
    "verification: sh python",
    "tests/ecosystem/test_pages.py": "environments: python; reinforcement_learning: python",
    "tests/evaluation/interop/test_vla_eval.py": "serving: yaml",
    "tests/evaluation/test_observers.py": "evaluation: python",
    "tests/examples/test_object_states.py": "baselines: sh",
    "tests/lerobot/test_pages.py": "lerobot: sh python; parquet: python",
    "tests/lerobot/test_teleoperation.py": "lerobot_teleoperation: sh",
    "tests/teleop/test_plan.py": "people: none",
}
"""Languages of blocks by page, and the test that runs them."""
WHY = re.compile(r"No test runs")
WRITTEN = re.compile(r"<!-- .*: written by make docs -->")


def unexplained(page: Path) -> list[str]:
    """The blocks that nothing runs and nothing explains, by language and line."""
    found = re.findall(rf"{page.stem}: ([\w ]+)", "; ".join(RUN_BY.values()))
    run = set(" ".join(found).split())
    lines = text_of(page).splitlines()
    fences = [number for number, line in enumerate(lines) if line.startswith("```")]
    missing = []
    for begin, end in zip(fences[::2], fences[1::2], strict=True):
        language = lines[begin][3:] or "none"
        beside = "\n".join([*lines[max(0, begin - 6) : begin], *lines[end + 1 : end + 4]])
        if not (language in run or WHY.search(beside) or WRITTEN.search(lines[begin - 2])):
            missing.append(f"{language}, line {begin + 1}")
    return missing


@pytest.mark.parametrize(
    "page", [page for page in PAGES if "NOTICES" not in page.name], ids=lambda page: page.name
)
def test_a_block_runs_or_says_why_not(page: Path) -> None:
    assert unexplained(page) == []


@pytest.mark.parametrize("test", RUN_BY)
def test_what_runs_a_page_names_it(test: str) -> None:
    source = text_of(ROOT / test)
    for page in re.findall(r"(\w+):", RUN_BY[test]):
        assert page in source or page.partition("_")[2] in source, page
