"""Runs on a cluster of two nodes give the bytes of runs without one, whatever is lost meanwhile.

Runs in an environment with Ray, which `make test-ray` makes.
"""

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections import Counter
from pathlib import Path

import pytest

pytest.importorskip("ray", reason="Ray is not installed here: make test-ray")

from dev.benchmarks.kills import contents
from dev.benchmarks.ray_cluster import LocalCluster
from dev.benchmarks.ray_kills import ROOT, disturb, start
from tests.evaluation import toy_tasks
from tests.evaluation.processes import is_running, wait_until

SEARCHES = "tests.evaluation.toy_batches:Searches"
WANDERS = "dev.benchmarks.kills:Wanders"
TIMEOUT_S = 900


def duobench(out: Path, policy: str, *words: str, status: int = 0, **environment: str) -> str:
    """What an evaluation prints."""
    command = [sys.executable, "-m", "duobench", "eval", "--policy", policy, "--out", str(out)]
    folders = os.pathsep.join([str(ROOT / "src"), str(ROOT)])
    result = subprocess.run(
        [*command, *words],
        env={**os.environ, "PYTHONPATH": folders, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert result.returncode == status, result.stdout
    return result.stdout


def on(cluster: LocalCluster) -> tuple[str, ...]:
    return ("--executor", "ray", "--address", cluster.address)


@pytest.mark.parametrize("policy", ["expert", "random", WANDERS])
def test_bytes_are_those_of_one_process_and_of_two_workers(policy, cluster, tmp_path):
    words = ("--tasks", "carry_pot", "bin_sort", "--episodes", "2", "--videos", "0")
    duobench(tmp_path / "one", policy, *words, "--workers", "0")
    duobench(tmp_path / "two", policy, *words, "--workers", "2")
    duobench(tmp_path / "ray", policy, *words, "--workers", "3", *on(cluster))
    one, two, there = (contents(tmp_path / name) for name in ("one", "two", "ray"))
    assert one == two == there
    assert len(there) == 3 + 4
    wait_until(lambda: not cluster.processes(), "the end of all actors")


def test_policy_finds_no_simulator_in_its_process(cluster, tmp_path):
    words = ("--tasks", toy_tasks.WAVE_NAME, "--episodes", "2", "--videos", "0")
    said = duobench(tmp_path / "run", SEARCHES, *words, "--workers", "2", *on(cluster))
    assert "failed with an error" not in said


def test_images_and_videos_come_from_the_nodes(cluster, tmp_path):
    words = ("--tasks", toy_tasks.NUDGE_NAME, "--episodes", "2", "--videos", "2")
    for name, where in (("here", ()), ("ray", on(cluster))):
        duobench(tmp_path / name, "random", *words, "--workers", "2", *where)
    assert contents(tmp_path / "here") == contents(tmp_path / "ray")
    videos = sorted((tmp_path / "ray" / "videos").rglob("*.webm"))
    assert len(videos) == 2
    assert all(video.stat().st_size > 1000 for video in videos)


def test_results_are_the_same_after_kills(cluster, tmp_path):
    counts = sum((counts for _, counts in disturb(tmp_path, cluster, 6, 1)), Counter[str]())
    assert counts.total() == 6
    assert len(counts) > 1


def test_killed_driver_leaves_nothing_behind_and_goes_on(cluster, tmp_path):
    out = tmp_path / "run"
    process = start("random", out, cluster.address)
    wait_until(lambda: list(out.glob("records/*/*/*.json")), "a record")
    playing = [pid for pids in cluster.processes().values() for pid in pids]
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert playing
    wait_until(lambda: not any(map(is_running, playing)), "the end of what it has started")
    kept = {path: path.stat().st_mtime_ns for path in out.glob("records/*/*/*.json")}
    assert start("random", out, cluster.address).wait(TIMEOUT_S) == 0
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert len(list(out.glob("records/*/*/*.json"))) == 6


def test_interrupted_driver_ends_its_actors(cluster, tmp_path):
    out = tmp_path / "run"
    process = start("random", out, cluster.address)
    wait_until(lambda: list(out.glob("records/*/*/*.json")), "a record")
    process.send_signal(signal.SIGINT)
    assert process.wait(TIMEOUT_S) != 0
    wait_until(lambda: not cluster.processes(), "the end of all actors")
    kept = out.glob("records/*/*/*.json")
    assert all(record.read_text().endswith("}\n") for record in kept)


def test_policy_that_hangs_fails_its_episode_alone(cluster, tmp_path):
    words = ("--tasks", toy_tasks.WAVE_NAME, "--episodes", "2", "--videos", "0")
    policy = "tests.evaluation.toy_batches:Hangs"
    limit = ("--act-timeout", "4", "--workers", "2")
    said = duobench(tmp_path / "run", policy, *words, *limit, *on(cluster), status=1)
    assert "1 episode failed with an error" in said
    (record,) = tmp_path.glob("run/records/wave/*/00000.json")
    assert "did not answer within 4 s" in record.read_text()


@pytest.mark.long
def test_episode_in_which_the_policy_always_dies_fails_alone(cluster, tmp_path):
    tasks = ("--tasks", toy_tasks.WAVE_NAME, toy_tasks.NOD_NAME)
    words = (*tasks, "--episodes", "1", "--videos", "0", "--workers", "2")
    policy = "tests.evaluation.toy_batches:DiesInOne"
    duobench(tmp_path / "run", policy, *words, *on(cluster), status=1)
    (record,) = tmp_path.glob("run/records/nod/*/00000.json")
    assert "In 2 attempts the policy's process ended by itself" in record.read_text()


def test_node_with_another_source_under_the_same_version_is_refused(cluster, tmp_path, monkeypatch):
    package = tmp_path / "duobench"
    shutil.copytree(ROOT / "src" / "duobench", package)
    with (package / "world" / "sim" / "simulation.py").open("a") as file:
        file.write("# another checkout\n")
    with monkeypatch.context() as there:
        there.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), str(ROOT)]))
        cluster.add_node()
    try:
        words = ("--tasks", "bin_sort", "--episodes", "8", "--videos", "0", "--workers", "6")
        said = duobench(tmp_path / "run", "random", *words, *on(cluster), status=1)
    finally:
        cluster.kill_node()
    assert "one of them has source of world/sim" in said


