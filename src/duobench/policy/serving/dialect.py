"""The dialects of openpi's protocol: how an episode begins, and what an answer looks like."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from duobench.errors import PolicyError, printable

VLLM_PATH = "/v1/realtime/robot/openpi"
"""Where vLLM-Omni serves robot policies."""
_ROBOARENA_KEYS = {"needs_session_id", "n_external_cameras", "needs_wrist_camera"}
"""What the first message of a RoboArena server holds."""
_LONGEST_WORDS = 1000
"""Characters of what a server says that are kept."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Dialect:
    """What one kind of server understands beside plain observations."""

    name: str
    """What the kind is called."""
    has_reset: bool = False
    """Whether an episode begins with a message; otherwise with a new connection."""
    is_reset_answered_in_text: bool = False
    """Whether that message is answered by text, which otherwise is an error."""
    has_endpoint: bool = False
    """Whether every message must say that it is an observation."""
    has_seed: bool = False
    """Whether a seed is understood, so that the noise follows from it."""
    is_seed_repeated: bool = False
    """Whether the seed is in every observation; otherwise it is in the reset."""
    has_session: bool = False
    """Whether every message names its episode, by a new name that decides nothing."""

    def messages(self, instruction: str, seed: int) -> tuple[dict[str, Any], dict[str, Any]]:
        """The message that begins an episode, and what is added to each observation of it."""
        session = {"session_id": uuid.uuid4().hex} if self.has_session else {}
        reset: dict[str, Any] = {"endpoint": "reset"}
        if self.has_seed:
            reset |= {"prompt": instruction, "seed": seed}
        added: dict[str, Any] = {**session}
        if self.has_endpoint:
            added["endpoint"] = "infer"
        if self.is_seed_repeated:
            added["seed"] = seed
        return reset | session, added


OURS = Dialect(name="duobench", has_reset=True, has_seed=True)
_OPENPI = Dialect(name="openpi")
_ROBOARENA = Dialect(
    name="roboarena", has_reset=True, is_reset_answered_in_text=True, has_endpoint=True
)
_VLLM = Dialect(
    name="vllm-omni", has_reset=True, has_seed=True, is_seed_repeated=True, has_session=True
)


def dialect_of(hello: Mapping[str, Any], path: str) -> Dialect:
    """The dialect of a server.

    Args:
        hello: Its first message.
        path: Path of its address.
    """
    if "duobench" in hello:
        return OURS
    if path.rstrip("/") == VLLM_PATH:
        return _VLLM
    if hello.keys() & _ROBOARENA_KEYS:
        return replace(_ROBOARENA, has_session=bool(hello.get("needs_session_id")))
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
        raise PolicyError(f"The policy's server reports: {_words(answer.get('message'))}")
    if key not in answer:
        raise PolicyError(
            f"The policy's server answers without {key!r}; it gives "
            f"{_words(', '.join(sorted(answer))) or 'nothing'}."
        )
    return answer[key]


def _words(value: object) -> str:
    """What a server says, for people."""
    return printable(str(value))[:_LONGEST_WORDS]
