"""What README.md says works: its code, its commands and its table, in the order of the page.

Commands of `make` are left out: they make an environment of their own and `make test` is what runs
this file.
"""

import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import pytest

from duobench.envs.config import EnvConfig
from duobench.tasks import catalog
from tests.docs.markdown import ROOT, blocks, modules, run, table, tables, text_of
from tests.golden import episodes

README = ROOT / "README.md"
MAX_POLICY_LINES = 20
MAX_QUICKSTART_LINES = 10


def shell_lines() -> list[list[str]]:
    return [
        words
        for block in blocks(README, "sh")
        for line in block.splitlines()
        if (words := shlex.split(line, comments=True))
    ]


@pytest.fixture(scope="module")
def in_background() -> Iterator[list[subprocess.Popen[bytes]]]:
    """What lines that end in & have started; it ends well when it is interrupted."""
    running: list[subprocess.Popen[bytes]] = []
    yield running
    for process in running:
        process.send_signal(signal.SIGINT)
    assert [process.wait() for process in running] == [0] * len(running)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the commands run, one after another, as a reader would run them."""
    folder = tmp_path_factory.mktemp("readme")
    for name, code in modules(README).items():
        (folder / name).write_text(code, encoding="utf-8")
    return folder


def test_every_kind_of_block_is_known() -> None:
    text = text_of(README)
    assert set(re.findall(r"^```(\w+)$", text, flags=re.MULTILINE)) == {"sh", "python", "bibtex"}
    assert {words[0] for words in shell_lines()} == {"pip", "duobench"}


def test_examples_of_the_page_are_short() -> None:
    assert len(modules(README)["my_policy.py"].splitlines()) <= MAX_POLICY_LINES
    (quickstart,) = (code for code in blocks(README, "python") if "gym.make" in code)
    assert len(quickstart.split("\n\n", 1)[1].splitlines()) <= MAX_QUICKSTART_LINES


@pytest.mark.parametrize(
    "code", [code for code in blocks(README, "python") if code not in modules(README).values()]
)
def test_code_runs(code: str, folder: Path) -> None:
    assert run([sys.executable, "-c", code], folder)


@pytest.mark.parametrize("line", [words for words in shell_lines() if words[0] == "duobench"])
def test_command_runs(
    line: list[str], folder: Path, in_background: list[subprocess.Popen[bytes]]
) -> None:
    script = Path(sys.executable).with_name("duobench")
    if line[-1] == "&":
        in_background.append(subprocess.Popen([str(script), *line[1:-1]], cwd=folder))
        return
    assert run([str(script), *line[1:]], folder)


def test_verbs_of_make_exist() -> None:
    text = text_of(README)
    makefile = text_of(ROOT / "Makefile")
    verbs = set(re.findall(r"`make (\w+)`|^make (\w+)", text, flags=re.MULTILINE))
    assert verbs
    for verb in {first or second for first, second in verbs}:
        assert re.search(rf"^{verb}:", makefile, flags=re.MULTILINE), verb


def test_options_are_those_of_an_environment() -> None:
    named = [row["option"] for row in table(README, "option")]
    assert named == [f.name for f in fields(EnvConfig) if f.name != "control_rate_hz"]


# --- results -------------------------------------------------------------------------------------


def results(column: str) -> dict[str, dict[str, str]]:
    """Rows by task, of the table of results that has this column."""
    (rows,) = (rows for rows in tables(README) if column in rows[0])
    return {row["task"]: row for row in rows}


def test_experts_and_policies_of_the_paper_share_no_table() -> None:
    experts, paper = results("success rate"), results("ACT")
    assert tuple(experts) == catalog.names()
    assert tuple(paper) == (*catalog.names(), "overall")


@pytest.mark.parametrize("name", catalog.names())
def test_experts_take_as_long_as_the_page_says(name: str) -> None:
    row = results("success rate")[name]
    mean, longest = map(int, row["steps to success, mean / max"].split("/"))
    golden = episodes.read()["tasks"][name]
    steps = [golden[str(seed)]["stages"][-1][0] for seed in episodes.SEEDS]
    assert mean <= longest <= catalog.get(name).horizon
    assert max(steps) <= longest + episodes.STEP_TOLERANCE


def test_the_overall_row_of_the_paper_is_the_mean_of_its_tasks() -> None:
    paper = results("ACT")
    overall = paper.pop("overall")
    for policy in ("ACT", "π0.5", "X-VLA"):
        rates, progress = zip(*(numbers(row[policy]) for row in paper.values()), strict=True)
        rate, mean = numbers(overall[policy])
        assert rate == pytest.approx(sum(rates) / len(rates), abs=0.51)
        assert mean == pytest.approx(sum(progress) / len(progress), abs=0.0101)


def numbers(cell: str) -> tuple[float, float]:
    """Success rate and progress, such as those of `12 (.73)`."""
    rate, progress = cell.strip(")").split(" (")
    return float(rate), float(progress)
