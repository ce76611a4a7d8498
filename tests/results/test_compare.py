"""Everything that a comparison writes."""

import csv
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from duobench.core.errors import OtherRunError
from duobench.results.compare import compare, write_comparison
from duobench.results.statistics import any_time
from duobench.results.tables import CSV_HEADER
from tests.results.outcomes import play
from tests.results.test_report import Page

ROOT = Path(__file__).parents[2]
A = {"sort": [3] * 12, "lift": [2, 2, 0, 1] * 3, "turn": [1, 0] * 6}
B = {"sort": [0, 1] * 6, "lift": [2, 0, 0, 1] * 3, "turn": [1, 1, 0] * 4}
FILES = (
    "index.html",
    "comparison.json",
    "table.md",
    "table.csv",
    "table.tex",
    "figures/stages.svg",
    "figures/progress.svg",
)


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("runs")
    return [
        play(folder / "a", A, "act_$1%"),
        play(folder / "b", B, "<b>&"),
        f"told={play(folder / 'c', {'sort': B['sort']}, 'told', object_state=True)}",
        "paper:pi05",
    ]


@pytest.fixture(scope="module")
def out(sources: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_comparison(compare(sources), tmp_path_factory.mktemp("out")).parent


def test_same_runs_give_the_same_bytes_in_any_process(
    sources: list[str], out: Path, tmp_path: Path
) -> None:
    code = (
        "import sys\nfrom pathlib import Path\n"
        "from duobench.results.compare import compare, write_comparison\n"
        "write_comparison(compare(sys.argv[2:]), Path(sys.argv[1]))"
    )
    subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "again"), *sources],
        env={**os.environ, "PYTHONHASHSEED": "1"},
        check=True,
    )
    written = [path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()]
    assert sorted(written) == sorted(FILES)
    for name in FILES:
        assert (tmp_path / "again" / name).read_bytes() == (out / name).read_bytes(), name


def test_page_is_whole_loads_nothing_and_says_every_pair_in_words(out: Path) -> None:
    page = Page(out / "index.html")
    html = (out / "index.html").read_text()
    anchors = {f"#{name}" for name in page.ids}
    assert [link for link in page.links if link not in anchors and not (out / link).is_file()] == []
    assert not re.search(r"(src|url)\s*[=(]\s*[\"']?\s*(https?:)?//", html)
    assert "<script " not in html
    assert "<b>&" not in html.replace("<b>&amp;", "")
    assert all(name in page.words for name in ("act_$1%", "<b>&", "told", "π0.5 [paper]"))
    for words in (
        "act_$1% is better than <b>& in 1 of 3 tasks after Holm (Sort)",
        "act_$1% solves more than told in Sort",
        "It does not say which policy is the better one.",
        "Paired: both played the same episodes.",
        "the any-time p-value counts: it claims a difference in Sort.",
        "Ten looks at a growing run",
    ):
        assert words in page.words


def test_tables_have_captions_and_scoped_headers_and_scroll(out: Path) -> None:
    html = (out / "index.html").read_text()
    tables = re.findall(r"<table.*?</table>", html, flags=re.DOTALL)
    assert len(tables) == 3 + 3
    assert len(re.findall(r'<div class="wide" [^>]*tabindex="0"[^>]*><table', html)) == len(tables)
    for table in tables:
        assert "<caption>" in table
        assert re.findall(r"<th(?![^>]*scope)[ >]", table) == []


def test_what_was_measured_elsewhere_is_marked_everywhere(tmp_path: Path) -> None:
    run = play(tmp_path / "run", {"carry_pot": [2, 0, 1]})
    out = write_comparison(compare([run, "paper:ACT"]), tmp_path / "out").parent
    for name in ("index.html", "table.md", "table.csv", "table.tex", "comparison.json"):
        assert "measured elsewhere, on other tasks" in (out / name).read_text().lower(), name
    assert "| 33.3 (0.50) | 44 (0.63) |" in (out / "table.md").read_text()
    assert "nothing to test it against" in Page(out / "index.html").words


