"""openpi's own client, from the package index, against our server."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np

from duobench.policy import SessionPolicy
from duobench.policy.serving.codec import pack
from tests.evaluation.interop.conftest import OPENPI_PYTHON
from tests.policy.serving.serving import BATCHING, Serve
from tests.policy.test_batch import OBSERVATION, Network

PEER = Path(__file__).with_name("openpi_peer.py")
MESSAGE = {
    "array": np.array([[1, 2]], np.float32),
    "image": np.arange(12, dtype=np.uint8).reshape(2, 2, 3),
    "scalar": np.float32(2),
    "truth": np.bool_(1),
    "plain": [1, 2.5, None, "text"],
}


def test_its_client_gets_our_answers_and_errors_and_its_codec_gives_our_bytes(
    serve: Serve,
) -> None:
    packed, port = pack(MESSAGE).hex(), serve(Network(), key="s3cret")
    command = [os.environ[OPENPI_PYTHON], str(PEER), str(port), "s3cret", packed]
    told = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    policy = SessionPolicy(Network(), BATCHING)
    policy.reset("Do it.", 0)
    assert "Traceback" in told.pop("error")
    timing = ["infer_ms", "policy_ms"]
    assert told == {
        "name": "network",
        "actions": [np.asarray(policy.act(OBSERVATION)).tolist() for _ in range(2)],
        "timing": [timing, [*timing, "prev_total_ms"]],
        "packed": packed,
    }
