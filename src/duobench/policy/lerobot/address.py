"""The name of a LeRobot policy: which checkpoint, and how it is run."""

from __future__ import annotations

from dataclasses import dataclass, fields
from urllib.parse import parse_qsl

from duobench.errors import PolicyError, check_known

SCHEME = "lerobot"
"""What the name of such a policy begins with: `lerobot:PATH_OR_ID`."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Address:
    """What `lerobot:PATH_OR_ID?steps=30&device=cpu&dtype=float32` says."""

    checkpoint: str
    """Folder of a checkpoint, or its id on the Hub."""
    steps: int | None = None
    """Actions executed of each chunk; None takes the usual 30, or all that there are."""
    device: str | None = None
    """What the model runs on, as torch names it; None takes the best that is there."""
    dtype: str | None = None
    """Numbers of the weights, "float32" or "bfloat16"; None takes those of the checkpoint."""
    action: str | None = None
    """Mode that its actions are meant for, as an export names it; None takes what the names of its
    data set say."""


def parse(text: str) -> Address:
    """Read what stands after `lerobot:`.

    Args:
        text: A folder or an id, then perhaps `?` and options, joined by `&`.

    Raises:
        UnknownNameError: There is no such option.
        PolicyError: There is no checkpoint, or a value is invalid.

    Example:
        >>> parse("runs/act/checkpoints/last/pretrained_model?steps=10").steps
        10
    """
    checkpoint, _, query = text.partition("?")
    if not checkpoint:
        raise PolicyError(
            "A LeRobot policy is lerobot:PATH_OR_ID, the folder of a checkpoint or its id on the "
            "Hub, such as lerobot:runs/act/checkpoints/last/pretrained_model."
        )
    known = [field.name for field in fields(Address) if field.name != "checkpoint"]
    options: dict[str, str] = {}
    for name, value in parse_qsl(query, keep_blank_values=True):
        check_known("option of a LeRobot policy", name, known)
        if not value or name in options:
            raise PolicyError(f"Option {name!r} of a LeRobot policy needs one value: {text!r}.")
        options[name] = value
    steps = options.pop("steps", None)
    return Address(checkpoint=checkpoint, steps=_steps(steps), **options)


def _steps(value: str | None) -> int | None:
    if value is None:
        return None
    if not (value.isascii() and value.isdigit() and int(value) > 0):
        raise PolicyError(f"The steps of a LeRobot policy are 1 or more, got {value!r}.")
    return int(value)
