"""The plan of an evaluation on real arms: which policy plays which episode, and in which order.

Every policy plays the same episodes. Within an episode they take turns in an order that a seed
decides, so that light, wear and the operator's skill change for all of them alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from string import ascii_uppercase
from typing import ClassVar

import numpy as np

from duobench.errors import EvaluationError
from duobench.files import differences
from duobench.policy import PolicyMetadata
from duobench.results.run import TRAININGS
from duobench.results.suite import Episode, TaskInfo

PLAN_SCHEMA = 1
"""Version of the plan's fields."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TrialPolicy:
    """One of the policies."""

    spec: str
    """Name of the policy, as it was given."""
    metadata: PolicyMetadata
    """What it says about itself, with its version."""
    trained_on: str = ""
    """What it was trained on: "sim", "real" or "mixed"; empty if nobody said."""

    def __post_init__(self) -> None:
        """Reject an unknown training."""
        if self.trained_on not in ("", *TRAININGS):
            raise EvaluationError(
                f"A policy is trained on {', '.join(TRAININGS)}; got {self.trained_on!r}."
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class Trial:
    """One policy in one episode."""

    number: int
    """Place in the plan, from 0 on."""
    policy: int
    """Place of the policy among those of the plan."""
    episode: int
    """Index of the episode in the suite; it decides the layout."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Plan:
    """Everything that decides what is played, and in which order."""

    CHECKED_FROM: ClassVar[int] = 1
    task: TaskInfo
    """What is to be done."""
    policies: tuple[TrialPolicy, ...]
    """The policies, in the order of their letters A, B, ..."""
    rig: str
    """SHA-256 of the rig."""
    rater: str
    """Who judges, by a pseudonym."""
    episodes: int = 15
    """Episodes of each policy [paper: 15 rollouts a task]."""
    first_episode: int = 0
    """Index of the first one."""
    order_seed: int = 0
    """Decides the order in which policies take turns."""
    blind: bool = False
    """Whether the page shows letters in place of names until the end."""
    versions: Mapping[str, str]
    """Versions of the packages that scores depend on."""

    def __post_init__(self) -> None:
        """Reject a plan that nobody can play."""
        if self.episodes < 1 or self.first_episode < 0:
            raise EvaluationError(
                "A plan has at least one episode, counted from 0; got "
                f"{self.episodes} from {self.first_episode}."
            )
        if not 1 <= len(self.policies) <= len(ascii_uppercase):
            raise EvaluationError(
                f"A plan has 1 to {len(ascii_uppercase)} policies, got {len(self.policies)}."
            )
        names = [policy.spec for policy in self.policies]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise EvaluationError(
                f"Named more than once: {', '.join(twice)}. Name each policy once."
            )
        if not self.rater.strip():
            raise EvaluationError("Whoever judges has a name, or a pseudonym.")

    def trials(self) -> list[Trial]:
        """Every trial in the order in which they are played, episode by episode."""
        trials: list[Trial] = []
        for episode in range(self.first_episode, self.first_episode + self.episodes):
            rng = np.random.default_rng((self.order_seed, episode))
            for policy in rng.permutation(len(self.policies)).tolist():
                trials.append(Trial(number=len(trials), policy=policy, episode=episode))
        return trials

    def letter(self, policy: int) -> str:
        """Letter of a policy, which is also the name of its run's folder."""
        return ascii_uppercase[policy]

    def shown_name(self, policy: int) -> str:
        """How the page calls a policy while trials are played."""
        letter = self.letter(policy)
        return f"Policy {letter}" if self.blind else f"{letter}: {self.policies[policy].spec}"

    def episode(self, index: int) -> Episode:
        """An episode of the suite."""
        return Episode(task=self.task, index=index)

    def differences(self, other: Plan) -> list[str]:
        """What another plan has differently, field by field; it may have fewer episodes.

        Seed of the order and letters are those of the plan that is there.
        """
        return differences(self._facts(), other._facts()) + (
            [f"episodes {self.episodes} instead of {other.episodes} or more"]
            if self.episodes < other.episodes
            else []
        )

    def _facts(self) -> dict[str, object]:
        """What may not change within an evaluation, by its name in words."""
        policies = {policy.spec: policy for policy in self.policies}
        return {
            "task": self.task,
            "policies": " ".join(sorted(policies)),
            **{f"policy {name}": policies[name] for name in sorted(policies)},
            "rig": self.rig,
            "first episode": self.first_episode,
            "blind": self.blind,
            **{f"version of {name}": value for name, value in self.versions.items()},
        }


def shuffled(policies: tuple[TrialPolicy, ...], seed: int) -> tuple[TrialPolicy, ...]:
    """Policies in another order, so that letters do not tell who was named first.

    Args:
        policies: In the order in which they were named.
        seed: Decides the order.
    """
    order = np.random.default_rng((seed, len(policies))).permutation(len(policies))
    return tuple(policies[place] for place in order.tolist())
