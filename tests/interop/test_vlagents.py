"""VLAgents' own server asked by our client, and its own evaluation with our tasks and policies."""

import json
import os
import signal
import socket
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.errors import MachineryError, PolicyError, PolicyTimeoutError
from duobench.evaluation import policies
from duobench.evaluation.episode import EpisodeRunner, Job
from duobench.evaluation.policies import PolicyChoice, PolicySource
from duobench.policy import Policy
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.calls import CallConnection, CallError
from duobench.policy.serving.layout import read_layout
from duobench.policy.serving.vlagents import VLAgentsPolicy
from duobench.policy.serving.vlagents_messages import observation_text
from duobench.results.records import EpisodeRecord
from duobench.results.suite import Episode, Suite, find_tasks
from tests.evaluation import toy_tasks
from tests.interop.conftest import VLAGENTS_PYTHON

ROOT = Path(__file__).parents[2]
PEER = Path(__file__).with_name("vlagents_peer.py")
BATCHED = "tests.evaluation.toy_batches:Wanders"
SEEING = "tests.interop.seeing:Looks"
TIMEOUT_S = 60
EXECUTED = 6

Serve = Callable[..., tuple[subprocess.Popen[bytes], int]]


def started(*words: str, **options: Any) -> subprocess.Popen[Any]:
    """A program in the environment of VLAgents, which finds the tests of this folder."""
    path = os.pathsep.join([str(ROOT), str(ROOT / "src")])
    env = {**os.environ, "PYTHONPATH": path}
    return subprocess.Popen([os.environ[VLAGENTS_PYTHON], *words], env=env, cwd=ROOT, **options)


def free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


@pytest.fixture
def serve() -> Iterator[Serve]:
    with ExitStack() as ending:

        def start(*words: str, port: int | None = None) -> tuple[subprocess.Popen[bytes], int]:
            port = port or free_port()
            process = started(*(word.format(port=port) for word in words))
            ending.callback(process.wait, TIMEOUT_S)
            ending.callback(process.kill)
            return process, port

        yield start


def theirs(agent: str) -> tuple[str, ...]:
    """VLAgents' own server of an agent."""
    return (str(PEER), "serve", "{port}", agent)


def ours(policy: str) -> tuple[str, ...]:
    """VLAgents' server of a policy of ours, through our launcher."""
    kwargs = json.dumps({"policy": policy}).replace("{", "{{").replace("}", "}}")
    verb = ("-m", "duobench.interop.vlagents", "start-server", "duobench")
    return (*verb, "--port", "{port}", "--kwargs", kwargs)


@pytest.fixture
def remote() -> Iterator[Callable[..., VLAgentsPolicy]]:
    with ExitStack() as ending:

        def connect(port: int, **options: Any) -> VLAgentsPolicy:
            options = {"wait_s": TIMEOUT_S, "answer_s": TIMEOUT_S} | options
            policy = VLAgentsPolicy(RemoteServer(url=f"localhost:{port}", schemes=(), **options))
            ending.callback(policy.close)
            return policy

        yield connect


class Twin:
    """The agent `Leans` of the peer, here."""

    def __init__(self, like: Policy) -> None:
        self.metadata = like.metadata
        self.instruction = ""

    def reset(self, instruction: str, seed: int) -> None:  # noqa: ARG002 - it draws nothing
        self.instruction = instruction

    def act(self, observation: Any) -> np.ndarray:
        pixel = observation["pixels"]["head"][100, 100, 0]
        step = np.float32(0.0001) * np.float32(pixel) + np.float32(0.001) * len(self.instruction)
        chunk = observation["agent_pos"] + step * np.arange(1, 9, dtype=np.float32)[:, None]
        chunk[:, [7, 15]] = 1
        return chunk[:EXECUTED]


def source(policy: Any) -> PolicySource:
    return PolicySource(metadata=policy.metadata, bind=lambda _env: policy, close=lambda: None)


