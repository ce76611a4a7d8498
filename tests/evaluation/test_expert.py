from pathlib import Path

from duobench.evaluation.folder import RunFolder
from duobench.evaluation.loop import rollout
from duobench.evaluation.policies import ExpertPolicy
from duobench.evaluation.runner import evaluate
from duobench.evaluation.suite import describe
from duobench.randomness import episode_seed
from tests.envs.tools import sim_of
from tests.evaluation.conftest import small_run
from tests.experts.lone import make

TASKS, EPISODES = ("bin_sort", "carry_pot"), 3


def lone_fingerprint(task: str, episode: int) -> str:
    """Of an episode that is the first of a new environment and of a new expert."""
    env = make(task)
    rollout(env, ExpertPolicy(env), seed=episode_seed(task, episode))
    fingerprint = sim_of(env).simulation.fingerprint()
    env.close()
    return fingerprint


def test_experts_score_the_same_with_one_worker_with_two_and_alone(tmp_path: Path) -> None:
    run = small_run("expert", tasks=describe(list(TASKS)), episodes=EPISODES)
    one, two = (
        evaluate(run, RunFolder(tmp_path / str(workers)), workers=workers) for workers in (1, 2)
    )
    assert one == two
    assert one.overall.episodes == len(TASKS) * EPISODES
    assert one.overall.errors == 0
    assert one.overall.successes > 0
    scored = {(r.task, r.episode): r.fingerprint for task in one.tasks for r in task.records}
    assert scored == {
        (task, episode): lone_fingerprint(task, episode)
        for task in TASKS
        for episode in range(EPISODES)
    }
    assert len(set(scored.values())) == len(scored)
