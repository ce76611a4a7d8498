"""Policies: the protocol that every policy speaks, baselines, and how a name becomes a policy.

It needs NumPy only: where a policy runs, there need be no simulator.
"""

from duobench.policy.baselines import HoldPolicy, RandomPolicy, ZeroPolicy
from duobench.policy.batch import Batching, BatchPolicy, Session, SessionPolicy, noise
from duobench.policy.compatibility import check_fits
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
    "check_fits",
    "make",
    "noise",
]
