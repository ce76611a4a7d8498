"""The page on writing a policy: its example is complete, and its command runs it."""

import json
from pathlib import Path
from typing import Any

import numpy as np

import duobench
from duobench.evaluation import Step, rollout
from duobench.policy import make
from duobench.results.folder import RunFolder
from tests.docs.markdown import DOCS, blocks, modules, run

PAGE = DOCS / "policies.md"


def test_the_example_plays_an_episode_as_printed(tmp_path: Path) -> None:
    for name, code in modules(PAGE).items():
        (tmp_path / name).write_text(code, encoding="utf-8")
    (line,) = blocks(PAGE, "sh")
    run(line, tmp_path)
    folder = RunFolder(tmp_path / "runs" / "vision")
    played = folder.read_run().candidate
    assert played.metadata.cameras == ("head", "left_wrist", "right_wrist")
    assert played.config.image_size == (64, 64)
    assert played.metadata.version is not None
    assert "source" not in played.metadata.version  # its own, not that of the module
    summary = json.loads(folder.summary.read_text(encoding="utf-8"))
    assert (summary["overall"]["episodes"], summary["overall"]["errors"]) == (1, 0)


class Steps(list[Step]):
    """Keeps all steps."""

    def on_episode_start(self, env: Any, observation: Any, info: Any) -> None:
        del env, observation, info

    def on_step(self, step: Step) -> None:
        self.append(step)

    def on_episode_end(self, error: BaseException | None) -> None:
        assert error is None


def test_the_loop_plays_what_a_rollout_plays() -> None:
    (loop,) = (block for block in blocks(PAGE, "python") if "policy_seed" in block)
    played: dict[str, Any] = {}
    exec(loop, played)
    env, steps = duobench.make("bin_sort", cameras=False), Steps()
    rollout(env, make("random"), seed=0, watchers=[steps])
    env.close()
    np.testing.assert_array_equal(np.float32(played["action"]), steps[-1].action)
