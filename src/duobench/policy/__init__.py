"""Policies: the protocol that every policy speaks, baselines, and how a name becomes a policy."""

from duobench.policy.baselines import HoldPolicy, RandomPolicy, ZeroPolicy
from duobench.policy.batch import Batching, BatchPolicy, Session, SessionPolicy, noise
from duobench.policy.protocol import Policy, PolicyMetadata, as_chunk
from duobench.policy.registry import BASELINES, make

__all__ = [
    "BASELINES",
    "BatchPolicy",
    "Batching",
    "HoldPolicy",
    "Policy",
    "PolicyMetadata",
    "RandomPolicy",
    "Session",
    "SessionPolicy",
    "ZeroPolicy",
    "as_chunk",
    "make",
    "noise",
]
