"""The names of the scripted experts."""

import pytest

from duobench.errors import UnknownNameError
from duobench.evaluation.policies import source
from duobench.evaluation.suite import find_tasks
from tests.experts.baseline_episodes import make

TASKS = ("bin_sort", "carry_pot")


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
