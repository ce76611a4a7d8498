"""Random resets: every episode begins with a layout sampled by the task."""

from __future__ import annotations

import gymnasium as gym

from duobench.envs.duo_env import ResetOptions, Start, base_of
from duobench.envs.reset_options import (
    LAYOUT,
    LAYOUT_SEED,
    OF_SIMULATION,
    SPLIT,
    checked_reset_options,
)
from duobench.envs.wrappers.base import DuoWrapper
from duobench.errors import check_known
from duobench.randomness import EVAL, SPLITS

SEEDS = 2**32
"""A reset without a seed samples one below this number."""


class RandomizedReset(DuoWrapper):
    """Samples a layout of the task, a pure function of (task, suite version, split, seed).

    Without a seed the next one comes from the environment's own generator, so that a seeded reset
    decides all episodes after it. The options of `SimEnv` may give the seed of the layout, or the
    layout itself.
    """

    def __init__(self, env: gym.Env, split: str = EVAL) -> None:
        """Wrap an environment.

        Args:
            env: A `SimEnv`, wrapped or not.
            split: Which layouts a reset samples from unless its options name a `split`: "eval", or
                "train" for demonstrations.

        Raises:
            TypeError: There is no simulation inside.
            UnknownNameError: There is no such split.
        """
        super().__init__(env)
        if not hasattr(base := base_of(env), "simulation"):
            raise TypeError(
                f"Expected a simulated environment, which lays its objects out, got "
                f"{type(base).__name__}."
            )
        check_known("split", split, SPLITS)
        self._split = split

    def reset(self, *, seed: int | None = None, options: ResetOptions = None) -> Start:
        """Begin an episode.

        Info also holds `seed` and `split`, from which the layout was sampled; both are None for a
        layout that was given.

        Raises:
            LayoutError: No valid layout was found, or the given one is none.
            UnknownNameError: There is no such option or split.
            OptionError: The seed is no whole number from 0 on, or the options are no dict.
        """
        options = checked_reset_options(options, OF_SIMULATION)
        used = split = None
        if options.get(LAYOUT) is None:
            used = options.get(LAYOUT_SEED)
            if used is None:
                used = self.np_random.integers(SEEDS) if seed is None else seed
            options[LAYOUT_SEED] = used
            split = options.setdefault(SPLIT, self._split)
        observation, info = self.env.reset(seed=seed, options=options)
        info["seed"], info[SPLIT] = None if used is None else int(used), split
        return observation, info
