"""README.md and the pages that it begins with work as they stand, in their order; so do results.

Commands of `make` are left out: they make an environment of their own and `make test` is what runs
this file.
"""

import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from duobench.cli.program import parsed
from duobench.tasks import catalog
from tests.docs.markdown import ROOT, blocks, check_output, modules, page_of, run, tables, text_of
from tests.golden import episodes

README, COMMANDS, INSTALL, RESULTS, ADD = (
    ROOT / "README.md",
    *(page_of(name) for name in ("commands", "install", "results", "add_a_task")),
)
SET_UP = {"make", "python3", "pip"}
"""Programs that make environments, which no test here runs."""
MAX_LINES = 150
MAX_POLICY_LINES = 20


def shell_lines(page: Path) -> list[str]:
    lines = "\n".join(blocks(page, "sh")).splitlines()
    return [line for line in lines if line.startswith("duobench ")]


PLAYED = [
    pytest.param(page, line, marks=pytest.mark.long if page is COMMANDS else pytest.mark.slow)
    for page in (README, INSTALL, COMMANDS)
    for line in shell_lines(page)
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
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[Path, Path]:
    """Where the commands of each page run, one after another, as a reader would run them."""
    folders = {page: tmp_path_factory.mktemp(page.stem) for page in (README, INSTALL, COMMANDS)}
    for page, folder in folders.items():
        for name, code in modules(page).items():
            (folder / name).write_text(code, encoding="utf-8")
    (folders[README] / "stack_cube.py").write_text(blocks(ADD, "python")[0], encoding="utf-8")
    return folders


def test_the_first_page_is_short() -> None:
    assert len(text_of(README).splitlines()) <= MAX_LINES
    assert len(modules(README)["my_policy.py"].splitlines()) <= MAX_POLICY_LINES


def test_commands_within_sentences_of_the_first_page_are_whole() -> None:
    text = re.sub(r"```.*?```", "", text_of(README), flags=re.DOTALL)
    commands = [
        shlex.split(" ".join(one.split())) for one in re.findall(r"`(duobench [^`]+)`", text)
    ]
    assert commands
    for _, *words in commands:
        assert parsed(words)


def test_files_that_commands_of_the_first_page_name_are_named_before() -> None:
    before, _, _ = text_of(README).partition("duobench render stack_cube:TASK")
    assert "`stack_cube.py`" in before


@pytest.mark.parametrize("page", [README, INSTALL, COMMANDS], ids=lambda page: page.stem)
def test_every_command_is_known(page: Path) -> None:
    lines = "\n".join(blocks(page, "sh")).splitlines()
    assert {line.split()[0] for line in lines if line} <= {*SET_UP, "duobench"}
    assert set(modules(page).values()) == set(blocks(page, "python"))


@pytest.mark.parametrize(("page", "line"), PLAYED)
def test_command_runs(
    page: Path,
    line: str,
    folders: dict[Path, Path],
    in_background: list[subprocess.Popen[bytes]],
) -> None:
    words, folder = shlex.split(line, comments=True), folders[page]
    script = str(Path(sys.executable).with_name("duobench"))
    if words[-1] == "&":
        in_background.append(subprocess.Popen([script, *words[1:-1]], cwd=folder))
        return
    said = run([script, *words[1:]], folder)
    assert said
    check_output(page, line, said)


def test_verbs_of_make_exist() -> None:
    text = text_of(INSTALL)
    makefile = text_of(ROOT / "Makefile")
    verbs = set(re.findall(r"`make (\w+)`|^make (\w+)", text, flags=re.MULTILINE))
    assert verbs
    for verb in {first or second for first, second in verbs}:
        assert re.search(rf"^{verb}:", makefile, flags=re.MULTILINE), verb


# --- results -------------------------------------------------------------------------------------


def results(column: str) -> dict[str, dict[str, str]]:
    """Rows by task, of the table of results that has this column."""
    (rows,) = (rows for rows in tables(RESULTS) if column in rows[0])
    return {row["task"]: row for row in rows}


def test_experts_and_policies_of_the_paper_share_no_table() -> None:
    assert tuple(results("success rate")) == catalog.names()
    assert tuple(results("ACT")) == (*catalog.names(), "overall")


@pytest.mark.parametrize("name", catalog.names())
def test_experts_take_as_long_as_the_page_says(name: str) -> None:
    row = results("success rate")[name]
    mean, longest = map(int, row["steps to success, mean / max"].split("/"))
    golden = episodes.read()["tasks"][name]
    steps = [golden[str(seed)]["stages"][-1][0] for seed in episodes.SEEDS]
    assert mean <= longest <= catalog.get(name).horizon
    assert max(steps) <= longest + episodes.STEP_TOLERANCE
