"""The dialects of openpi's protocol: how an episode begins, and what an answer looks like."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from duobench.errors import PolicyError, escaped
from duobench.policy.serving.connection import reported

VLLM_PATH = "/v1/realtime/robot/openpi"
"""Where vLLM-Omni serves robot policies."""
_ROBOARENA_KEYS = {"needs_session_id", "n_external_cameras", "needs_wrist_camera"}
"""What the first message of a RoboArena server holds."""
_LONGEST_LIST = 1000
"""Characters of a list of names that are kept."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Dialect:
    """What one kind of server understands beside plain observations."""

    name: str
    """What the kind is called."""
    reset: tuple[str, ...] | None = None
    """Fields of the message that begins an episode; None if a new connection does."""
    is_reset_answered_in_text: bool = False
    """Whether that message is answered by text, which otherwise is an error."""
    added: tuple[str, ...] = ()
    """Fields that are added to every observation."""

    @property
    def has_seed(self) -> bool:
        """Whether a seed is understood, so that the noise follows from it."""
        return "seed" in (self.reset or ())

    def messages(self, instruction: str, seed: int) -> tuple[dict[str, Any], dict[str, Any]]:
        """The message that begins an episode, and what is added to each observation of it."""
        values = {"endpoint": "infer", "prompt": instruction, "seed": seed}
        values["session_id"] = uuid.uuid4().hex  # a new one for each episode; it decides nothing
        reset = {"endpoint": "reset", **{name: values[name] for name in self.reset or ()}}
        return reset, {name: values[name] for name in self.added}


OURS = Dialect(name="duobench", reset=("prompt", "seed"))
_OPENPI = Dialect(name="openpi")
_ROBOARENA = Dialect(
    name="roboarena", reset=(), is_reset_answered_in_text=True, added=("endpoint",)
)
_ROBOARENA_SESSIONS = replace(_ROBOARENA, reset=("session_id",), added=("session_id", "endpoint"))
_VLLM = Dialect(
    name="vllm-omni", reset=("prompt", "seed", "session_id"), added=("session_id", "seed")
)


def dialect_of(handshake: Mapping[str, Any], path: str) -> Dialect:
    """The dialect of a server.

    Args:
        handshake: Its first message.
        path: Path of its address.
    """
    if "duobench" in handshake:
        return OURS
    if path.rstrip("/") == VLLM_PATH:
        return _VLLM
    if handshake.keys() & _ROBOARENA_KEYS:
        return _ROBOARENA_SESSIONS if handshake.get("needs_session_id") else _ROBOARENA
    return _OPENPI


def actions_of(answer: Any, key: str) -> Any:
    """The actions in an answer, which may also be nothing but them.

    Raises:
        PolicyError: If there are none, or the server reports an error in its answer.
    """
    if isinstance(answer, np.ndarray):
        return answer
    if not isinstance(answer, dict):
        raise PolicyError(f"The policy's server answers with a {type(answer).__name__}, no map.")
    if isinstance(kind := answer.get("type"), str) and kind == "error":
        raise reported(str(answer.get("message")))
    if key not in answer:
        known = escaped(", ".join(sorted(answer)))[:_LONGEST_LIST] or "nothing"
        raise PolicyError(f"The policy's server answers without {key!r}; it gives {known}.")
    return answer[key]
