"""Environment ids: how Gymnasium finds what makes an environment."""

from __future__ import annotations

from gymnasium.envs.registration import WrapperSpec

NAMESPACE = "duobench"
VERSION = 1
"""Version of the environments' interface; that of the episodes is `randomness.SUITE_VERSION`."""
ENTRY_POINT = "duobench.envs.make:make_base"
WRAPPERS = WrapperSpec("protocol", "duobench.envs.make:with_wrappers", {})


def env_id(task_id: str) -> str:
    """Gymnasium's id of a task: `duobench/<task>-v1`."""
    return f"{NAMESPACE}/{task_id}-v{VERSION}"
