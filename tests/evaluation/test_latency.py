"""What is executed of a policy's chunks, and when."""

from typing import Any

import numpy as np
import pytest

import duobench
from duobench.envs import action_modes
from duobench.envs.execution import MAX_LATENCY, ChunkExecution
from duobench.errors import OptionError, OtherRunError
from duobench.evaluation.rollout import rollout
from duobench.policy import HoldPolicy
from duobench.replay.verify import Verdict, verify
from tests.evaluation import toy_tasks
from tests.evaluation.conftest import Play
from tests.evaluation.forging import redescribed, rewritten
from tests.evaluation.test_rollout import Listener


class Numbered(HoldPolicy):
    """Sends chunks whose actions say, in the right opening, which call they answer, and which they
    are: 0.21 is action 1 of call 2."""

    def __init__(self, length: int) -> None:
        super().__init__()
        self.length, self.calls = length, 0

    def act(self, observation: Any) -> Any:
        self.calls += 1
        chunk = np.repeat(super().act(observation), self.length, axis=0)
        chunk[:, -1] = [self.calls / 10 + number / 100 for number in range(self.length)]
        return chunk


def executed(length: int, execution: ChunkExecution) -> list[int]:
    env, listener = duobench.make(toy_tasks.WAVE, cameras=False), Listener()
    rollout(env, Numbered(length), seed=3, watchers=[listener], execution=execution)
    env.close()
    assert [step.number for step in listener.steps] == list(range(1, toy_tasks.HORIZON + 1))
    return [round(100 * float(step.action[-1])) for step in listener.steps]


def test_a_chunk_is_cut() -> None:
    assert executed(5, ChunkExecution(execute=3))[:7] == [10, 11, 12, 20, 21, 22, 30]
    assert executed(2, ChunkExecution(execute=3))[:5] == [10, 11, 20, 21, 30]


@pytest.mark.parametrize("latency", [1, 2, 3, 7])
@pytest.mark.parametrize("length", [1, 3])
def test_latency_delays_what_is_executed_and_nothing_else(length: int, latency: int) -> None:
    held = [100] * latency  # the grippers are open at home
    late = executed(length, ChunkExecution(latency=latency))
    assert late == [*held, *executed(length, ChunkExecution())][: toy_tasks.HORIZON]


def test_the_policy_is_asked_at_the_same_steps_and_sees_the_images() -> None:
    env = duobench.make(toy_tasks.WAVE, cameras=("head",), image_size=(24, 32))
    listener = Listener()
    execution = ChunkExecution(execute=4, latency=6)
    rollout(env, toy_tasks.Sees(), seed=3, watchers=[listener], execution=execution)
    env.close()
    seen = [step.number for step in listener.steps if "pixels" in step.observation]
    assert seen == [4, 8, 12, 16, 20, 24]


@pytest.mark.parametrize("mode", action_modes.ACTION_MODES)
def test_arms_hold_their_command_in_every_action_mode(mode: str) -> None:
    env = duobench.make(toy_tasks.WAVE, cameras=False, action_mode=mode)
    _, info = env.reset(seed=1)
    for _ in range(5):
        sent = env.step(env.get_wrapper_attr("hold_action")())[4]["sent"]
        np.testing.assert_allclose(sent, info["sent"], atol=1e-5)
    env.close()


@pytest.mark.parametrize("fields", [{"execute": 0}, {"latency": -1}, {"latency": MAX_LATENCY + 1}])
def test_impossible_execution_is_refused(fields: dict[str, int]) -> None:
    with pytest.raises(OptionError, match=f"got {next(iter(fields.values()))}"):
        ChunkExecution(**fields)


def test_scripted_policy_is_told_of_the_latency() -> None:
    class Told(HoldPolicy):
        def expect_latency(self, steps: int) -> None:
            self.latency = steps

    env, policy = duobench.make(toy_tasks.WAVE, cameras=False), Told()
    rollout(env, policy, seed=0, execution=ChunkExecution(latency=4))
    env.close()
    assert policy.latency == 4


def test_latency_and_cut_are_in_what_decides_a_result_and_are_verified(play: Play) -> None:
    execution = ChunkExecution(execute=3, latency=2)
    folder, results = play("random", episodes=1, execution=execution)
    (record, _) = (record for one in results.tasks for record in one.records)
    assert record.execution == folder.read_run().suite.execution == execution
    assert "latency of 2 control steps (67 ms)" in folder.page.read_text()
    for other, difference in (
        (ChunkExecution(execute=3), "latency 0 instead of 2"),
        (ChunkExecution(latency=2), "actions executed of a chunk all instead of 3"),
    ):
        with pytest.raises(OtherRunError, match=difference):
            play("random", episodes=1, execution=other)
    assert verify(folder, import_tasks=True).of(Verdict.EXACT)
    redescribed(folder, lambda run: run["suite"]["execution"].update(latency=9))
    for path in folder.path.glob("records/*/*/*.json"):
        rewritten(path, lambda record: record["execution"].update(latency=9))
    found = verify(folder, import_tasks=True).of(Verdict.CONTRADICTED)
    assert len(found) == 2
    assert "does not hold its command for a latency of 9 steps" in found[0].reason
