"""The pages of a leaderboard: complete, closed in themselves, the same for the same bundles."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from duobench.errors import OtherRunError
from duobench.results.leaderboard.board import Board, Refused
from duobench.results.leaderboard.site import begin_site, write_site
from duobench.results.suite import find_tasks
from tests.results.leaderboard.boards import entry

BAD = Refused(file="<b>bad.duobench.zip", reason="It is <i>damaged</i>.")


def board() -> Board:
    few = entry("few", tasks=find_tasks(("bin_sort",)), episodes=3)
    entries = (entry("good", 0.9), entry("fair", 0.4), entry("expert", 1.0), few)
    return Board(entries=entries, refused=(BAD,))


def written(out: Path, shown: Board) -> dict[str, bytes]:
    begin_site(out)
    write_site(shown, out)
    return {str(path.relative_to(out)): path.read_bytes() for path in out.rglob("*.*")}


def test_same_bundles_give_the_same_bytes(tmp_path: Path) -> None:
    shown = board()
    files = written(tmp_path / "a", shown)
    again = written(tmp_path / "b", Board(entries=shown.entries[::-1], refused=shown.refused))
    assert files == again
    assert sorted(files)[:2] == ["index.html", "leaderboard.json"]
    assert len(files) == 2 + 4


def test_groups_stand_apart(tmp_path: Path) -> None:
    page = written(tmp_path, board())["index.html"].decode()
    places = [
        page.index(word)
        for word in (
            '<h2 id="policies">',
            ">good</a>",
            ">fair</a>",
            '<h2 id="privileged">',
            ">expert</a>",
            '<h2 id="partial">',
            ">few</a>",
            "1 of 11 tasks",
            '<h2 id="paper">',
            "Measured elsewhere, on other tasks",
            "X-VLA",
            '<h2 id="refused">',
            "&lt;b&gt;bad.duobench.zip",
            '<h2 id="submit">',
            "duobench bundle runs/mine",
        )
    ]
    assert places == sorted(places)
    assert "<b>bad" not in page
    assert "13 (0.33)" in page  # ACT, over all tasks


def test_each_policy_has_a_page_that_the_first_one_links(tmp_path: Path) -> None:
    files = written(tmp_path, board())
    links = set(re.findall(r'href="(policies/[^"]*)"', files["index.html"].decode()))
    assert links == {name for name in files if name.startswith("policies/")}
    page = files[board().entries[0].page].decode()
    assert "Place 1 of the policies" in page
    assert board().entries[0].digest in page
    assert "990 of 1100 episodes" in page
    expert = files[board().entries[2].page].decode()
    assert "Place 1 of the privileged policies" in expert


def test_pages_load_nothing(tmp_path: Path) -> None:
    for name, content in written(tmp_path, board()).items():
        text = content.decode()
        assert not re.search(r"<(script|link|img|iframe)|@import|url\((?!#)", text), name
        assert not re.search(r'(href|src)="(https?:)?//', text), name


def test_names_from_strangers_are_text(tmp_path: Path) -> None:
    one = entry("mine")
    one = replace(one, run=replace(one.run, policy="<script>alert(1)</script>", command="</pre>"))
    for name, content in written(tmp_path, Board(entries=(one,), refused=())).items():
        if name.endswith(".html"):
            assert b"<script" not in content
            assert b"&lt;script&gt;" in content


def test_document_has_the_numbers(tmp_path: Path) -> None:
    document = json.loads(written(tmp_path, board())["leaderboard.json"])
    assert [one["policy"] for one in document["ranked"]] == ["good", "fair"]
    assert document["ranked"][0]["overall"]["successes"] == 990
    assert document["ranked"][0]["categories"]["parallel execution"]["success_rate"] == 0.9
    assert [one["rank"] for one in document["ranked_privileged"]] == [1]
    assert document["not_ranked"][0]["because"] == [
        "1 of 11 tasks",
        "97 of 100 episodes of its tasks are missing",
    ]
    assert document["refused"] == [{"file": BAD.file, "reason": BAD.reason}]


def test_pages_of_bundles_that_are_gone_go(tmp_path: Path) -> None:
    shown = board()
    written(tmp_path, shown)
    files = written(tmp_path, Board(entries=shown.entries[:1], refused=()))
    assert [name for name in files if name.startswith("policies/")] == [shown.entries[0].page]


def test_without_a_complete_run_there_is_no_figure(tmp_path: Path) -> None:
    page = written(tmp_path, Board(entries=board().entries[3:], refused=()))["index.html"].decode()
    assert page.count("None has played the whole suite yet.") == 2
    assert 'id="stages"' not in page


def test_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(OtherRunError, match="holds no leaderboard"):
        begin_site(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
