"""The plan of an evaluation on real arms: which policy plays which episode, and in which order.

Every policy plays the same episodes. Within an episode they take turns in an order that a seed
decides, so that light, wear and the operator's skill change for all of them alike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from string import ascii_uppercase
from typing import ClassVar

import numpy as np

from duobench.core.errors import EvaluationError, escaped
from duobench.core.files import differences
from duobench.results.records import Key
from duobench.results.run import Candidate, Run
from duobench.results.suite import Episode, TaskInfo

PLAN_SCHEMA = 2
"""Version of the plan's fields."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RigEpisode:
    """One policy in one episode: a trial."""

    number: int
    """Place in the plan, from 0 on."""
    policy: int
    """Place of the policy among those of the plan."""
    episode: int
    """Index of the episode in the suite; it decides the layout."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TrialsPlan:
    """Everything that decides what is played, and in which order."""

    CHECKED_FROM: ClassVar[int] = 1
    run: Run
    """Run on one task, with its policies in the order of their letters A, B, ..."""
    rater: str
    """Pseudonym of the rater."""
    order_seed: int = 0
    """Decides the order in which policies take turns."""
    blind: bool = False
    """Whether the page hides which policy plays until the end."""

    def __post_init__(self) -> None:
        if len(self.run.candidates) > len(ascii_uppercase):
            raise EvaluationError(
                f"A plan has 1 to {len(ascii_uppercase)} policies, got {len(self.run.candidates)}."
            )
        if self.rater.splitlines() != [escaped(self.rater)] or not self.rater.strip():
            raise EvaluationError(
                "The judge has a name or a pseudonym: one line that can be printed."
            )

    @property
    def task(self) -> TaskInfo:
        """Task of all trials."""
        (task,) = self.run.suite.tasks
        return task

    @property
    def policies(self) -> tuple[Candidate, ...]:
        """The policies, in the order of their letters."""
        return self.run.candidates

    def trials(self) -> list[RigEpisode]:
        """Every trial in the order in which they are played, episode by episode."""
        trials: list[RigEpisode] = []
        for episode in self.run.suite.indices:
            rng = np.random.default_rng((self.order_seed, episode))
            for policy in rng.permutation(len(self.policies)).tolist():
                trials.append(
                    RigEpisode(number=len(trials), policy=policy, episode=episode)
                )
        return trials

    def letter(self, policy: int) -> str:
        """Letter of a policy."""
        return ascii_uppercase[policy]

    def shown_name(self, policy: int) -> str:
        """Name of a policy on the page during trials; none in a blind evaluation.

        A letter would hide the name, and show which trials are of the same policy.
        """
        return (
            ""
            if self.blind
            else f"{self.letter(policy)}: {self.policies[policy].policy}"
        )

    def episode(self, trial: RigEpisode) -> Episode:
        """The episode of a trial."""
        return Episode(task=self.task, index=trial.episode)

    def key(self, trial: RigEpisode) -> Key:
        """Key of the record of a trial in the run."""
        return self.run.key(self.episode(trial), self.policies[trial.policy].policy)

    def ordered_as(self, before: TrialsPlan) -> TrialsPlan:
        """This plan with rater, order and letters of one that is there already."""
        order = [each.policy for each in before.policies]
        policies = self.policies
        if sorted(order) == sorted(each.policy for each in policies):
            policies = tuple(
                sorted(policies, key=lambda each: order.index(each.policy))
            )
        run = replace(self.run, candidates=policies)
        return replace(
            self,
            run=run,
            rater=before.rater,
            order_seed=before.order_seed,
        )

    def differences(self, other: TrialsPlan) -> list[str]:
        """Return the differences of another plan, field by field; it may have fewer episodes."""
        facts = {"blind": self.blind}, {"blind": other.blind}
        return self.run.differences(other.run) + differences(*facts)


def shuffled(policies: tuple[Candidate, ...], seed: int) -> tuple[Candidate, ...]:
    """Policies in another order, so that letters do not tell who was named first.

    Args:
        policies: In the order in which they were named.
        seed: Decides the order.
    """
    order = np.random.default_rng((seed, len(policies))).permutation(len(policies))
    return tuple(policies[place] for place in order.tolist())
