"""Policies: the protocol that every policy speaks, baselines, and how a name becomes a policy.

It needs NumPy only: where a policy runs, there need be no simulator.
"""

from typing import TYPE_CHECKING

from duobench.core.references import lazy

if TYPE_CHECKING:
    from duobench.policy.baselines import (
        HoldPolicy as HoldPolicy,
        RandomPolicy as RandomPolicy,
        ZeroPolicy as ZeroPolicy,
    )
    from duobench.policy.batch import (
        Batching as Batching,
        BatchPolicy as BatchPolicy,
        Session as Session,
        SessionPolicy as SessionPolicy,
        noise as noise,
    )
    from duobench.policy.policy import (
        Policy as Policy,
        PolicyMetadata as PolicyMetadata,
        as_chunk as as_chunk,
        check_fits as check_fits,
    )
    from duobench.policy.registry import BASELINES as BASELINES, make as make

lazy(__name__)
