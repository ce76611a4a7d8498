"""Agents at servers of VLAgents as our policies, and other versions of it refused by name."""

import os
import signal
import subprocess
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.core.errors import MachineryError, PolicyError, PolicyTimeoutError
from duobench.evaluation.episode import EpisodeRunner, Job
from duobench.evaluation.policies import PolicyChoice, PolicySource
from duobench.policy import Policy
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.client import OpenpiPolicy
from duobench.results.records import EpisodeRecord
from duobench.results.suite import Episode, Suite, find_tasks
from tests.docs.markdown import ROOT
from tests.evaluation import toy_tasks
from tests.evaluation.interop.conftest import VLAGENTS_PYTHON, environment
from tests.policy.serving.serving import free_port

PEER = Path(__file__).with_name("vlagents_peer.py")
TIMEOUT_S = 60
EXECUTED = 6

Serve = Callable[..., tuple[subprocess.Popen[bytes], int]]


def started(
    *words: str, variables: Mapping[str, str] | None = None, **options: Any
) -> subprocess.Popen[Any]:
    """A program in the environment of VLAgents, which finds the tests of this folder."""
    env = environment(**(variables or {}))
    return subprocess.Popen([os.environ[VLAGENTS_PYTHON], *words], env=env, cwd=ROOT, **options)


@pytest.fixture
def serve() -> Iterator[Serve]:
    with ExitStack() as ending:

        def start(
            *words: str, port: int | None = None, **variables: str
        ) -> tuple[subprocess.Popen[bytes], int]:
            port = port or free_port()
            process = started(*(word.format(port=port) for word in words), variables=variables)
            ending.callback(process.wait, TIMEOUT_S)
            ending.callback(process.kill)
            return process, port

        yield start


def theirs(agent: str) -> tuple[str, ...]:
    """VLAgents' own server of an agent."""
    return (str(PEER), "{port}", agent)


BRIDGE = ("-m", "duobench", "serve", "--port", "{port}", "--policy")
BRIDGE += ("duobench.evaluation.interop.vlagents:served_agent",)


@pytest.fixture
def remote(serve: Serve) -> Iterator[Callable[..., OpenpiPolicy]]:
    with ExitStack() as ending:

        def connect(agent: str, port: int, file: str = "vlagents", **options: Any) -> OpenpiPolicy:
            """The policy behind a bridge to an agent."""
            options = {"wait_s": TIMEOUT_S, "answer_s": TIMEOUT_S} | options
            variables = {"DUOBENCH_VLAGENTS_AGENT": f"{agent}@localhost:{port}"}
            _, bridge = serve(*BRIDGE, **variables, DUOBENCH_VLAGENTS_FORMAT=file)
            policy = OpenpiPolicy(RemoteServer(url=f"ws://127.0.0.1:{bridge}", **options))
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


def played(policy: Any, task: str) -> EpisodeRecord:
    (info,) = find_tasks([task])
    job = Job(policy=PolicyChoice.parse("hold"), suite=Suite(tasks=(info,)))
    runner = EpisodeRunner(PolicySource(metadata=policy.metadata, bind=lambda _env: policy), job)
    record = runner.play(Episode(task=info, index=0)).record
    runner.close()
    return record


def observation() -> dict[str, Any]:
    pixels = {
        name: np.full((128, 128, 3), 7, np.uint8) for name in ("head", "left_wrist", "right_wrist")
    }
    agent_pos = np.arange(16, dtype=np.float32)
    return {"agent_pos": agent_pos, "tcp_pose": np.zeros(14, np.float32), "pixels": pixels}


def test_agent_at_their_server_plays_an_episode_as_it_does_here(
    serve: Serve, remote: Callable[..., OpenpiPolicy]
) -> None:
    _, port = serve(*theirs("Leans"))
    policy = remote("Leans", port, execute=EXECUTED)
    assert policy.metadata.name == "vlagents Leans"
    assert policy.metadata.cameras == ("head", "left_wrist", "right_wrist")
    record = played(policy, toy_tasks.WAVE_NAME)
    assert record.error is None
    assert record.steps > EXECUTED
    assert record == played(Twin(policy), toy_tasks.WAVE_NAME)


