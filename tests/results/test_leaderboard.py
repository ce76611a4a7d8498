"""Who is ranked, in which order, and who is not; and the pages: complete, closed in themselves."""

import html
import json
import re
from datetime import date
from pathlib import Path
from typing import Any

import pytest

from duobench.core.errors import OtherRunError
from duobench.envs.config import EnvConfig
from duobench.results.leaderboard import Board, BoardEntry, RefusedBundle, begin_site, write_site
from duobench.results.salt import Round, Salt
from duobench.results.suite import find_tasks
from duobench.tasks.shifts.shift import NO_SHIFT, Shift
from tests.results.boards import entry
from tests.results.samples import VERSIONS

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
    privileged = names(every, privileged=True)
    assert privileged[0] == (1, "expert")
    assert {name for _, name in privileged} == {"states", "silent", "expert"}


@pytest.mark.parametrize(
    ("changes", "lacks"),
    [
        ({}, ()),
        ({"tasks": TWO}, ("2 of 11 tasks",)),
        ({"episodes": 99}, ("11 of 1,100 episodes of its tasks are missing",)),
        ({"lost": 1}, ("1 of 1,100 episodes of its tasks are missing",)),
        ({"config": EnvConfig(cameras=(), split="train")}, ("split train instead of eval",)),
        ({"config": EnvConfig(horizon=10)}, ("horizon 10 instead of None",)),
        ({"first_episode": 1}, ("11 of 1,100 episodes of its tasks are missing",)),
        (
            {"shifts": (NO_SHIFT, Shift(axis="look", level=1))},
            ("2 conditions, not that without a shift alone",),
        ),
        ({"versions": {**VERSIONS, "mujoco": "4.1.2"}}, ("MuJoCo 4.1.2 instead of 4.0",)),
        ({"versions": {**VERSIONS, "mujoco": "4.0.9"}}, ()),
        ({"versions": {}}, ("MuJoCo an unknown version instead of 4.0",)),
        # How a policy sees and acts is its own affair.
        (
            {
                "config": EnvConfig(
                    cameras=("head",), image_size=(96, 96), action_mode="cartesian", chunk=8
                )
            },
            (),
        ),
    ],
)
def test_what_is_not_the_whole_suite_is_not_ranked(
    changes: dict[str, Any], lacks: tuple[str, ...]
) -> None:
    one = entry("one", 1.0, **changes)
    assert one.lacks == lacks
    ranked, partial = (names(board(one)), board(one).partial)
    assert (ranked, partial) == (([], [one]) if lacks else ([(1, "one")], []))


def test_episodes_that_were_begun_again_are_told_with_the_worst_case(tmp_path: Path) -> None:
    one = entry("one", 0.5, repeated=40)
    said = (
        "40 of 1100 episodes were begun more than once: the policy's process ended by itself, or "
        "the connection to it was lost (40)."
    )
    assert (
        one.repeats
        == f"{said} Counted as failures, they would make success 46.4 % instead of 50.0 %."
    )
    begin_site(tmp_path)
    page = write_site(Board(entries=(one,), refused=()), tmp_path).read_text()
    assert "50.0†" in page
    assert "worst case 46.4" in page
    assert said in html.unescape((tmp_path / one.page).read_text())
    few = entry("few", 0.5, repeated=10)
    assert (few.repeats[:10], few.results.overall.is_marked) == ("10 of 1100", False)
    unknown = entry("unknown", noted=1000)
    assert unknown.lacks == ("of 100 episodes no attempt is on record",)


def test_episodes_beyond_the_suite_count_for_nothing() -> None:
    # 110 of 200 episodes of each task are successes, the first ones: all that count.
    more = entry("more", 0.55, episodes=200)
    overall = more.results.overall
    assert (more.lacks, overall.episodes, overall.successes) == ((), 1100, 1100)


def test_what_cannot_be_verified_reaches_no_stage() -> None:
    pot = find_tasks(("carry_pot",))
    before = entry("mine", 1.0, tasks=pot, episodes=2).results.overall
    after = entry("mine", 1.0, tasks=pot, episodes=2, unverifiable=[("carry_pot", 1)])
    assert (before.mean_final_progress, after.results.overall.mean_final_progress) == (1.0, 0.5)
    assert after.results.overall.episodes == 2


