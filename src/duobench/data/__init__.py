"""Data: recordings of episodes, data sets of them, their replay and their export."""

from typing import TYPE_CHECKING

from duobench.references import lazy

if TYPE_CHECKING:
    from duobench.data.arrange import merge as merge
    from duobench.data.arrange import split as split
    from duobench.data.check import Problem as Problem
    from duobench.data.check import find_problems as find_problems
    from duobench.data.dataset import DataSet as DataSet
    from duobench.data.images import ImageSource as ImageSource
    from duobench.data.lerobot.export import Exported as Exported
    from duobench.data.lerobot.export import export_lerobot as export_lerobot
    from duobench.data.lerobot.options import ActionSource as ActionSource
    from duobench.data.lerobot.options import ExportOptions as ExportOptions
    from duobench.data.lerobot.options import Pairing as Pairing
    from duobench.data.page import write_page as write_page
    from duobench.data.recorder import Recorder as Recorder
    from duobench.data.recording import Recording as Recording
    from duobench.data.schema import Actor as Actor
    from duobench.data.schema import ActorKind as ActorKind
    from duobench.data.schema import EpisodeInfo as EpisodeInfo
    from duobench.data.schema import Outcome as Outcome
    from duobench.data.summary import Summary as Summary
    from duobench.data.summary import summarize as summarize

lazy(__name__)
