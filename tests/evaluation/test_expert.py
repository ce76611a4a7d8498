from pathlib import Path

import pytest

from duobench.errors import UnknownNameError
from duobench.evaluation.evaluate import evaluate
from duobench.evaluation.folder import RunFolder
from duobench.evaluation.policies import ExpertPolicy, source
from duobench.evaluation.rollout import rollout
from duobench.evaluation.suite import find_tasks
from duobench.randomness import episode_seed
from tests.evaluation.conftest import small_suite
from tests.experts.baseline_episodes import make

TASKS, EPISODES = ("bin_sort", "carry_pot"), 3


def lone_state_hash(task: str, episode: int) -> str:
    """Of an episode that is the first of a new environment and of a new expert."""
    env = make(task)
    rollout(env, ExpertPolicy(env), seed=episode_seed(task, episode))
    state_hash = env.get_wrapper_attr("state_hash")()
    env.close()
    return state_hash


def test_experts_score_the_same_here_with_two_workers_and_alone(tmp_path: Path) -> None:
    suite = small_suite(tasks=find_tasks(TASKS), episodes=EPISODES)
    one, two = (
        evaluate("expert", suite, RunFolder(tmp_path / str(workers)), workers=workers)
        for workers in (0, 2)
    )
    assert one == two
    assert one.overall.episodes == len(TASKS) * EPISODES
    assert one.overall.errors == 0
    assert one.overall.successes > 0
    scored = {(r.task, r.episode): r.state_hash for task in one.tasks for r in task.records}
    assert scored == {
        (task, episode): lone_state_hash(task, episode)
        for task in TASKS
        for episode in range(EPISODES)
    }
    assert len(set(scored.values())) == len(scored)


def test_an_expert_has_the_variety_of_its_name() -> None:
    tasks = find_tasks(TASKS)
    plain, none, human = (source(f"expert{name}", tasks) for name in ("", ":none", ":human"))
    assert plain.metadata == none.metadata
    assert (plain.metadata.name, human.metadata.name) == ("expert", "expert:human")
    assert human.metadata.version != plain.metadata.version
    env = make(TASKS[0])
    assert human.bind(env).metadata.name == "expert:human"
    env.close()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("expert:humn", r"variety 'humn'\. Did you mean 'human'"),
        ("expert:", r"variety ''.*Known: human, none, wide"),
        ("exprt", r"policy 'exprt'\. Did you mean 'expert'"),
    ],
)
def test_a_misspelt_expert_is_refused(name: str, message: str) -> None:
    with pytest.raises(UnknownNameError, match=message):
        source(name)
