"""Run by the environment of openpi-client: its client and its codec against what is at a port.

The arguments are the port, the key, and a message in hexadecimal, which its codec reads and writes.
Prints one JSON object. Needs nothing of DuoBench.
"""

import json
import sys

import numpy as np
from openpi_client import msgpack_numpy, websocket_client_policy

port, key, message = sys.argv[1:]
client = websocket_client_policy.WebsocketClientPolicy("127.0.0.1", int(port), api_key=key)
observation = {"agent_pos": np.zeros(16, np.float32), "prompt": "Do it.", "extra": np.float32(1)}
answers = [client.infer(observation) for _ in range(2)]
try:
    client.infer({"agent_pos": "text"})
    error = None
except RuntimeError as raised:
    error = str(raised)
found = {
    "name": client.get_server_metadata()["duobench"]["name"],
    "actions": [answer["actions"].tolist() for answer in answers],
    "timing": [sorted(answer["server_timing"]) for answer in answers],
    "error": error,
    "packed": msgpack_numpy.packb(msgpack_numpy.unpackb(bytes.fromhex(message))).hex(),
}
json.dump(found, sys.stdout)
