"""The client for VLAgents' servers, against a server that speaks their protocol."""

import json
import random
import socket
import struct
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from duobench.errors import MachineryError, PolicyError, PolicyTimeoutError, ServingError
from duobench.policy import Policy
from duobench.policy.serving import limits
from duobench.policy.serving.address import RemoteServer
from duobench.policy.serving.brine import dump
from duobench.policy.serving.layout import read_layout
from duobench.policy.serving.vlagents import VLAgentsPolicy
from tests.policy.serving.rpyc_server import (
    EXCEPTION,
    FALSE,
    REPLY,
    TIMEOUT_S,
    agent,
    calls_served,
    frame,
    value,
)
from tests.policy.serving.test_layout import observation

Connect = Callable[..., VLAgentsPolicy]
TOO_BIG = zlib.compress(bytes(limits.MAX_CALL_REPLY + 1))
ROWS = np.arange(80, dtype=np.float64).reshape(5, 2, 8)


@pytest.fixture
def remote() -> Iterator[Connect]:
    made = []

    def make(port: int, **options: Any) -> VLAgentsPolicy:
        options = {"wait_s": 0.0, "answer_s": TIMEOUT_S} | options
        policy = VLAgentsPolicy(RemoteServer(url=f"127.0.0.1:{port}", schemes=(), **options))
        made.append(policy)
        return policy

    yield make
    for policy in made:
        policy.close()


def chunk(_observation: object = None, rows: np.ndarray = ROWS) -> str:
    """An answer with a chunk of actions."""
    sides = ("left", "right")
    arms = [
        {
            s: {"action": list(arm[:-1]), "gripper": arm[-1]}
            for s, arm in zip(sides, row, strict=True)
        }
        for row in rows
    ]
    return json.dumps({"acts": arms})


def test_agent_sees_the_observation_and_its_chunk_is_cut(remote: Connect) -> None:
    seen: list[dict[str, Any]] = []

    def act(message: dict[str, Any]) -> str:
        seen.append(message)
        return chunk()

    with calls_served(agent(act)) as port:
        policy = remote(port, execute=3)
        assert isinstance(policy, Policy)
        assert not policy.metadata.seeded
        assert policy.metadata.cameras == ("head", "left_wrist", "right_wrist")
        assert policy.metadata.name == "vlagents tiny"
        assert str(port) not in repr(policy.metadata)
        for instruction in ("Do it.", "Do that."):
            policy.reset(instruction, 1)
            np.testing.assert_array_equal(policy.act(observation()), ROWS.reshape(5, 16)[:3])
    assert [message["language_instruction"] for message in seen] == ["Do it.", "Do that."]
    assert [seen[0]["obs"][side]["gripper"] for side in ("left", "right")] == [7, 15]
    assert "first 3 actions" in (policy.metadata.version or "")


def test_layout_turns_grippers_and_renames_cameras(remote: Connect, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'gripper = "closed_is_one"\nprompt = "language_instruction"\n'
        '[images]\n"obs.left.cameras.rgb" = "head"\n[state]\n"obs.left.gripper" = ["left_gripper"]'
    )
    seen: list[dict[str, Any]] = []

    def act(message: dict[str, Any]) -> str:
        seen.append(message)
        return chunk()

    with calls_served(agent(act)) as port:
        policy = remote(port, layout=read_layout(str(path)))
        policy.reset("Do it.", 0)
        actions = policy.act(observation())
    assert seen[0]["obs"]["left"].keys() == {"cameras", "gripper"}
    assert seen[0]["obs"]["left"]["gripper"] == 1 - 7
    np.testing.assert_array_equal(actions[:, [7, 15]], 1 - ROWS[:, :, 7])


@pytest.mark.parametrize("layout", ["aloha", "droid"])
def test_layout_for_other_servers_is_refused(remote: Connect, layout: str) -> None:
    with pytest.raises(ServingError, match=r"obs\.ARM\.joints"):
        remote(1, layout=read_layout(layout))


@pytest.mark.parametrize("url", ["127.0.0.1", "127.0.0.1:80/path"])
def test_address_is_a_host_and_a_port(url: str) -> None:
    with pytest.raises(ServingError, match="HOST:PORT"):
        VLAgentsPolicy(RemoteServer(url=url, schemes=()))


