import pytest

from duobench.core.errors import UnknownNameError
from duobench.envs.config import EnvConfig
from duobench.envs.execution import ChunkExecution
from duobench.results.suite import SUITES, SuiteChoice, deviations, latency_text, suite_text
from duobench.tasks import catalog
from duobench.world.robot.cameras import Camera

FIXED = {("paper", 1): (100, 30), ("quick", 1): (10, 30), ("robust", 1): (20, 30)}
"""What each version of a suite fixes: a change needs a new version, and a new line here."""


def test_what_a_name_stands_for_does_not_change() -> None:
    named = SUITES.values()
    assert {(x.name, x.revision): (x.episodes, x.execution.execute) for x in named} == FIXED
    assert len(catalog.names()) == 11


@pytest.mark.parametrize("name", SUITES)
def test_suite_is_what_its_name_says(name: str) -> None:
    suite = SuiteChoice(suite=name).make()
    assert suite_text(suite) == suite.label == f"{name} {SUITES[name].revision}"
    assert [task.id for task in suite.tasks] == list(catalog.names())
    assert suite.execution == ChunkExecution(execute=30)
    assert deviations(suite) == []


def test_what_differs_from_the_name_is_said() -> None:
    choice = SuiteChoice(
        suite="paper", tasks=("bin_sort",), episodes=5, look="dark", first_episode=2
    )
    suite = choice.make(ChunkExecution(execute=10, latency=3))
    assert suite_text(suite) == (
        "paper 1 with 1 of 11 tasks, 5 episodes instead of 100, episodes from number 2, look dark, "
        "10 actions executed of a chunk instead of 30, latency of 3 control steps (100 ms)"
    )
    assert latency_text(suite) == "latency of 3 control steps (100 ms)"


def test_what_a_policy_sees_beyond_the_robots_images_is_never_the_papers() -> None:
    suite = SuiteChoice(suite="paper").make()
    side = Camera(name="side", position=(0.5, 1.2, 0.5), look_at=(0.5, 0.0, 0.0))
    config = EnvConfig(cameras=("head", side), depth=("left_wrist",), segmentation=("side",))
    words = "cameras of its own (side), depth (left_wrist), segmentation (side)"
    assert suite_text(suite, config) == f"paper 1 with {words}"
    assert deviations(suite, config) == [words]
    assert deviations(suite, EnvConfig(cameras=("head",))) == []


def test_another_renderer_is_played_when_it_is_named() -> None:
    usual = SuiteChoice(suite="robust").make()
    named = SuiteChoice(suite="robust", axes=("camera", "renderer"), levels=(2,)).make()
    assert "renderer" not in {shift.axis for shift in usual.shifts}
    assert [shift.name for shift in named.shifts] == ["none", "camera-2", "renderer-2"]
    assert deviations(usual) == []
    assert len(deviations(named)) == 1


def test_no_name_is_a_suite_of_ones_own() -> None:
    suite = SuiteChoice().make()
    assert (suite.label, suite.episodes, suite.execution) == ("custom", 20, ChunkExecution())
    assert deviations(suite) == []
    with pytest.raises(UnknownNameError, match=r"papr.*paper"):
        SuiteChoice(suite="papr").make()