def test_format_turns_grippers_and_renames_cameras(
    serve: Serve, remote: Callable[..., OpenpiPolicy], tmp_path: Path
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'gripper = "closed_is_one"\nprompt = "language_instruction"\n'
        '[images]\n"obs.left.cameras.head" = "left_wrist"\n'
        '[state]\n"obs.left.joints" = ["left_arm"]\n"obs.left.gripper" = ["left_gripper"]\n'
        '"obs.right.joints" = ["right_arm"]'
    )
    _, port = serve(*theirs("Leans"))
    policy = remote("Leans", port, str(path))
    assert policy.metadata.cameras == ("left_wrist",)
    policy.reset("wave", 0)
    np.testing.assert_array_equal(policy.act(observation())[:, [7, 15]], 0)


def test_agent_that_is_slow_or_fails_fails_its_episode(
    serve: Serve, remote: Callable[..., OpenpiPolicy]
) -> None:
    _, slow = serve(*theirs("Sleeps"))
    policy = remote("Sleeps", slow, answer_s=1.0)
    policy.reset("Do it.", 0)
    with pytest.raises(PolicyTimeoutError, match="lives, but did not answer"):
        policy.act(observation())
    for agent, fault in (("Fails", "will not wave"), ("OneArmed", "right has not")):
        _, port = serve(*theirs(agent))
        policy = remote(agent, port)
        for _ in range(2):  # server and bridge go on
            policy.reset("wave", 0)
            with pytest.raises(PolicyError, match=fault):
                policy.act(observation())


def test_server_that_dies_is_no_fault_of_the_agent(
    serve: Serve, remote: Callable[..., OpenpiPolicy]
) -> None:
    process, port = serve(*theirs("Sleeps"))
    policy = remote("Sleeps", port)
    policy.reset("Do it.", 0)
    process.kill()
    process.wait(TIMEOUT_S)
    with pytest.raises(MachineryError, match="server of VLAgents is gone"):
        policy.act(observation())
    process, _ = serve(*theirs("Leans"), port=port)
    with pytest.raises(MachineryError, match="has another agent"):
        policy.reset("Do it.", 0)
    process.kill()
    process.wait(TIMEOUT_S)
    serve(*theirs("Sleeps"), port=port)
    policy.reset("Do it.", 0)
    assert policy.act(observation()).shape == (8, 16)


def test_server_that_is_frozen_is_no_fault_of_the_agent(
    serve: Serve, remote: Callable[..., OpenpiPolicy]
) -> None:
    process, port = serve(*theirs("Leans"))
    policy = remote("Leans", port)
    process.send_signal(signal.SIGSTOP)
    os.waitpid(process.pid, os.WUNTRACED)  # until all of it stands still
    with pytest.raises(MachineryError, match="answers nothing"):
        policy.reset("Do it.", 0)
    process.send_signal(signal.SIGCONT)


@pytest.mark.parametrize(
    ("agent", "file", "told"),
    [
        ("localhost:1", "vlagents", "AGENT@HOST:PORT"),
        ("Leans@localhost:1", "aloha", "obs.ARM.joints"),
        ("Other@localhost:{port}", "vlagents", "has another agent"),
    ],
)
def test_bridge_that_cannot_be_says_why_in_a_sentence(
    serve: Serve, agent: str, file: str, told: str
) -> None:
    _, port = serve(*theirs("Leans"))
    variables = {"DUOBENCH_VLAGENTS_AGENT": agent.format(port=port)}
    variables |= {"DUOBENCH_VLAGENTS_FORMAT": file}
    words = [word.format(port=0) for word in BRIDGE]
    process = started(*words, variables=variables, stderr=subprocess.PIPE)
    error = process.communicate(timeout=TIMEOUT_S)[1].decode()
    assert told in error
    assert "Traceback" not in error
