"""Editing the files of a run as a forger would, who computes checksums anew where that helps."""

import base64
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from duobench.core.files import CHECKSUM, checksum
from duobench.core.types import Array
from duobench.results.folder import RunFolder
from duobench.results.records import pack_targets, unpack_targets

Document = dict[str, Any]
Edit = Callable[[Document], None]


def rewritten(path: Path, edit: Edit, *, sealed: bool = True) -> None:
    """Edit a file of a run; sealed, its checksum fits again."""
    document = json.loads(path.read_text())
    edit(document)
    if sealed:
        document[CHECKSUM] = checksum(document)
    path.write_text(json.dumps(document))


def redescribed(folder: RunFolder, edit: Edit) -> None:
    """Edit the description of a run, and have all of its records name the new one."""
    rewritten(folder.description, edit)
    new = folder.read_run().hash
    for path in folder.path.glob("records/*/*/*.json"):
        rewritten(path, lambda record: record.update(run=new))


def copied(folder: RunFolder, path: Path) -> RunFolder:
    """A copy of a run without its report, which would tell of every edit of a record."""
    shutil.copytree(folder.path, path)
    for name in folder.report():
        (path / name).unlink()
    return RunFolder(path)


def targets_of(document: Document) -> Array:
    return unpack_targets(base64.b64decode(document["sent"]), document["steps"])


def with_targets(document: Document, targets: Array) -> None:
    document["sent"] = base64.b64encode(pack_targets(targets)).decode()


def flipped_bit(targets: Array, step: int, number: int) -> Array:
    """The targets with the lowest bit of one float32 flipped."""
    short = targets.astype(np.float32)
    assert np.array_equal(short, targets)
    short.view(np.uint32)[step, number] ^= 1
    return short.astype(np.float64)
