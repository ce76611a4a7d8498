"""The cluster: how to reach it, and what it must be like."""

from __future__ import annotations

import importlib.util
import os
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from duobench.errors import EvaluationError, MachineryError
from duobench.machine import install_extra

AUTH_MODE, TOKEN = "RAY_AUTH_MODE", "token"
"""Environment variable of Ray, and the value with which nobody gets in without the cluster's
token."""
_NO_STATISTICS = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_USAGE_STATS_PROMPT_ENABLED": "0"}
_CLIENT = "ray://"


@dataclass(frozen=True, kw_only=True, slots=True)
class Cluster:
    """A Ray cluster that is there, and what of it is used."""

    address: str = "auto"
    """HOST:PORT of its head, or `auto` for the one that runs on this machine."""
    policy_gpus: float = 0.0
    """Graphics cards that each actor of a policy asks for; a part of one, or several."""

    def __post_init__(self) -> None:
        """Reject what no cluster has."""
        if not 0.0 <= self.policy_gpus < float("inf"):
            raise EvaluationError(f"A number of graphics cards is 0 or more: {self.policy_gpus}.")
        if self.address.startswith(_CLIENT) or not self.address.strip():
            raise EvaluationError(
                f"{self.address!r} is no address of a cluster: give HOST:PORT of its head, or "
                "auto, on a machine that is a node of the cluster."
            )


def load() -> Any:
    """The library, which takes seconds to load."""
    return import_module("ray")


def check_environment() -> None:
    """Find out whether Ray is installed, and asks for a token.

    Raises:
        EvaluationError: It does not.
    """
    if importlib.util.find_spec("ray") is None:
        raise EvaluationError(f"Ray is not installed. {install_extra('ray')}")
    mode = os.environ.get(AUTH_MODE, "").strip().lower()
    if mode != TOKEN:
        raise EvaluationError(
            f"{AUTH_MODE} is {mode or 'not set'}. A cluster without a token lets anybody who "
            f"reaches it run code on it, and Ray listens at all interfaces: start every node, and "
            f"this command, with {AUTH_MODE}={TOKEN} and the same RAY_AUTH_TOKEN."
        )


def connect(cluster: Cluster) -> bool:
    """Connect this process to a cluster, unless it is connected already; whether it was not.

    Raises:
        EvaluationError: There is no Ray, or no token.
        MachineryError: The cluster cannot be reached, or does not take the token.
    """
    check_environment()
    os.environ.update(_NO_STATISTICS)
    ray = load()

    if ray.is_initialized():
        return False
    try:
        ray.init(address=cluster.address, log_to_driver=False, configure_logging=False)
    except (ray.exceptions.RayError, ConnectionError, OSError, RuntimeError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise MachineryError(
            f"The Ray cluster at {cluster.address} cannot be used from here: {reason} This machine "
            "must be a node of it, with the same version of Ray and the same token."
        ) from error
    return True


def disconnect() -> None:
    """End the connection of this process, and with it all actors that it has made."""
    ray = load()

    ray.shutdown()


def unmet(cluster: Cluster) -> str:
    """What no node of the cluster has now, in words; empty if there is nothing."""
    ray = load()

    nodes: list[dict[str, Any]] = [node["Resources"] for node in ray.nodes() if node["Alive"]]
    if not any(node.get("CPU", 0) >= 1 for node in nodes):
        return "a processor core for a simulator"
    if cluster.policy_gpus and not any(node.get("GPU", 0) >= cluster.policy_gpus for node in nodes):
        return f"{cluster.policy_gpus:g} graphics cards for a policy"
    return ""
