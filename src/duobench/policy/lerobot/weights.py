"""Whether the weights of a checkpoint are in the model.

LeRobot's π0 and π0.5 go on with random weights where loading fails, and only print a warning.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch  # pyright: ignore[reportMissingImports]
from safetensors import safe_open  # pyright: ignore[reportMissingImports]

from duobench.errors import PolicyError

_PREFIX = "model."
"""What published weights leave out of their names."""
_MOST_NAMED = 3


def check_loaded(model: Any, file: Path) -> None:
    """Compare a model with the file of its weights, by the first row of every tensor.

    Args:
        model: A policy of LeRobot.
        file: The safetensors file that it was loaded from.

    Raises:
        PolicyError: Weights of the model are not in the file, or have other values.
    """
    state = model.state_dict()
    with safe_open(file, framework="pt") as weights:
        names = {name if name in state else _PREFIX + name: name for name in weights.keys()}  # noqa: SIM118 - no mapping
        wrong = [
            own
            for own, name in names.items()
            if own in state and not _is_equal(state[own], weights.get_slice(name))
        ]
    there = {state[name].data_ptr() for name in names if name in state}  # some share memory
    wrong += [
        name for name, value in state.items() if name not in names and value.data_ptr() not in there
    ]
    if wrong:
        listed = ", ".join(wrong[:_MOST_NAMED]) + (" …" if len(wrong) > _MOST_NAMED else "")
        raise PolicyError(
            f"{len(wrong)} of {len(state)} weights of the model are not those of {file}: {listed}. "
            "The file belongs to another configuration or another version of LeRobot."
        )


def _is_equal(own: Any, saved: Any) -> bool:
    if list(own.shape) != saved.get_shape():
        return False
    first = saved[:1] if own.ndim else saved[...]
    row = own[:1] if own.ndim else own
    return torch.equal(row.cpu(), first.to(row.dtype))
