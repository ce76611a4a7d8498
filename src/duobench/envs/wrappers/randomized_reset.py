"""Random resets: every episode begins with a layout sampled by the task."""

from __future__ import annotations

import gymnasium as gym

from duobench.envs.duo_env import ResetOptions, Start, base_of
from duobench.envs.reset_options import (
    INSTRUCTION,
    LAYOUT,
    LAYOUT_SEED,
    OF_SIMULATION,
    SPLIT,
    checked_reset_options,
    checked_seed,
)
from duobench.envs.wrappers.base import DuoWrapper
from duobench.errors import OptionError, check_known
from duobench.randomness import EVAL, SPLITS, instruction_number

SEEDS = 2**32
"""A reset without a seed samples one below this number."""


class RandomizedReset(DuoWrapper):
    """Samples a layout of the task, a pure function of (task, suite version, split, seed).

    Without a seed the next one comes from the environment's own generator, so that a seeded reset
    decides all episodes after it. The options of `SimEnv` may give the seed of the layout, or the
    layout itself, and the instruction, which is sampled by the seed too where it varies.
    """

    def __init__(
        self, env: gym.Env, split: str = EVAL, *, varied_instructions: bool = False
    ) -> None:
        """Wrap an environment.

        Args:
            env: A `SimEnv`, wrapped or not.
            split: Which layouts a reset samples from unless its options name a `split`: "eval", or
                "train" for demonstrations.
            varied_instructions: Whether an episode's instruction is sampled from the task's own and
                its paraphrases. An episode whose layout is given, not sampled, has the task's own.

        Raises:
            TypeError: There is no simulation inside.
            UnknownNameError: There is no such split.
            OptionError: The task has no paraphrases to sample from.
        """
        super().__init__(env)
        if not hasattr(base := base_of(env), "simulation"):
            raise TypeError(
                f"Expected a simulated environment, which lays its objects out, got "
                f"{type(base).__name__}."
            )
        check_known("split", split, SPLITS)
        self._split = split
        self._is_varied = varied_instructions
        if varied_instructions and not self.base.definition.paraphrases:
            raise OptionError(
                f"Task {self.task!r} has no paraphrases, so its instructions cannot vary; give "
                "them as `paraphrases` of the task."
            )

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
            options[LAYOUT_SEED] = checked_seed(used)
            split = options.setdefault(SPLIT, self._split)
            if self._is_varied and options.get(INSTRUCTION) is None:
                count = len(self.base.definition.instructions)
                number = instruction_number(self.task, options[LAYOUT_SEED], count, split)
                options[INSTRUCTION] = number
        observation, info = self.env.reset(seed=seed, options=options)
        info["seed"], info[SPLIT] = None if used is None else int(used), split
        return observation, info
