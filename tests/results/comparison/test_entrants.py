from pathlib import Path

import pytest

from duobench.errors import EvaluationError
from duobench.results.comparison.entrants import Group, read_entrants, split_name
from tests.results.comparison.runs import play

SOME = {"sort": [3, 1, 0]}


def test_groups_stand_apart_and_letters_follow_them(tmp_path: Path) -> None:
    told = play(tmp_path / "told", SOME, "told", object_state=True)
    sees = play(tmp_path / "sees", SOME, "sees")
    expert = play(tmp_path / "expert", SOME, "expert")
    entrants = read_entrants(["paper:ACT", told, sees, expert])
    assert [(one.key, one.name, one.group) for one in entrants] == [
        ("A", "sees", Group.UNPRIVILEGED),
        ("B", "told", Group.PRIVILEGED),
        ("C", "expert", Group.PRIVILEGED),
        ("D", "ACT [paper]", Group.ELSEWHERE),
    ]


def test_equal_names_get_their_letter_and_given_names_stay(tmp_path: Path) -> None:
    one, other = (play(tmp_path / name, SOME) for name in ("one", "other"))
    assert [e.name for e in read_entrants([one, other])] == ["mine (A)", "mine (B)"]
    assert [e.name for e in read_entrants([f"small={one}", other])] == ["small", "mine"]


def test_an_equals_sign_in_a_path_is_no_name(tmp_path: Path) -> None:
    folder = tmp_path / "lr=1"
    folder.mkdir()
    assert split_name(str(folder)) == ("", folder)
    assert split_name("a=b") == ("a", Path("b"))


@pytest.mark.parametrize(
    ("sources", "message"),
    [
        (["{run}"], "2 to 26 runs, got 1"),
        (["paper:ACT", "paper:xvla"], "needs a run"),
        (["{run}", "{empty}"], "no finished episode"),
    ],
)
def test_what_is_no_comparison_is_rejected(
    sources: list[str], message: str, tmp_path: Path
) -> None:
    run = play(tmp_path / "run", SOME)
    empty = play(tmp_path / "empty", {"sort": [0]})
    for record in Path(empty).glob("records/*/*.json"):
        record.unlink()
    with pytest.raises(EvaluationError, match=message):
        read_entrants([source.format(run=run, empty=empty) for source in sources])
