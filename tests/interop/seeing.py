"""A policy that looks, for a server to import."""

from typing import Any

import numpy as np

from duobench.policy import PolicyMetadata

CHUNK = 27


class Looks:
    """Moves by what it sees in one image."""

    metadata = PolicyMetadata(name="looks", cameras=("head",), image_size=(224, 224))

    def reset(self, instruction: str, seed: int) -> None:
        pass

    def act(self, observation: dict[str, Any]) -> np.ndarray:
        pixels = observation["pixels"]["head"].reshape(-1)[:: 224 * 196 // 10][:16]
        step = (pixels.astype(np.float32) - 127) / 127 * np.float32(0.003)
        return observation["agent_pos"] + step * np.arange(1, CHUNK + 1, dtype=np.float32)[:, None]