def test_the_papers_and_its_authors_numbers_stand_apart_each_with_its_source(
    tmp_path: Path,
) -> None:
    run = play(tmp_path / "run", {"carry_pot": [2, 0, 1]})
    comparison = compare(["authors:ACT", "paper:ACT", run, "authors:pi05", "authors:xvla"])
    assert comparison.pairs == ()
    out = write_comparison(comparison, tmp_path / "out").parent
    for name in ("index.html", "table.md", "table.csv", "table.tex", "comparison.json"):
        assert "measured elsewhere, on other tasks" in (out / name).read_text().lower(), name
    text = (out / "table.md").read_text()
    assert "| 33.3 (0.50) | 54.0 (–) | 44 (0.63) | – | 12.3 (–) |" in text
    words = Page(out / "index.html").words
    for words_there in (text, words):
        assert "ACT" in words_there
        assert words_there.count("Jülg") == words_there.count("the cards of the authors") > 0
    assert "54.0 (–) 48.3–59.6" in " ".join(words.split())
    document = json.loads((out / "comparison.json").read_text())
    (row,) = (row for row in document["rows"] if row["tasks"] == ["carry_pot"])
    quoted = row["results"]["B"]
    assert (quoted["successes"], quoted["episodes"]) == (162, 300)
    assert quoted["mean_final_progress"] is None
    with (out / "table.csv").open(encoding="utf-8", newline="") as file:
        lines = [line for line in csv.DictReader(file) if line["name"] == "X-VLA [authors]"]
    assert {(line["mean_final_progress"], line["best_of_group"]) for line in lines} == {("", "0")}
    assert all(float(line["wilson_low"]) < float(line["success_rate"]) for line in lines)


def test_markdown_has_a_row_a_task_and_bold_only_for_the_better_one(out: Path) -> None:
    lines = (out / "table.md").read_text().splitlines()
    header = next(line for line in lines if line.startswith("| task"))
    rows = [line for line in lines if re.match(r"\| (Sort|Lift|Turn)", line)]
    assert len(rows) == 3
    assert all(row.replace(r"\|", "").count("|") == header.count("|") for row in rows)
    assert "| **100.0** (1.00) | 0.0 (0.17) | 0.0 (0.17) | – |" in rows[0]
    assert "**" not in rows[1] + rows[2]


def test_latex_escapes_names_and_has_as_many_cells_in_each_row(out: Path) -> None:
    tex = (out / "table.tex").read_text()
    assert r"act\_\$1\%" in tex
    assert r"$\pi$0.5" in tex
    assert r"\textless{}b\textgreater{}\&" in tex
    assert r"\textbf{100.0} (1.00)" in tex
    assert tex.isascii() or set(re.sub(r"[\x00-\x7f]", "", tex)) <= set("ü")
    rows = [line for line in tex.splitlines() if line.endswith(r"\\")]
    counts = {len(re.findall(r"(?<!\\)&", row)) for row in rows if "multicolumn" not in row}
    assert counts == {4}


def test_csv_has_a_line_for_each_policy_in_each_row(out: Path) -> None:
    with (out / "table.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == CSV_HEADER
    sort = {row["name"]: row for row in rows if row["row"] == "sort"}
    assert (sort["act_$1%"]["success_rate"], sort["act_$1%"]["best_of_group"]) == ("1", "1")
    assert sort["told"]["group"] == "Privileged policies"
    assert {row["kind"] for row in rows} == {"task"}, "tasks that not all have are not added up"


def test_json_has_every_test(out: Path) -> None:
    document = json.loads((out / "comparison.json").read_text())
    names = [(key, facts["name"]) for key, facts in document["policies"].items()]
    assert names == [("A", "act_$1%"), ("B", "<b>&"), ("C", "told"), ("D", "π0.5 [paper]")]
    pairs = document["pairs"]
    assert [pair["a"] + pair["b"] for pair in pairs] == ["AB", "AC", "BC"]
    assert {test["test"] for pair in pairs for test in pair["tests"]} == {"McNemar, exact"}
    first = pairs[0]["tests"][0]
    assert (first["only_one_solved"], first["better"]) == ([12, 0], "a")
    assert first["p"] == pytest.approx(2 / 2**12, rel=1e-5)
    assert first["p_any_time"] == pytest.approx(any_time([(1, 0)] * 12), rel=1e-5)
    assert first["p_any_time_holm"] == pytest.approx(3 * first["p_any_time"], rel=1e-5)
    assert first["any_time_episodes"] == 12


def test_figures_name_every_task_and_run(out: Path) -> None:
    titles = {"Sort", "Lift &lt;It&gt;", "Turn"}
    names = {"act_$1%", "&lt;b&gt;&amp;", "told"}
    for figure, words in (("progress", titles | names), ("stages", titles)):
        svg = (out / f"figures/{figure}.svg").read_text()
        assert {word for word in words if word not in svg} == set()


def test_a_folder_of_something_else_is_left_alone(sources: list[str], out: Path) -> None:
    run = Path(sources[0])
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    with pytest.raises(OtherRunError, match="holds no comparison"):
        write_comparison(compare(sources), run)
    assert before == {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    write_comparison(compare(sources[:2]), out)
    write_comparison(compare(sources), out)
