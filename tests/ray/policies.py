"""A policy for processes on a cluster to import."""

import os

import numpy as np

from duobench.policy import HoldPolicy, PolicyMetadata


class NeedsCard(HoldPolicy):
    """Plays only where Ray has given it the first graphics card, and shown nobody's token."""

    metadata = PolicyMetadata(name="needs card", cameras=())

    def act(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        found = os.environ.get("CUDA_VISIBLE_DEVICES"), "RAY_AUTH_TOKEN" in os.environ
        if found != ("0", False):
            raise RuntimeError(f"found {found}")
        return super().act(observation)
