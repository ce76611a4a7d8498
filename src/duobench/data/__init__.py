"""Data: recordings of episodes, data sets of them, their replay and their export."""

from duobench.data.dataset import DataSet
from duobench.data.images import ImageSource
from duobench.data.recorder import Recorder
from duobench.data.recording import Recording
from duobench.data.schema import Actor, ActorKind, EpisodeInfo, Outcome

__all__ = [
    "Actor",
    "ActorKind",
    "DataSet",
    "EpisodeInfo",
    "ImageSource",
    "Outcome",
    "Recorder",
    "Recording",
]
