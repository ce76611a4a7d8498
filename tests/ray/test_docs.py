"""The page on Ray: its command runs on a cluster, and its tables are in order."""

import shlex

import pytest

pytest.importorskip("ray", reason="Ray is not installed here: make test-ray")

from tests.docs.markdown import blocks, page_of
from tests.ray.test_cluster import duobench

PAGE = page_of("scale")
INSTEAD = {"lerobot:PATH": "hold", "100": "1", "16": "2", "1": "0"}


def test_the_command_runs(cluster, tmp_path):
    commands = blocks(PAGE, "shell")[0].splitlines()
    (command,) = [line for line in commands if line.startswith("duobench eval ")]
    words = [INSTEAD.get(word, word) for word in shlex.split(command)[2:]]
    words[words.index("HEAD:6379")] = cluster.address
    out = tmp_path / "mine"
    words[words.index("runs/mine")] = str(out)
    policy = words[words.index("--policy") + 1]
    rest = [word for word in words if word not in {"--policy", policy, "--out", str(out)}]
    duobench(out, policy, *rest, "--tasks", "bin_sort", "--videos", "0")
    assert len(list(out.glob("records/bin_sort/*/00000.json"))) == 1
