"""Who is ranked, in which order, and who is not."""

from dataclasses import replace

from duobench.envs.config import EnvConfig
from duobench.results.leaderboard.board import Board, Entry
from duobench.results.suite import find_tasks
from tests.results.leaderboard.boards import entry

TWO = find_tasks(("bin_sort", "carry_pot"))


def names(board: Board, *, privileged: bool = False) -> list[tuple[int, str]]:
    return [(one.rank, one.entry.name) for one in board.ranked(privileged=privileged)]


def board(*entries: Entry) -> Board:
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
    every = board(whole, few_tasks, few_episodes, unfinished, other, short, later)
    assert names(every) == [(1, "whole")]
    assert {one.name: one.lacks for one in every.partial} == {
        "few tasks": ("2 of 11 tasks",),
        "few episodes": ("11 of 1,100 episodes of its tasks are missing",),
        "unfinished": ("1 of 1,100 episodes of its tasks are missing",),
        "other layouts": ("split train instead of eval",),
        "short": ("horizon 10 instead of None",),
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
    strange = entry("mine")
    strange = replace(strange, run=replace(strange.run, policy="\u202e" + "x" * 10_000))
    assert strange.name.startswith("\\u202ex")
    assert len(strange.name) < 200
