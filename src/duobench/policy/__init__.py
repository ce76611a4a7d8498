"""Policies: the protocol that every policy speaks, baselines, and how a name becomes a policy.

It needs NumPy only: where a policy runs, there need be no simulator.
"""

from typing import TYPE_CHECKING

from duobench.references import lazy

if TYPE_CHECKING:
    from duobench.policy.baselines import HoldPolicy as HoldPolicy
    from duobench.policy.baselines import RandomPolicy as RandomPolicy
    from duobench.policy.baselines import ZeroPolicy as ZeroPolicy
    from duobench.policy.batch import Batching as Batching
    from duobench.policy.batch import BatchPolicy as BatchPolicy
    from duobench.policy.batch import Session as Session
    from duobench.policy.batch import SessionPolicy as SessionPolicy
    from duobench.policy.batch import noise as noise
    from duobench.policy.policy import Policy as Policy
    from duobench.policy.policy import PolicyMetadata as PolicyMetadata
    from duobench.policy.policy import as_chunk as as_chunk
    from duobench.policy.policy import check_fits as check_fits
    from duobench.policy.registry import BASELINES as BASELINES
    from duobench.policy.registry import make as make

lazy(__name__)