def played(which: PolicySource, task: str, episodes: int = 1) -> list[EpisodeRecord]:
    (info,) = find_tasks([task])
    job = Job(policy=PolicyChoice.parse("hold"), suite=Suite(tasks=(info,)))
    runner = EpisodeRunner(which, job)
    records = [runner.play(Episode(task=info, index=index)).record for index in range(episodes)]
    runner.close()
    return records


def observation() -> dict[str, Any]:
    pixels = {name: np.zeros((8, 8, 3), np.uint8) for name in ("head", "left_wrist", "right_wrist")}
    return {"agent_pos": np.zeros(16), "tcp_pose": np.zeros(14), "pixels": pixels}


def test_agent_at_their_server_plays_an_episode_as_it_does_here(
    serve: Serve, remote: Callable[..., VLAgentsPolicy]
) -> None:
    _, port = serve(*theirs("Leans"))
    policy = remote(port, execute=EXECUTED)
    (record,) = played(source(policy), toy_tasks.WAVE_NAME)
    assert record.error is None
    assert record.steps > EXECUTED
    assert record.versions["inference"] == "noise not controlled"
    assert record == played(source(Twin(policy)), toy_tasks.WAVE_NAME)[0]


def test_agent_that_is_slow_or_fails_fails_its_episode(
    serve: Serve, remote: Callable[..., VLAgentsPolicy]
) -> None:
    _, slow = serve(*theirs("Sleeps"))
    _, failing = serve(*theirs("Fails"))
    policy = remote(slow, answer_s=1.0)
    policy.reset("Do it.", 0)
    with pytest.raises(PolicyTimeoutError, match="lives, but did not answer"):
        policy.act(observation())
    policy = remote(failing)
    for _ in range(2):  # the server goes on
        policy.reset("wave", 0)
        with pytest.raises(PolicyError, match="SystemExit: will not wave"):
            policy.act(observation())


def test_server_that_dies_or_freezes_is_no_fault_of_the_agent(
    serve: Serve, remote: Callable[..., VLAgentsPolicy]
) -> None:
    process, port = serve(*theirs("Sleeps"))
    policy = remote(port, answer_s=TIMEOUT_S)
    policy.reset("Do it.", 0)
    process.kill()
    process.wait(TIMEOUT_S)
    with pytest.raises(MachineryError, match="is lost"):
        policy.act(observation())
    process, _ = serve(*theirs("Leans"), port=port)
    with pytest.raises(MachineryError, match="another policy now"):
        policy.reset("Do it.", 0)
    policy = remote(port, answer_s=1.0)
    policy.reset("Do it.", 0)
    process.send_signal(signal.SIGSTOP)
    os.waitpid(process.pid, os.WUNTRACED)  # until all of it stands still
    with pytest.raises(MachineryError, match="nor does it answer anything else"):
        policy.act(observation())
    process.send_signal(signal.SIGCONT)


@pytest.mark.parametrize(
    ("policy", "options"),
    [("hold", {"cameras": False}), (BATCHED, {"cameras": False}), (SEEING, {"cameras": ["head"]})],
)
def test_their_evaluation_plays_our_episodes(
    serve: Serve, policy: str, options: dict[str, Any]
) -> None:
    _, port = serve(*ours(policy))
    wait_for(port)
    words = ("evaluate", str(port), "bin_sort", json.dumps(options))
    peer = started(str(PEER), *words, stdout=subprocess.PIPE)
    told = json.loads(peer.communicate(timeout=10 * TIMEOUT_S)[0])
    records = played(policies.source(policy), "bin_sort", 2)
    assert told["ends"] == [record.state_hash for record in records]
    assert len(set(told["ends"])) == 2
    assert told["infos"] == [
        {"episode_step": 0, "action_mode": "joint", "policy_seed": record.policy_seed}
        for record in records
    ]
    assert [[success, steps] for success, _, steps in told["results"]] == [
        [record.success, record.steps] for record in records
    ]