def test_error_of_the_agent_fails_the_episode_and_the_next_one_is_played(remote: Connect) -> None:
    honest = agent(chunk)

    def answer(number: int, method: str, arguments: tuple[Any, ...]) -> bytes | None:
        if method == "act" and '"bad"' in arguments[0]:
            return honest(number, "no such method", ())
        return honest(number, method, arguments)

    with calls_served(answer) as port:
        policy = remote(port)
        policy.reset("bad", 0)
        with pytest.raises(PolicyError, match="reports:\nTraceback\nKeyError: 'no such camera'"):
            policy.act(observation())
        policy.reset("good", 1)
        assert policy.act(observation()).shape == (5, 16)


def test_exception_of_the_server_is_never_raised_here(remote: Connect) -> None:
    """RPyC itself would make a `SystemExit` of it."""
    honest = agent(chunk)
    exits = dump((("builtins", "SystemExit"), (3,), (), "<traceback denied>"))

    def answer(number: int, method: str, arguments: tuple[Any, ...]) -> bytes | None:
        if method == "act":
            return frame(EXCEPTION, number, exits)
        return honest(number, method, arguments)

    with calls_served(answer) as port:
        policy = remote(port)
        policy.reset("Do it.", 0)
        with pytest.raises(PolicyError, match="SystemExit: 3"):
            policy.act(observation())


def test_late_answer_is_never_taken_for_the_next_one(remote: Connect) -> None:
    may = threading.Event()

    def act(message: dict[str, Any]) -> str:
        if message["language_instruction"] == "slow":
            may.wait(TIMEOUT_S)
            return chunk(rows=ROWS + 1000)
        return chunk()

    with calls_served(agent(act)) as port:
        policy = remote(port, answer_s=0.5)
        policy.reset("slow", 1)
        with pytest.raises(PolicyTimeoutError, match=r"lives, but did not answer within 0\.5 s"):
            policy.act(observation())
        may.set()
        with pytest.raises(MachineryError, match="is lost"):
            policy.act(observation())
        policy.reset("fast", 2)
        np.testing.assert_array_equal(policy.act(observation()), ROWS.reshape(5, 16))


def test_server_that_answers_nothing_any_more_is_no_fault_of_the_policy(
    remote: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "HEALTH_S", 0.3)
    held = threading.Event()
    honest = agent(chunk)

    def answer(number: int, method: str, arguments: tuple[Any, ...]) -> bytes | None:
        if held.is_set():
            time.sleep(1.5)
        return honest(number, method, arguments)

    with calls_served(answer) as port:
        policy = remote(port, answer_s=0.5)
        policy.reset("Do it.", 1)
        held.set()
        with pytest.raises(MachineryError, match="nor does it answer anything else"):
            policy.act(observation())


