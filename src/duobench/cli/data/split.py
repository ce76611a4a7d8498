"""`duobench data split`: a data set in two."""

from __future__ import annotations

from pathlib import Path

import tyro

from duobench.cli.shared.advice import AdvisedError
from duobench.cli.shared.console import counted, say
from duobench.cli.shared.folders import open_data


def run(
    data: tyro.conf.Positional[Path],
    out: tuple[Path, Path],
    fraction: float | None = None,
    tasks: tuple[str, ...] = (),
    seed: int = 0,
) -> None:
    """Copy the episodes of a data set into two new ones, without an episode that is in both.

    Args:
        data: Folder of the data set.
        out: Folders of the two.
        fraction: Share of each task's episodes that go into the first, such as 0.8.
        tasks: Tasks that go into the first, instead of a fraction.
        seed: Seed of the choice.
    """
    source = open_data(data)
    if (fraction is None) == (not tasks):
        raise AdvisedError(
            "Say what goes into the first folder: a share of each task's episodes, such as "
            "--fraction 0.8, or all of some tasks, such as --tasks bin_sort."
        )
    from duobench.data.arrange import split as split_into

    counts = split_into(
        source,
        *out,
        fraction=fraction,
        tasks=tasks,
        seed=seed,
    )
    for folder, count in zip(out, counts, strict=True):
        say(f"{counted(count, 'episode')} in {folder}")
