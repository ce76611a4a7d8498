"""Data: recordings of episodes, data sets of them, their replay and their export."""

from typing import TYPE_CHECKING

from duobench.references import lazy

if TYPE_CHECKING:
    from duobench.data.dataset import DataSet
    from duobench.data.images import ImageSource
    from duobench.data.recorder import Recorder
    from duobench.data.recording import Recording
    from duobench.data.replay import Divergence, Replayer, replay_all
    from duobench.data.schema import Actor, ActorKind, EpisodeInfo, Outcome

__all__ = [
    "Actor",
    "ActorKind",
    "DataSet",
    "Divergence",
    "EpisodeInfo",
    "ImageSource",
    "Outcome",
    "Recorder",
    "Recording",
    "Replayer",
    "replay_all",
]

lazy(__name__)