def test_order_of_tasks_in_the_run_does_not_matter() -> None:
    tasks = find_tasks(())
    ordered, reverse = entry("mine", tasks=tasks), entry("mine", tasks=tasks[::-1])
    assert reverse.results == ordered.results


# --- hosted rounds -------------------------------------------------------------------------------

SALT = Salt("ab" * 32)
SALTED_RUN: dict[str, Any] = {
    "config": EnvConfig(cameras=(), split="salted"),
    "salt": SALT.sha256,
}
SPRING = Round(name="spring", date=date(2026, 3, 1), salt_sha256="d" * 64)
AUTUMN = Round(
    name="<autumn>",
    date=date(2026, 9, 1),
    salt_sha256=SALT.sha256,
    bundles=("e" * 64,),
    salt=SALT.digits,
)


def hosted(name: str, share: float, one: Round = AUTUMN, **changes: Any) -> BoardEntry:
    return entry(name, share, hosted=one, **SALTED_RUN | changes)


def test_hosted_entries_are_ranked_in_their_round_and_above_the_self_reported() -> None:
    known = entry("expert", 1.0, hosted=AUTUMN, **SALTED_RUN)
    entries = (
        entry("public", 0.9),
        hosted("worse", 0.1),
        hosted("better", 0.2),
        known,
        hosted("few", 0.5, tasks=TWO),
        hosted("other", 1.0, SPRING),
    )
    whole = Board(entries=entries, refused=(), rounds=(SPRING, AUTUMN))
    assert [(title, [(n, e.name) for n, e in ranked]) for title, _, _, ranked in whole.groups] == [
        ("Hosted, <autumn>", [(1, "better"), (2, "worse")]),
        ("Hosted, <autumn>, privileged", [(1, "expert")]),
        ("Hosted, spring", [(1, "other")]),
        ("Hosted, spring, privileged", []),
        ("Self-reported", [(1, "public")]),
        ("Self-reported, privileged", []),
    ]
    assert [(one.name, one.lacks) for one in whole.partial] == [("few", ("2 of 11 tasks",))]


def test_a_salt_of_ones_own_is_not_ranked() -> None:
    lacks = entry("mine", 1.0, **SALTED_RUN).lacks
    assert lacks == (
        "split salted instead of eval",
        "self-reported: whoever played it may have chosen its salt",
    )


def test_pages_say_what_a_round_shows(tmp_path: Path) -> None:
    entries = (entry("public", 0.9), hosted("better", 0.2), hosted("other", 1.0, SPRING))
    rounds = (SPRING, AUTUMN)
    pages = written(tmp_path, Board(entries=entries, refused=(), rounds=rounds))
    front = " ".join(pages["index.html"].split())
    words = (
        '<h2 id="round-1">Hosted, &lt;autumn&gt;</h2>',
        "published on 2026-09-01",
        SALT.sha256,
        f'The salt is <span class="mono digest">{SALT.digits}',
        "all seeds follow from it",
        "Refused or not there, though played",
        "e" * 64,
        ">better</a>",
        '<h2 id="round-2">Hosted, spring</h2>',
        "d" * 64,
        "The salt is not published yet",
        ">other</a>",
        '<h2 id="policies">Self-reported</h2>',
        "a table of its episodes",
        ">public</a>",
        '<h2 id="privileged">Self-reported, privileged</h2>',
        "<figcaption>Hosted, &lt;autumn&gt;: <b>1</b> better",
    )
    places = [front.index(word) for word in words]
    assert places == sorted(places)
    assert "Place 1 of the policies hosted in &lt;autumn&gt;" in pages[entries[1].page]
    assert "not published yet" not in pages[entries[1].page]
    assert "hosted in spring, whose salt is not published yet" in pages[entries[2].page]
    document = json.loads(pages["leaderboard.json"])
    assert [(one["round"], one["policy"]) for one in document["hosted"]] == [
        ("<autumn>", "better"),
        ("spring", "other"),
    ]
    assert [one["policy"] for one in document["ranked"]] == ["public"]
    assert document["rounds"][1]["salt"] == SALT.digits