def test_policies_alone_are_given_the_graphics_card(cluster, tmp_path):
    words = ("--tasks", toy_tasks.WAVE_NAME, "--episodes", "2", "--videos", "0")
    card = ("--policy-gpus", "0.5", "--workers", "2")
    said = duobench(tmp_path / "run", "tests.ray.policies:NeedsCard", *words, *card, *on(cluster))
    assert "failed with an error" not in said


def test_graphics_card_that_no_node_has_is_said(cluster, tmp_path):
    words = ("--tasks", "bin_sort", "--episodes", "1", "--videos", "0", "--policy-gpus", "2")
    out = tmp_path / "run"
    folders = os.pathsep.join([str(ROOT / "src"), str(ROOT)])
    with subprocess.Popen(
        [
            sys.executable,
            "-m",
            "duobench",
            "eval",
            "--policy",
            "random",
            "--out",
            str(out),
            *words,
            *on(cluster),
        ],
        env={**os.environ, "PYTHONPATH": folders},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        timer = threading.Timer(TIMEOUT_S, process.kill)
        timer.start()
        assert process.stdout is not None
        said = next((line for line in process.stdout if "waiting for one" in line), "")
        process.kill()
        timer.cancel()
    assert "No node of the cluster has 2 graphics cards for a policy yet" in said


def test_wrong_token_is_not_taken(cluster, tmp_path):
    words = ("--tasks", "bin_sort", "--episodes", "1", *on(cluster))
    said = duobench(tmp_path / "run", "random", *words, status=1, RAY_AUTH_TOKEN="0" * 32)
    assert "cannot be used from here" in said
