"""`duobench data card`: the card of a data set."""

from __future__ import annotations

import shlex
from pathlib import Path

import tyro

from duobench.cli.shared.advice import FOREIGN, advising
from duobench.cli.shared.console import say
from duobench.cli.shared.process import load_engine
from duobench.core.lerobot_keys import ID


def run(
    data: tyro.conf.Positional[Path],
    name: str = ID,
    licence: str = "apache-2.0",
    import_tasks: bool = False,
) -> None:
    """Write the card of a data set, README.md as the Hub shows it, with pictures, into its folder.

    Args:
        data: Folder of recordings or of an export in LeRobot's format, or one with several.
        name: Its id on the Hub, as commands on the card name it.
        licence: The Hub's word for what others may do with it.
        import_tasks: Import tasks that are not of the benchmark, which runs the code of the modules
            that recordings name.
    """
    load_engine()
    from duobench.data.card import write_data_card

    with advising(FOREIGN):
        say(f"Card: {write_data_card(data, name, licence, import_tasks=import_tasks)}")
    words = ["hf", "upload", name, str(data), "--repo-type", "dataset"]
    say(f"Upload: {shlex.join(words)}")
