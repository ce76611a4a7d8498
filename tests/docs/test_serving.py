"""What docs/serving.md shows works as it stands there."""

import ast
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from duobench import interop
from duobench.policy import Batching, BatchPolicy, SessionPolicy, make
from duobench.policy.serving.message_format import read_format
from tests.docs.markdown import DOCS, options, table, text_of

PAGE = text_of(DOCS / "serving.md")


def observation(value: int) -> dict:
    image = np.full((224, 224, 3), value, np.uint8)
    pixels = dict.fromkeys(("head", "left_wrist", "right_wrist"), image)
    return {"agent_pos": np.zeros(16, np.float32), "tcp_pose": np.zeros(14), "pixels": pixels}


@pytest.fixture
def shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The policy of the page, as a file of the user's."""
    (source,) = re.findall(r"```python\n(import numpy.*?)```", PAGE, re.DOTALL)
    (tmp_path / "my_vision.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    return "my_vision:MyVision"


def test_shown_policy_sees_and_draws(shown: str) -> None:
    policy = make(shown)
    assert isinstance(policy, SessionPolicy)
    assert isinstance(policy._policy, BatchPolicy)
    chunks = []
    for value, seed in ((0, 1), (200, 1), (0, 2), (0, 1)):
        policy.reset("Do it.", seed)
        chunks.append(np.asarray(policy.act(observation(value))))
    assert chunks[0].shape == (30, 16)
    assert not np.array_equal(chunks[0], chunks[1])
    assert not np.array_equal(chunks[0], chunks[2])
    np.testing.assert_array_equal(chunks[0], chunks[3])
    dynamic = SessionPolicy(policy._policy, Batching(mode="dynamic"))
    dynamic.reset("Do it.", 1)
    np.testing.assert_allclose(dynamic.act(observation(0)), chunks[0], atol=1e-6)


def test_shown_format_is_one(tmp_path: Path) -> None:
    (source,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    path = tmp_path / "shown.toml"
    path.write_text(source)
    message_format = read_format(str(path))
    assert message_format.metadata("", "", seeded=False).cameras == ("head", "left_wrist")


def test_table_of_parameters_names_those_of_the_benchmark() -> None:
    source = Path(next(iter(interop.__path__))) / "vla_eval.py"  # vla-eval need not be installed
    tree = ast.parse(source.read_text(encoding="utf-8"))
    (made,) = (
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and node.name == "__init__"
    )
    rows = table(DOCS / "serving.md", "parameter")
    assert [row["parameter"] for row in rows] == [word.arg for word in made.args.kwonlyargs]


def test_shown_commands_have_options_that_exist() -> None:
    lines = "".join(re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)).splitlines()
    assert len(lines) == 5
    for line in lines:
        _, verb, *words = shlex.split(line)
        assert {word[2:] for word in words if word.startswith("--")} <= options(verb)
