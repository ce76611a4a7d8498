"""Whether a policy and an environment fit together, checked before the first step."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from duobench.errors import PolicyError
from duobench.policy.policy import PolicyMetadata

if TYPE_CHECKING:
    import gymnasium as gym

    from duobench.envs.config import EnvConfig


def check_fits(metadata: PolicyMetadata, env: gym.Env) -> None:
    """Reject a policy that expects another environment.

    Args:
        metadata: What the policy expects.
        env: The environment that it would act in, in any wrappers.

    Raises:
        PolicyError: If the environment's configuration differs from what the policy expects; the
            message lists all of it, and how to make an environment that fits.
    """
    try:
        config = env.get_wrapper_attr("config")
    except AttributeError:
        config = None
    if config is None:
        raise PolicyError(
            "This environment has no configuration to compare with. Make it with duobench.make, or "
            "set `env.unwrapped.config` to a duobench.envs.config.EnvConfig."
        )
    if problems := list(differences(metadata, config)):
        size = "" if metadata.image_size is None else f", image_size={metadata.image_size}"
        state = ", object_state=True" if metadata.object_state else ""
        raise PolicyError(
            f"Policy {metadata.name!r} does not fit the environment: {'; '.join(problems)}. One "
            f"that fits: duobench.make(task, cameras={metadata.cameras}{size}{state}, "
            f"action_mode={metadata.action_mode!r})."
        )


def differences(metadata: PolicyMetadata, config: EnvConfig) -> Iterator[str]:
    """What a policy expects and an environment does not have, one sentence part each."""
    for camera in metadata.cameras:
        if camera not in config.cameras:
            shown = ", ".join(config.cameras) or "none"
            yield f"it sees camera {camera!r}, the environment shows {shown}"
    size = metadata.image_size
    if metadata.cameras and size is not None and size != config.image_size:
        yield f"it sees images of {size}, the environment's are {config.image_size}"
    if metadata.object_state and not config.object_state:
        yield "it reads the state of the objects, which the environment does not show"
    if metadata.action_mode != config.action_mode:
        yield f"its actions are {metadata.action_mode!r}, the environment's {config.action_mode!r}"
    if metadata.control_rate_hz != config.control_rate_hz:
        yield (
            f"it acts {metadata.control_rate_hz:g} times a second, the environment "
            f"{config.control_rate_hz:g}"
        )
    if config.chunk is not None:
        yield "it gives chunks of any length, the environment takes chunks of one length"
