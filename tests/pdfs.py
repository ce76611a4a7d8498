"""Reads what a sheet's PDF draws, as far as sheets draw it: lines, filled shapes and text."""

import re
from dataclasses import dataclass, field

import numpy as np

from duobench.core.types import Array

MM = 72 / 25.4
"""Points of a PDF in a millimetre."""


@dataclass
class Read:
    """One page, in millimetres."""

    size: tuple[float, float]
    stroked: list[tuple[float, bool, Array]] = field(default_factory=list)
    """Width of the line, whether it is dashed, and the points (n, 2) of each path."""
    filled: list[Array] = field(default_factory=list)
    """The points (n, 2) of each filled shape."""
    texts: list[str] = field(default_factory=list)

    def lines(self, width: float) -> Array:
        """Both ends (n, 2, 2) of the single solid lines of a width."""
        found = [
            points
            for line, is_dashed, points in self.stroked
            if len(points) == 2 and not is_dashed and abs(line - width) < 1e-6
        ]
        return np.array(found).reshape(-1, 2, 2)


def read_pdf(data: bytes) -> list[Read]:
    """The pages of a PDF; every object must be where the index says."""
    start = int(re.findall(rb"startxref\n(\d+)\n", data)[-1])
    assert data[start:].startswith(b"xref")
    places = [int(place) for place in re.findall(rb"(\d{10}) 00000 n ", data[start:])]
    for number, place in enumerate(places, 1):
        assert data[place:].startswith(b"%d 0 obj\n" % number)
    boxes = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", data)
    streams = re.findall(rb"\nstream\n(.*?)\nendstream", data, flags=re.DOTALL)
    assert len(boxes) == len(streams)
    return [
        _read(stream.decode("cp1252"), (float(width) / MM, float(height) / MM))
        for (width, height), stream in zip(boxes, streams, strict=True)
    ]


def _read(stream: str, size: tuple[float, float]) -> Read:
    page = Read(size=size)
    page.texts = [re.sub(r"\\(.)", r"\1", text) for text in re.findall(r"\((.*)\)\sTj", stream)]
    width, is_dashed = 1.0, False
    paths: list[list[list[float]]] = []
    numbers: list[float] = []
    for token in re.sub(r"BT .*|\(.*\)\sTj|ET", "", stream).split():
        if re.fullmatch(r"-?[\d.]+", token):
            numbers.append(float(token) / MM)
            continue
        if token in {"m", "l"}:
            paths += [[]] if token == "m" else []
            paths[-1].append(numbers[-2:])
        elif token == "w":
            width = numbers[-1]
        elif token == "d":
            is_dashed = len(numbers) > 1
        elif token in {"S", "B", "f"}:
            points = [np.array(path) for path in paths]
            page.stroked += [(width, is_dashed, path) for path in points if token != "f"]
            page.filled += points if token != "S" else []
            paths = []
        if token not in {"[", "]"}:
            numbers = []
    assert not paths
    return page
