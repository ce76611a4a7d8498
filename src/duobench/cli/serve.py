"""`duobench serve`: a policy at a port."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from duobench.cli.shared.console import say
from duobench.cli.shared.process import stopping
from duobench.core.errors import ServingError
from duobench.policy.batch import Batching
from duobench.policy.registry import reads_simulation
from duobench.policy.serving.access import check_access, read_key


def run(
    policy: str,
    host: str = "127.0.0.1",
    port: int = 8000,
    max_batch: int = 8,
    batch: Literal["fixed", "dynamic"] = "fixed",
    key_file: Path | None = None,
) -> None:
    """Serve a policy over openpi's WebSocket protocol, until Ctrl-C.

    Evaluate it with: duobench eval --policy openpi --server ws://HOST:PORT

    Args:
        policy: module:attribute for a policy of your own, lerobot:PATH_OR_ID for a checkpoint of
            LeRobot, or hold, random, zero.
        host: Address to listen at. Any but that of this machine needs a key.
        port: Port to listen at; 0 takes a free one.
        max_batch: Observations that are answered together, at most. A policy that plays one episode
            at a time is made as often as that.
        batch: fixed fills every batch up to --max-batch; dynamic takes what waits, which is faster.
        key_file: File with the key that clients must have, in place of DUOBENCH_API_KEY.
    """
    if reads_simulation(policy):
        raise ServingError(
            f"{policy} reads the state of the simulator, which no client sends, so it cannot be "
            "served. Serve hold, random, zero, lerobot:PATH_OR_ID or module:attribute."
        )
    from duobench.policy.serving.host import PolicyHost, make_served

    key = read_key(key_file)
    check_access(host, key)  # before the weights are loaded
    served, metadata, batching = make_served(
        policy, Batching(mode=batch, size=max_batch)
    )
    place = PolicyHost(
        served,
        metadata,
        batching,
        host=host,
        port=port,
        key=key,
    )
    shown = f"[{host}]" if ":" in host else host
    with stopping(place.stop):
        say(
            f"Serving {metadata.name} at ws://{shown}:{place.port}, "
            f"{'with' if key else 'without'} a key, in {batching.mode} batches of at most "
            f"{batching.size}. Ctrl-C ends it.",
        )
        place.run()
