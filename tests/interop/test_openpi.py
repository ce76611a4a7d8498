"""openpi's own client, from the package index, against our server."""

import json
import os
import subprocess
import threading
from pathlib import Path

import numpy as np

from duobench.policy import SessionPolicy
from duobench.policy.serving.codec import pack
from duobench.policy.serving.host import PolicyHost
from tests.interop.conftest import OPENPI_PYTHON
from tests.policy.serving.serving import BATCHING, TIMEOUT_S
from tests.policy.test_batch import Network

PEER = Path(__file__).with_name("openpi_peer.py")
OBSERVATION = {"agent_pos": np.zeros(16, np.float32)}


def test_its_client_gets_our_answers_and_errors_and_its_codec_gives_our_bytes() -> None:
    host = PolicyHost(Network(), Network.metadata, BATCHING, key="s3cret")
    thread = threading.Thread(target=host.run, daemon=True)
    thread.start()
    command = [os.environ[OPENPI_PYTHON], str(PEER), str(host.port), "s3cret"]
    told = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    host.stop()
    thread.join(TIMEOUT_S)
    assert told["name"] == "network"
    policy = SessionPolicy(Network(), BATCHING)
    policy.reset("Do it.", 0)
    expected = [np.asarray(policy.act(OBSERVATION)).tolist() for _ in range(2)]
    assert told["actions"] == expected
    ours = ["infer_ms", "policy_ms"]
    assert told["timing"] == [ours, [*ours, "prev_total_ms"]]
    assert "Traceback" in told["error"]
    message = {
        "array": np.array([[1, 2]], np.float32),
        "image": np.arange(12, dtype=np.uint8).reshape(2, 2, 3),
        "scalar": np.float32(2),
        "truth": np.bool_(1),
        "plain": [1, 2.5, None, "text"],
    }
    assert told["packed"] == pack(message).hex()
