"""Limits that server and client agree on, and limits of what each accepts.

A peer that sends more, or takes longer, is refused; that costs little memory and time.
"""

from duobench.core.types import FLAT_SIZE

PROTOCOL = 1
"""Version of what our server adds to openpi's protocol."""
HEALTH_PATH = "/healthz"
"""Path at which a server of ours says that it lives."""
VLA_EVAL_PROTOCOL = 1
"""Version of vla-eval's protocol that is spoken."""

MAX_REQUEST = 64 << 20
"""Bytes of a message to a server: six images of 720 x 1280 with depth and segmentation take 61 MB,
three at 224 x 224 take 1.7 MB."""
MAX_REPLY = 64 << 20
"""Bytes of a message to a client, at most; see `reply_bytes`."""
MAX_EXTRA = 1 << 20
"""Bytes of a message to a client beside the actions in it: a handshake, a state, times."""
MAX_CHUNK = 4096
"""Actions of a chunk of unknown length at most: more than two minutes."""
NUMBER_BYTES = 9
"""Bytes of a number in MessagePack."""
MAX_ARRAY_ITEMS = 4096
"""Items of one MessagePack array."""
MAX_MAP_ITEMS = 1024
"""Pairs of one MessagePack map."""
MAX_ITEMS = 10_000
"""Values in a whole message, keys included."""
MAX_DEPTH = 8
"""Maps and arrays inside each other."""
MAX_TEXT = 64 << 10
"""Bytes of a text."""
MAX_DIMENSIONS = 8
"""Dimensions of a NumPy array."""
MAX_DTYPE_TEXT = 8
"""Characters of the name of a dtype, such as "<f4"."""
DTYPE_KINDS = "biufUS"
"""Kinds of NumPy arrays that are read: all others, objects above all, could hold pointers."""
MAX_SEED = 2**64 - 1
"""Largest seed: the largest whole number of MessagePack."""

MAX_CONNECTIONS = 64
"""Clients of a server at a time."""
MAX_QUEUED_MESSAGES = 1
"""Messages of a client that are read before it is their turn."""
HANDSHAKE_S = 10.0
"""Seconds for opening a connection."""
IDLE_S = 600.0
"""Seconds that a client may be silent between requests while no other client waits."""
SILENT_S = 5.0
"""The same while another one needs the place, and waits as long for it: more than simulators take.
A client that plays no episode has to leave at once."""
SEND_S = 60.0
"""Seconds that a client may take to read a reply."""
INFERENCE_S = 600.0
"""Seconds for one chunk, waiting included: a first one may compile a model."""
HEALTH_S = 3.0
"""Seconds that a server may take to say that it lives."""
CLOSE_S = 1.0
"""Seconds that the other side may take to say goodbye."""


def reply_bytes(horizon: int | None) -> int:
    """Most bytes of a reply that holds a chunk of so many actions, if that is known."""
    return min((horizon or MAX_CHUNK) * FLAT_SIZE * NUMBER_BYTES + MAX_EXTRA, MAX_REPLY)