def test_answer_that_drips_is_late(remote: Connect) -> None:
    """Each byte comes in time, the whole does not."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]

        def drip() -> None:
            connection, _ = listener.accept()
            with connection:
                while connection.recv(1 << 16):
                    try:
                        for byte in frame(REPLY, 0, value(dump("x" * 1000))):
                            connection.sendall(bytes([byte]))
                            time.sleep(0.05)
                    except OSError:
                        return

        thread = threading.Thread(target=drip, daemon=True)
        thread.start()
        start = time.monotonic()
        with pytest.raises(MachineryError, match="cannot be reached"):
            remote(port, answer_s=0.5)
        assert time.monotonic() - start < TIMEOUT_S
        thread.join(TIMEOUT_S)


def test_connection_that_was_lost_between_episodes_is_made_again(remote: Connect) -> None:
    with calls_served(agent(chunk)) as port:
        policy = remote(port)
    with pytest.raises(MachineryError, match="cannot be reached"):
        policy.reset("Do it.", 3)
    with calls_served(agent(chunk), port):
        policy.reset("Do it.", 3)
        assert policy.act(observation()).shape == (5, 16)


def test_connection_that_is_lost_within_an_episode_is_no_fault_of_the_policy(
    remote: Connect,
) -> None:
    with calls_served(agent(chunk)) as port:
        policy = remote(port)
        policy.reset("Do it.", 3)
    with calls_served(agent(chunk), port):
        for _ in range(2):
            with pytest.raises(MachineryError, match="is lost"):
                policy.act(observation())


def test_other_agent_at_the_same_address_does_not_go_on(remote: Connect) -> None:
    with calls_served(agent(chunk)) as port:
        policy = remote(port)
    with (
        calls_served(agent(chunk, "other"), port),
        pytest.raises(MachineryError, match="another policy now"),
    ):
        policy.reset("Do it.", 3)


def test_server_of_another_version_is_refused(remote: Connect) -> None:
    honest = agent(chunk)

    def answer(number: int, method: str, arguments: tuple[Any, ...]) -> bytes | None:
        if method == "reset":
            return frame(REPLY, number, b"\x11" + dump(4) + dump(("builtins.method", 1, 2)))
        return honest(number, method, arguments)

    with calls_served(answer) as port, pytest.raises(ServingError, match=r"vlagents 0\.3"):
        remote(port)


def test_agent_that_is_not_loaded_is_waited_for(remote: Connect) -> None:
    asked: list[float] = []
    honest = agent(chunk)

    def answer(number: int, method: str, arguments: tuple[Any, ...]) -> bytes | None:
        if method == "is_initialized":
            asked.append(number)
            if len(asked) < 3:
                return frame(REPLY, number, value(FALSE))
        return honest(number, method, arguments)

    with calls_served(answer) as port:
        with pytest.raises(MachineryError, match="still being loaded"):
            remote(port)
        assert remote(port, wait_s=TIMEOUT_S).metadata.version


def hostile(generator: random.Random, number: int) -> bytes:
    """What may come in place of an answer."""
    good = frame(REPLY, number, value(dump(chunk())))
    mutated = bytearray(good)
    for _ in range(generator.randint(1, 4)):
        mutated[generator.randrange(5, len(mutated))] = generator.randrange(256)
    mutated[:4] = good[:4]
    return generator.choice(
        [
            bytes(mutated),
            good[: generator.randrange(len(good))],
            generator.randbytes(generator.randint(1, 300)),
            struct.pack("!LB", generator.choice([0, 2**31, 2**32 - 1]), 0) + good,
            struct.pack("!LB", len(TOO_BIG), 1) + TOO_BIG + b"\n",
            struct.pack("!LB", 100, 1) + generator.randbytes(101),
            frame(REPLY, number + generator.choice([-1, 1, 2**40]), value(dump(chunk()))),
            frame(1, number, b"\x11" + dump(4) + b"\x02"),
            frame(1, number, b"\x11" + dump(2) + b"\x02"),
            frame(7, number, value(dump(""))),
            frame(REPLY, number, b"\x11" + dump(4) + dump(("x", 1, 2))),
            frame(REPLY, number, value(dump(generator.choice(["{}", "[", "3", 3, ()])))),
            frame(REPLY, number, value(dump(chunk(rows=ROWS[:, :, :7])))),
            frame(REPLY, number, value(dump(chunk(rows=ROWS * np.nan)))),
            frame(REPLY, number, value(dump(chunk(rows=ROWS * 1e300)))),
            frame(EXCEPTION, number, generator.choice([dump(1), dump("text"), b"\x00", dump(())])),
            frame(REPLY, number, b"\x10" * 5000),
        ]
    )


def test_hostile_answers_are_the_fault_of_somebody(remote: Connect) -> None:
    generator = random.Random(0)
    honest = agent(chunk)
    faults = {PolicyError: 0, MachineryError: 0}

    def answer(number: int, method: str, arguments: tuple[Any, ...]) -> bytes | None:
        if method == "act":
            return hostile(generator, number) + bytes(4096)  # so that nothing is waited for
        return honest(number, method, arguments)

    fine = 0
    with calls_served(answer) as port:
        policy = remote(port, answer_s=1.0, wait_s=5.0)
        for _ in range(600):
            policy.reset("Do it.", 0)
            try:
                policy.act(observation((2, 2)))
                fine += 1
            except tuple(faults) as error:
                kind = PolicyError if isinstance(error, PolicyError) else MachineryError
                faults[kind] += 1
                assert len(str(error)) < 1_000  # noqa: PT017 - whichever it is
    assert faults[PolicyError] > 100
    assert faults[MachineryError] > 200
    assert fine + sum(faults.values()) == 600
