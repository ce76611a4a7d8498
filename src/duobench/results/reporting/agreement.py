"""Whether two people who judged the same episodes agree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations


@dataclass(frozen=True, kw_only=True, slots=True)
class Verdict:
    """What one person says about one episode."""

    stage: int
    """The highest stage."""
    success: bool
    """Whether that is the last one."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Agreement:
    """How two raters agree about the episodes that both have judged."""

    a: str
    """The first rater."""
    b: str
    """The other one."""
    episodes: int
    """Episodes that both have judged."""
    same_stage: int
    """In how many they name the same highest stage."""
    same_success: int
    """In how many they agree on success or failure."""
    stage_kappa: float | None
    """Cohen's kappa of the stages; None where it is not defined."""
    success_kappa: float | None
    """Cohen's kappa of success; None where it is not defined."""


def cohens_kappa(a: Sequence[Hashable], b: Sequence[Hashable]) -> float | None:
    """Cohen's kappa: agreement beyond what two raters reach by chance.

    Source: J. Cohen, "A coefficient of agreement for nominal scales", Educational and Psychological
    Measurement 20 (1960).

    Args:
        a: Category of each item, as the first rater sees it.
        b: Likewise, as the second one does.

    Returns:
        1 for full agreement, 0 for that of chance, less for worse; None without items, and where
        both put everything into one and the same category, so that chance explains it all.

    Raises:
        ValueError: They judged different numbers of items.
    """
    if len(a) != len(b):
        raise ValueError(f"Both raters judge the same items, got {len(a)} and {len(b)}.")
    if not a:
        return None
    size = len(a)
    counts, others = Counter(a), Counter(b)
    together = sum(one == other for one, other in zip(a, b, strict=True))
    # In whole numbers, so that full agreement is exactly 1.
    chance = sum(count * others[category] for category, count in counts.items())
    if chance == size * size:
        return None
    return (size * together - chance) / (size * size - chance)


def agreements(judged: Mapping[str, Mapping[int, Verdict]]) -> list[Agreement]:
    """How any two raters agree that have judged an episode in common.

    Args:
        judged: By rater, what each says of episodes by their numbers.
    """
    found: list[Agreement] = []
    for (a, ours), (b, theirs) in combinations(judged.items(), 2):
        both = [(ours[key], theirs[key]) for key in sorted(ours.keys() & theirs.keys())]
        if not both:
            continue
        found.append(
            Agreement(
                a=a,
                b=b,
                episodes=len(both),
                same_stage=sum(one.stage == other.stage for one, other in both),
                same_success=sum(one.success == other.success for one, other in both),
                stage_kappa=cohens_kappa([x.stage for x, _ in both], [y.stage for _, y in both]),
                success_kappa=cohens_kappa(
                    [x.success for x, _ in both], [y.success for _, y in both]
                ),
            )
        )
    return found


def kappa_text(kappa: float | None) -> str:
    """Kappa with two digits, or a word."""
    return "not defined" if kappa is None else f"{kappa:.2f}"