BAD = RefusedBundle(file="<b>bad.duobench.zip", reason="It is <i>damaged</i>.")


@pytest.fixture(scope="module")
def shown() -> Board:
    few = entry("few", tasks=find_tasks(("bin_sort",)), episodes=3)
    entries = (entry("good", 0.9), entry("fair", 0.4), entry("expert", 1.0), few)
    return Board(entries=entries, refused=(BAD,))


def written(out: Path, shown: Board) -> dict[str, str]:
    begin_site(out)
    write_site(shown, out)
    return {str(path.relative_to(out)): path.read_text() for path in out.rglob("*.*")}


@pytest.fixture(scope="module")
def site(shown: Board, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return written(tmp_path_factory.mktemp("site"), shown)


def test_same_bundles_give_the_same_bytes(
    shown: Board, site: dict[str, str], tmp_path: Path
) -> None:
    again = Board(entries=shown.entries[::-1], refused=shown.refused)
    assert written(tmp_path, again) == site
    assert sorted(site)[:2] == ["index.html", "leaderboard.json"]
    assert len(site) == 2 + 4


def test_groups_stand_apart(site: dict[str, str]) -> None:
    page = site["index.html"]
    words = (
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
    places = [page.index(word) for word in words]
    assert places == sorted(places)
    assert "<b>bad" not in page
    assert "13 (0.33)" in page  # ACT, over all tasks


def test_each_policy_has_a_page_that_the_first_one_links(
    shown: Board, site: dict[str, str]
) -> None:
    links = set(re.findall(r'href="(policies/[^"]*)"', site["index.html"]))
    assert links == {name for name in site if name.startswith("policies/")}
    good, _, expert, _ = shown.entries
    for words in ("Place 1 of the policies", good.digest, "990 of 1100 episodes"):
        assert words in site[good.page]
    assert "Place 1 of the privileged policies" in site[expert.page]


def test_pages_load_nothing(site: dict[str, str]) -> None:
    for name, text in site.items():
        assert not re.search(r"<(script |link|img|iframe)|@import|url\((?!#)", text), name
        assert not re.search(r'(href|src)="(https?:)?//', text), name


def test_names_from_strangers_are_short_and_no_markup(tmp_path: Path) -> None:
    strange = entry("\u202e" + "x" * 10_000, episodes=1)
    assert strange.name.startswith("\\u202ex")
    assert len(strange.name) < 200
    one = entry("<script>alert(1)</script>", episodes=1, commands=["</pre>"])
    pages = written(tmp_path, board(one))
    for name in ("index.html", one.page):
        assert "<script>alert" not in pages[name]
        assert "&lt;script&gt;" in pages[name]


def test_document_has_the_numbers(site: dict[str, str]) -> None:
    document = json.loads(site["leaderboard.json"])
    assert [one["policy"] for one in document["ranked"]] == ["good", "fair"]
    assert document["ranked"][0]["overall"]["successes"] == 990
    assert document["ranked"][0]["categories"]["parallel execution"]["success_rate"] == 0.9
    assert [one["rank"] for one in document["ranked_privileged"]] == [1]
    assert document["not_ranked"][0]["because"] == [
        "1 of 11 tasks",
        "97 of 100 episodes of its tasks are missing",
    ]
    assert document["refused"] == [{"file": BAD.file, "reason": BAD.reason}]


def test_pages_of_bundles_that_are_gone_go(shown: Board, tmp_path: Path) -> None:
    written(tmp_path, shown)
    files = written(tmp_path, board(shown.entries[0]))
    assert [name for name in files if name.startswith("policies/")] == [shown.entries[0].page]


def test_without_a_complete_run_there_is_no_figure(shown: Board, tmp_path: Path) -> None:
    page = written(tmp_path, board(shown.entries[3]))["index.html"]
    assert page.count("None has played the whole suite yet.") == 2
    assert 'id="stages"' not in page


def test_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(OtherRunError, match="holds no leaderboard"):
        begin_site(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
