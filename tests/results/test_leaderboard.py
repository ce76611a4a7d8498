"""Who is ranked, in which order, and who is not; and the pages: complete, closed in themselves."""

import json
import re
from pathlib import Path

import pytest

from duobench.envs.config import EnvConfig
from duobench.errors import OtherRunError
from duobench.results.leaderboard import Board, BoardEntry, RefusedBundle, begin_site, write_site
from duobench.results.suite import find_tasks
from duobench.shifts.shift import NO_SHIFT, Shift
from tests.results.boards import entry

TWO = find_tasks(("bin_sort", "carry_pot"))


def names(board: Board, *, privileged: bool = False) -> list[tuple[int, str]]:
    return [(rank, entry.name) for rank, entry in board.ranked(privileged=privileged)]


def board(*entries: BoardEntry) -> Board:
    return Board(entries=entries, refused=())


def test_best_comes_first_and_equal_ones_share_a_place() -> None:
    every = board(entry("c", 0.2), entry("a", 0.5), entry("best", 0.9), entry("b", 0.5))
    ranks = names(every)
    assert [rank for rank, _ in ranks] == [1, 2, 2, 4]
    assert ranks[0] == (1, "best")
    assert ranks[-1] == (4, "c")
    assert ranks == names(Board(entries=every.entries[::-1], refused=()))


def test_privileged_ones_are_ranked_apart() -> None:
    states = entry("states", object_state=True)
    config = EnvConfig(cameras=(), object_state=True)
    silent = entry("silent", config=config)  # whose author does not say so
    every = board(states, entry("expert", 0.9), entry("mine", 0.1), silent)
    assert names(every) == [(1, "mine")]
    assert names(every, privileged=True)[0] == (1, "expert")
    assert {name for _, name in names(every, privileged=True)} == {"states", "silent", "expert"}


def test_what_is_not_the_whole_suite_is_not_ranked() -> None:
    whole = entry("whole")
    few_tasks = entry("few tasks", 1.0, tasks=TWO)
    few_episodes = entry("few episodes", 1.0, episodes=99)
    unfinished = entry("unfinished", 1.0, lost=1)
    other = entry("other layouts", 1.0, config=EnvConfig(cameras=(), split="train"))
    short = entry("short", 1.0, config=EnvConfig(horizon=10))
    later = entry("later", 1.0, first_episode=1)
    robust = entry("robust", 1.0, shifts=(NO_SHIFT, Shift(axis="look", level=1)))
    every = board(whole, few_tasks, few_episodes, unfinished, other, short, later, robust)
    assert names(every) == [(1, "whole")]
    assert {one.name: one.lacks for one in every.partial} == {
        "few tasks": ("2 of 11 tasks",),
        "few episodes": ("11 of 1,100 episodes of its tasks are missing",),
        "unfinished": ("1 of 1,100 episodes of its tasks are missing",),
        "other layouts": ("split train instead of eval",),
        "short": ("horizon 10 instead of None",),
        "robust": ("2 conditions, not that without a shift alone",),
        "later": ("11 of 1,100 episodes of its tasks are missing",),
    }


def test_how_a_policy_sees_and_acts_is_its_own_affair() -> None:
    config = EnvConfig(cameras=("head",), image_size=(96, 96), action_mode="cartesian", chunk=8)
    assert entry("mine", config=config).lacks == ()


def test_episodes_beyond_the_suite_count_for_nothing() -> None:
    # 110 of 200 episodes of each task are successes, the first ones: all that count.
    more = entry("more", 0.55, episodes=200)
    assert more.lacks == ()
    assert (more.results.overall.episodes, more.results.overall.successes) == (1100, 1100)


def test_what_cannot_be_verified_reaches_no_stage() -> None:
    pot = find_tasks(("carry_pot",))[0]
    before = entry("mine", 1.0, tasks=(pot,), episodes=2)
    after = entry("mine", 1.0, tasks=(pot,), episodes=2, unverifiable=[("carry_pot", 1)])
    assert before.results.overall.mean_final_progress == 1.0
    assert after.results.overall.mean_final_progress == 0.5
    assert after.results.overall.episodes == 2


def test_order_of_tasks_in_the_run_does_not_matter() -> None:
    tasks = find_tasks(())
    ordered, reverse = entry("mine", tasks=tasks), entry("mine", tasks=tasks[::-1])
    assert reverse.results == ordered.results


def test_names_from_strangers_are_short_and_turn_no_text() -> None:
    strange = entry("\u202e" + "x" * 10_000, episodes=1)
    assert strange.name.startswith("\\u202ex")
    assert len(strange.name) < 200


BAD = RefusedBundle(file="<b>bad.duobench.zip", reason="It is <i>damaged</i>.")


def some_board() -> Board:
    few = entry("few", tasks=find_tasks(("bin_sort",)), episodes=3)
    entries = (entry("good", 0.9), entry("fair", 0.4), entry("expert", 1.0), few)
    return Board(entries=entries, refused=(BAD,))


def written(out: Path, shown: Board) -> dict[str, bytes]:
    begin_site(out)
    write_site(shown, out)
    return {str(path.relative_to(out)): path.read_bytes() for path in out.rglob("*.*")}


def test_same_bundles_give_the_same_bytes(tmp_path: Path) -> None:
    shown = some_board()
    files = written(tmp_path / "a", shown)
    again = written(tmp_path / "b", Board(entries=shown.entries[::-1], refused=shown.refused))
    assert files == again
    assert sorted(files)[:2] == ["index.html", "leaderboard.json"]
    assert len(files) == 2 + 4


def test_groups_stand_apart(tmp_path: Path) -> None:
    page = written(tmp_path, some_board())["index.html"].decode()
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
    files = written(tmp_path, some_board())
    links = set(re.findall(r'href="(policies/[^"]*)"', files["index.html"].decode()))
    assert links == {name for name in files if name.startswith("policies/")}
    page = files[some_board().entries[0].page].decode()
    assert "Place 1 of the policies" in page
    assert some_board().entries[0].digest in page
    assert "990 of 1100 episodes" in page
    expert = files[some_board().entries[2].page].decode()
    assert "Place 1 of the privileged policies" in expert


def test_pages_load_nothing(tmp_path: Path) -> None:
    for name, content in written(tmp_path, some_board()).items():
        text = content.decode()
        assert not re.search(r"<(script|link|img|iframe)|@import|url\((?!#)", text), name
        assert not re.search(r'(href|src)="(https?:)?//', text), name


def test_names_from_strangers_are_text(tmp_path: Path) -> None:
    one = entry("<script>alert(1)</script>", episodes=1, commands=["</pre>"])
    for name, content in written(tmp_path, Board(entries=(one,), refused=())).items():
        if name.endswith(".html"):
            assert b"<script" not in content
            assert b"&lt;script&gt;" in content


def test_document_has_the_numbers(tmp_path: Path) -> None:
    document = json.loads(written(tmp_path, some_board())["leaderboard.json"])
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
    shown = some_board()
    written(tmp_path, shown)
    files = written(tmp_path, Board(entries=shown.entries[:1], refused=()))
    assert [name for name in files if name.startswith("policies/")] == [shown.entries[0].page]


def test_without_a_complete_run_there_is_no_figure(tmp_path: Path) -> None:
    page = written(tmp_path, Board(entries=some_board().entries[3:], refused=()))[
        "index.html"
    ].decode()
    assert page.count("None has played the whole suite yet.") == 2
    assert 'id="stages"' not in page


def test_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(OtherRunError, match="holds no leaderboard"):
        begin_site(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
