"""The names of the policies that read the simulator."""

import numpy as np
import pytest

from dev.benchmarks.steps import Steps
from duobench.core.errors import PolicyError, UnknownNameError
from duobench.evaluation.episode import EpisodeRunner, Job
from duobench.evaluation.policies import BlindPolicy, PolicyChoice, PolicySource, source
from duobench.evaluation.rollout import rollout
from duobench.policy import HoldPolicy
from duobench.results.suite import Episode, Suite, find_tasks
from tests.tasks.experts.baseline_episodes import make

TASKS = ("bin_sort", "carry_pot")


def test_an_expert_has_the_variety_of_its_name():
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
        ("blnd", r"policy 'blnd'\. Did you mean 'blind'"),
    ],
)
def test_a_misspelt_expert_is_refused(name, message):
    with pytest.raises(UnknownNameError, match=message):
        source(name)


def test_the_blind_baseline_tilts_a_board_and_holds_still_in_other_tasks():
    policy = source("blind", find_tasks(("ball_maze", "carry_pot")))
    assert policy.metadata.name == "blind"
    assert policy.metadata.cameras == ()
    assert policy.metadata.version.startswith("source ")
    stages, ways = {}, {}
    for task in ("ball_maze", "carry_pot"):
        env, steps = make(task), Steps()
        blind = policy.bind(env)
        assert isinstance(blind, BlindPolicy)
        rollout(env, blind, seed=0, watchers=[steps])
        stages[task] = steps[-1].info["stage"]
        ways[task] = np.ptp([step.action for step in steps], axis=0).max()
        env.close()
    assert stages["ball_maze"] >= 3
    assert ways["ball_maze"] > 0.1
    assert stages["carry_pot"] == 0
    assert ways["carry_pot"] < 1e-3


def test_an_environment_that_a_policy_cannot_be_bound_to_is_closed(monkeypatch):
    closed = []

    def bind(env):
        monkeypatch.setattr(type(env), "close", lambda _env: closed.append(True))
        raise PolicyError("It does not fit.")

    (task,) = find_tasks(TASKS[:1])
    job = Job(policy=PolicyChoice.parse("hold"), suite=Suite(tasks=(task,)))
    runner = EpisodeRunner(PolicySource(metadata=HoldPolicy.metadata, bind=bind), job)
    with pytest.raises(PolicyError, match="does not fit"):
        runner.play(Episode(task=task, index=0))
    assert closed == [True]
