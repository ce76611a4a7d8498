"""Data: recordings of episodes, data sets of them, their replay and their export."""

from typing import TYPE_CHECKING

from duobench.references import lazy

if TYPE_CHECKING:
    from duobench.data.arrange import merge, split
    from duobench.data.check import Problem, find_problems
    from duobench.data.dataset import DataSet
    from duobench.data.images import ImageSource
    from duobench.data.lerobot.export import Exported, export_lerobot
    from duobench.data.lerobot.options import ActionSource, ExportOptions, Pairing
    from duobench.data.page import write_page
    from duobench.data.recorder import Recorder
    from duobench.data.recording import Recording
    from duobench.data.replay import Divergence, Replayer, replay_all
    from duobench.data.schema import Actor, ActorKind, EpisodeInfo, Outcome
    from duobench.data.summary import Summary, summarize

__all__ = [
    "ActionSource",
    "Actor",
    "ActorKind",
    "DataSet",
    "Divergence",
    "EpisodeInfo",
    "ExportOptions",
    "Exported",
    "ImageSource",
    "Outcome",
    "Pairing",
    "Problem",
    "Recorder",
    "Recording",
    "Replayer",
    "Summary",
    "export_lerobot",
    "find_problems",
    "merge",
    "replay_all",
    "split",
    "summarize",
    "write_page",
]

lazy(__name__)