def test_our_client_gets_from_their_server_what_our_policy_gives(
    serve: Serve, remote: Callable[..., VLAgentsPolicy]
) -> None:
    _, port = serve(*ours("hold"))
    policy = remote(port)
    for instruction in ("Do it.", "Do that."):
        policy.reset(instruction, 0)
        seen = observation() | {"agent_pos": np.full(16, len(instruction), np.float32)}
        expected = np.full((1, 16), len(instruction), np.float32)
        expected[:, [7, 15]] = 1
        np.testing.assert_array_equal(policy.act(seen), expected)


def test_policy_plays_one_episode_at_a_time_and_repeats_its_answers(serve: Serve) -> None:
    _, port = serve(*ours("random"))
    wait_for(port)
    connection = CallConnection("localhost", port, lambda: TIMEOUT_S)
    message = read_layout("vlagents").request(observation(), "Do it.")
    for arm in message["obs"].values():
        arm["gripper"] = 0.0

    def asked(seed: int, step: int) -> Any:
        message["obs"]["left"]["info"] = {"policy_seed": seed, "episode_step": step}
        text = observation_text(message)
        return connection.call("act", text)

    first, second = asked(1, 0), asked(1, 1)
    assert first != second
    assert asked(1, 1) == second
    with pytest.raises(CallError, match="one episode at a time"):
        asked(2, 1)
    assert asked(2, 0) != first
    assert asked(1, 0) == first
    message["obs"]["left"]["info"] = {"episode_step": 0, "action_mode": "cartesian"}
    text = observation_text(message)
    with pytest.raises(CallError, match="the environment's 'cartesian'"):
        connection.call("act", text)
    with pytest.raises(CallError, match="AttributeError"):  # public attributes are not reached
        connection.call("agent")
    connection.close()


def test_server_without_a_policy_ends(serve: Serve) -> None:
    process, _ = serve(*ours("hodl"))
    process.wait(TIMEOUT_S)


def test_their_program_runs_through_our_launcher(tmp_path: Path) -> None:
    agent = {"host": "localhost", "agent_name": "duobench", "agent_kwargs": {"policy": "hold"}}
    agent |= {"python_path": os.environ[VLAGENTS_PYTHON], "port": free_port()}
    env = {"env_id": "duobench/bin_sort", "env_kwargs": {"cameras": False}, "seed": 0}
    process = started(
        *("-m", "duobench.interop.vlagents", "run-eval", "--episodes", "1"),
        *("--output-path", str(tmp_path), "--agent-cfg", json.dumps(agent)),
        *("--eval-cfgs", json.dumps([env | {"max_steps_per_episode": 216}])),
    )
    assert process.wait(10 * TIMEOUT_S) == 0
    (path,) = tmp_path.glob("results_*.json")
    (result,) = json.loads(path.read_text())
    assert result["steps"]["values"] == [216]


def test_program_without_the_whole_horizon_is_refused(serve: Serve, tmp_path: Path) -> None:
    _, port = serve(*ours("hold"))
    wait_for(port)
    script = tmp_path / "short.py"
    script.write_text(
        "from duobench.interop.vlagents import register; register()\n"
        "from vlagents.envs.interface import AgentConfig, EvalConfig\n"
        "from vlagents.eval import multi_eval\n"
        f"agent = AgentConfig('localhost', 'duobench', {{}}, port={port})\n"
        "multi_eval(agent, [EvalConfig('duobench/bin_sort', {'cameras': False})], 1)\n"
    )
    process = started(str(script), stderr=subprocess.PIPE)
    told = process.communicate(timeout=TIMEOUT_S)[1].decode()
    assert "up to 216 control steps, but max_steps_per_episode is 100" in told


def wait_for(port: int) -> None:
    """Wait until a server has its policy."""
    VLAgentsPolicy(RemoteServer(url=f"localhost:{port}", schemes=(), wait_s=TIMEOUT_S)).close()
