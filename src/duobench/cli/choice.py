"""From the arguments of a verb to the policy that plays, and how it is asked."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from duobench.errors import PolicyError

if TYPE_CHECKING:
    from duobench.evaluation.choice import PolicyChoice


def chosen(
    policy: str,
    *,
    batch: Literal["fixed", "dynamic"] | None,
    max_batch: int | None,
    server: str | None,
    layout: str | None,
    execute: int,
    wait: float,
    key_file: Path | None,
) -> PolicyChoice:
    """The choice that the arguments of `duobench eval` describe.

    Raises:
        DuoBenchError: If there is no such policy, or the arguments do not go together.
    """
    from duobench.evaluation.choice import PolicyChoice
    from duobench.evaluation.served import SERVED
    from duobench.policy.batch import MAX_BATCH, Batching
    from duobench.policy.serving.access import read_key
    from duobench.policy.serving.address import RemoteServer
    from duobench.policy.serving.layout import read_layout

    batching = remote = None
    if batch is not None or max_batch is not None:
        size = MAX_BATCH if max_batch is None else max_batch
        batching = Batching(mode=batch or "fixed", size=size)
    if (policy in SERVED) != (server is not None):
        *others, last = SERVED
        names = policy if policy in SERVED else f"{', '.join(others)} or {last}"
        raise PolicyError(f"--policy {names} and --server URL go together.")
    if server is not None:
        remote = RemoteServer(
            url=server,
            key=read_key(key_file),
            layout=None if layout is None else read_layout(layout),
            execute=execute,
            wait_s=wait,
            schemes=SERVED[policy].schemes,
        )
    elif layout is not None:
        raise PolicyError("--layout is for a policy at a --server.")
    choice = PolicyChoice(name=policy, batching=batching, server=remote)
    choice.check()
    return choice
