"""What a worker and its parent say to each other."""

from __future__ import annotations

import msgspec

from duobench.evaluation.episode import EpisodeResult, Job
from duobench.results.records import EpisodeRecord
from duobench.results.run import Run
from duobench.results.suite import Episode
from duobench.runners.child import Refused


class Play(msgspec.Struct, tag=True, frozen=True):
    """To a worker: play an episode."""

    episode: Episode


class Rehearse(msgspec.Struct, tag=True, frozen=True):
    """To a worker: have the policy answer the first observation of an episode."""

    episode: Episode


class Stop(msgspec.Struct, tag=True, frozen=True):
    """To a worker: free everything and leave."""


class Ready(msgspec.Struct, tag=True, frozen=True):
    """From a worker: the policy is made."""

    run: Run
    """What is played, and by what."""
    versions: dict[str, str | None]
    """Versions of everything that a result may depend on."""


class Rehearsed(msgspec.Struct, tag=True, frozen=True):
    """From a worker: the policy has answered."""


class Progress(msgspec.Struct, tag=True, frozen=True):
    """From a worker: the episode has begun, reached a new stage, or is played on."""

    record: EpisodeRecord
    """Its record so far."""


class EpisodeError(msgspec.Struct, tag=True, frozen=True):
    """From a worker: the machinery failed, and the episode is unplayed; play it again."""

    fault: str


Request = Job | Play | Rehearse | Stop
"""To a worker; a job comes first, which has it make the policy."""
Report = Ready | Rehearsed | Progress | EpisodeResult | EpisodeError | Refused
"""From a worker."""
