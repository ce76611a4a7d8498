"""`duobench data merge`: several data sets in one."""

from __future__ import annotations

from pathlib import Path

import tyro

from duobench.cli.shared.advice import advising
from duobench.cli.shared.console import counted, say
from duobench.cli.shared.folders import open_data
from duobench.core.errors import NamesTakenError


def run(
    data: tyro.conf.Positional[tuple[Path, ...]], out: Path, rename: bool = False
) -> None:
    """Copy the episodes of several data sets into one.

    Args:
        data: Folders of the data sets.
        out: Folder of the merged data set; it is added to if it exists.
        rename: Give an episode whose name is taken the next free number.
    """
    sources = [open_data(each) for each in data]
    from duobench.data.arrange import merge as merge_into

    with advising({NamesTakenError: "With --rename they get the next free numbers."}):
        count = merge_into(sources, out, rename=rename)
    again = sum(len(source.episodes()) for source in sources) - count
    same = f"; left out, as equal to one of these: {again}" if again else ""
    say(f"{counted(count, 'episode')} in {out}{same}")
