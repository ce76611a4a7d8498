"""Run by the environment of openpi-client: its client and its codec against what is at a port.

Prints one JSON object. Needs nothing of DuoBench.
"""

import json
import sys

import numpy as np
from openpi_client import msgpack_numpy, websocket_client_policy

MESSAGE = {
    "array": np.array([[1, 2]], np.float32),
    "image": np.arange(12, dtype=np.uint8).reshape(2, 2, 3),
    "scalar": np.float32(2),
    "truth": np.bool_(1),
    "plain": [1, 2.5, None, "text"],
}

port, key = int(sys.argv[1]), sys.argv[2]
client = websocket_client_policy.WebsocketClientPolicy("127.0.0.1", port, api_key=key)
observation = {"agent_pos": np.zeros(16, np.float32), "prompt": "Do it.", "extra": np.float32(1)}
answers = [client.infer(observation) for _ in range(2)]
try:
    client.infer({"agent_pos": "text"})
    error = None
except RuntimeError as raised:
    error = str(raised)
json.dump(
    {
        "name": client.get_server_metadata()["duobench"]["name"],
        "actions": [answer["actions"].tolist() for answer in answers],
        "timing": [sorted(answer["server_timing"]) for answer in answers],
        "error": error,
        "packed": msgpack_numpy.packb(MESSAGE).hex(),
    },
    sys.stdout,
)
