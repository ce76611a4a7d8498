"""What is decided before Ray is needed, and without it."""

import os
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import msgspec
import pytest

from duobench.cli import main
from duobench.cli.shared.options import command_line
from duobench.core.errors import EvaluationError
from duobench.core.versions import __version__
from duobench.evaluation.runners import ray_cluster as cluster, ray_process as host
from duobench.evaluation.runners.evaluations import evaluate
from duobench.evaluation.runners.ray_cluster import check_environment
from duobench.evaluation.runners.ray_process import AUTH_MODE, Cluster
from duobench.evaluation.runners.worker import EpisodeProgress, Rehearsed
from duobench.results.folder import RunFolder
from duobench.results.records import FirstAnswer
from duobench.world.sim import opengl
from tests.evaluation.conftest import small_suite


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ray as if it were there; nothing here loads it."""
    monkeypatch.setattr(cluster.importlib.util, "find_spec", lambda _name: object())


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        *(({"address": text}, "HOST:PORT of its head") for text in ("ray://a:10001", "", " ")),
        *(({"policy_gpus": number}, "0 or more") for number in (-1.0, float("nan"), float("inf"))),
    ],
)
def test_clusters_that_are_none_are_rejected(fields, message):
    with pytest.raises(EvaluationError, match=message):
        Cluster(**fields)


@pytest.mark.parametrize("mode", [None, "", "disabled", "token"])
@pytest.mark.usefixtures("installed")
def test_a_cluster_without_token_is_refused(mode, monkeypatch):
    monkeypatch.delenv(AUTH_MODE, raising=False)
    if mode is not None:
        monkeypatch.setenv(AUTH_MODE, mode)
    with nullcontext() if mode == "token" else pytest.raises(EvaluationError, match="MODE=token"):
        check_environment()


def test_missing_ray_names_the_extra(monkeypatch, tmp_path):
    monkeypatch.setattr(cluster.importlib.util, "find_spec", lambda _name: None)
    with pytest.raises(EvaluationError, match=r"pip install '\.\[ray\]'"):
        evaluate("hold", small_suite(), RunFolder(tmp_path / "run"), cluster=Cluster())
    assert not (tmp_path / "run").exists()


def test_nothing_loads_ray_that_does_not_need_it():
    runners = "duobench.evaluation.runners"
    modules = f"duobench.cli.eval, {runners}.evaluations, {runners}.ray_cluster"
    code = f"import sys, {modules}; sys.exit('ray' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.usefixtures("installed")
def test_a_cluster_has_workers(monkeypatch, tmp_path):
    monkeypatch.setenv(AUTH_MODE, "token")
    folder = RunFolder(tmp_path / "run")
    with pytest.raises(EvaluationError, match="at least one worker"):
        evaluate("hold", small_suite(), folder, workers=0, cluster=Cluster())


@pytest.mark.parametrize("option", [["--address", "10.0.0.1:6379"], ["--policy-gpus", "1"]])
def test_options_of_the_cluster_are_for_ray(tmp_path, option):
    words = ["--policy", "hold", "--tasks", "bin_sort", "--out", str(tmp_path / "run")]
    with pytest.raises(SystemExit, match="are for --executor ray"):
        main(["eval", *words, *option])


def test_where_a_run_was_played_is_no_part_of_it():
    def verb(policy: str, executor: str = "processes", address: str = "auto") -> None:
        del policy, executor, address

    given = {"policy": "hold", "executor": "ray", "address": "10.0.0.1:6379"}
    assert command_line("eval", verb, given) == "duobench eval --policy hold"


def test_nodes_without_token_or_of_another_version_play_nothing(monkeypatch):
    monkeypatch.delenv(AUTH_MODE, raising=False)
    assert "everyone who reaches it" in host._objection(__version__)
    monkeypatch.setenv(AUTH_MODE, "token")
    assert host._objection(__version__) == ""
    assert "Install the same everywhere" in host._objection("0.1")


@pytest.fixture
def chosen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[int]:
    """A temporary folder of its own, and what was chosen in it."""
    calls: list[int] = []
    monkeypatch.setattr(host.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(opengl, "choose", lambda processes: calls.append(processes) or "osmesa")
    monkeypatch.setenv(opengl.CHOSEN, "")
    return calls


def test_only_how_far_an_episode_is_waits_for_other_messages():
    tag = EpisodeProgress.__struct_config__.tag
    assert host._may_wait(msgspec.json.encode({"type": tag, "record": {}}))
    assert msgspec.json.encode(Rehearsed(FirstAnswer(question="q", answer="a"))).startswith(
        b'{"type":"'
    )  # the tag comes first
    assert not host._may_wait(msgspec.json.encode(Rehearsed(FirstAnswer(question="q", answer="a"))))


def test_rendering_is_chosen_once_a_node(chosen):
    assert [host.choose_once("a", 4) for _ in range(3)] == ["osmesa"] * 3
    assert chosen == [4]
    assert os.environ[opengl.CHOSEN] == "osmesa"
    host.choose_once("b", 2)
    assert chosen == [4, 2]


def test_a_choice_that_is_none_is_made_anew(chosen, tmp_path):
    host.choose_once("a", 4)
    (file,) = tmp_path.glob("duobench-*/*")
    file.write_text("nonsense that is longer than any name")
    host.choose_once("a", 4)
    assert chosen == [4, 4]
    assert file.read_text() == "osmesa"


def test_choices_of_somebody_else_are_not_taken(chosen, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (tmp_path / f"duobench-{os.getuid()}").symlink_to(elsewhere)
    with pytest.raises(PermissionError, match="belongs to another user"):
        host.choose_once("a", 4)
    assert chosen == []
