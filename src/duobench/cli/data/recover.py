"""`duobench data recover`: episodes of killed recordings."""

from __future__ import annotations

import sys
from pathlib import Path

import tyro

from duobench.cli.shared.console import counted, say
from duobench.cli.shared.folders import open_data
from duobench.core.errors import DataError, OutputError
from duobench.core.files import locked


def run(data: tyro.conf.Positional[Path]) -> None:
    """Turn what killed recordings have left into episodes that say that they were cut.

    Episodes that another process is recording at this moment are left alone.

    Args:
        data: Folder of the data set.
    """
    source = open_data(data)
    found = lost = 0
    with locked(source.path):
        for partial in source.partials():
            try:
                say(str(source.recover(partial)))
                found += 1
            except (DataError, OutputError) as error:
                lost += 1
                say(str(error))
    if found:
        say(f"{counted(found, 'episode')} recovered.")
    elif not lost:
        say("There is nothing to recover.")
    if lost:
        sys.exit(1)
