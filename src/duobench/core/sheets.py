"""Sheets of paper in true size: lines, polygons and text as PDF, drawn by matplotlib.

Lengths are millimetres from the lower left corner of a sheet. Nothing depends on a clock or on the
user's settings of matplotlib: the same sheets give the same bytes in every process.
"""

import io
from collections.abc import Callable, Iterable, Sequence
from enum import StrEnum
from functools import partial
from typing import Any

import numpy as np

POINTS = 72 / 25.4
"""Points of a PDF in a millimetre."""
CAPITAL = 0.72
"""Height of a capital letter as a part of the size of its font (Helvetica)."""

Point = Sequence[float]


class Paper(StrEnum):
    """Sizes of paper."""

    A4 = "a4"
    A3 = "a3"

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in mm, upright."""
        return (210.0, 297.0) if self is Paper.A4 else (297.0, 420.0)


class Sheet:
    """One sheet that is drawn on, of a width and height in mm."""

    def __init__(self, width: float, height: float) -> None:
        self.width, self.height = width, height
        self._artists: list[Callable[..., Any]] = []

    def polygon(
        self,
        points: Iterable[Point],
        *,
        line: float = 0.3,
        grey: float = 0.0,
        dash: float = 0.0,
        fill: float | None = None,
        closed: bool = True,
    ) -> None:
        """Draw a polygon of corners (n, 2), or with `closed` off a line through them.

        Widths and the length of dashes are in mm; 0 is a solid line. Greys go from 0 black to 1
        white.
        """
        from matplotlib.path import Path

        corners = [tuple(point) for point in points]
        path = Path([*corners, corners[0]] if closed else corners, closed=closed)
        self._add_path(
            path,
            linewidth=line * POINTS,
            edgecolor=str(grey),
            # In widths of the line.
            linestyle=(0.0, (dash / line, dash / line)) if dash else "solid",
            facecolor="none" if fill is None else str(fill),
        )

    def line(self, start: Point, end: Point, **style: float) -> None:
        """Draw a line; see `polygon`."""
        self.polygon((start, end), closed=False, **style)

    def rectangles(self, boxes: Iterable[Sequence[float]]) -> None:
        """Fill rectangles (n, 4), left, lower edge, width, height in mm: black, without seams."""
        from matplotlib.path import Path

        left, low, width, height = np.array(list(boxes)).T
        across = np.stack([left, left + width, left + width, left, left], axis=-1)
        up = np.stack([low, low, low + height, low + height, low], axis=-1)
        corners = np.stack([across, up], axis=-1)
        codes = [Path.MOVETO, *[Path.LINETO] * 3, Path.CLOSEPOLY] * len(corners)
        self._add_path(
            Path(corners.reshape(-1, 2), codes), linewidth=0.0, edgecolor="0", facecolor="0"
        )

    def text(self, x: float, y: float, text: str, size: float = 3.5, *, bold: bool = False) -> None:
        """Write a line of text whose lower left corner is at a point, with capitals `size` mm."""
        from matplotlib.text import Text

        self._artists.append(
            partial(
                Text,
                x,
                y,
                text.encode("cp1252", "replace").decode("cp1252"),
                fontsize=size / CAPITAL * POINTS,
                fontfamily="Helvetica",
                fontweight="bold" if bold else "medium",
                verticalalignment="baseline",
                parse_math=False,
                zorder=1,
            )
        )

    def _add_path(self, path: Any, **style: Any) -> None:
        from matplotlib.patches import PathPatch

        path.should_simplify = False
        more = {"capstyle": "butt", "joinstyle": "miter", "zorder": 1}
        self._artists.append(partial(PathPatch, path, **style, **more))

    def figure(self) -> Any:
        """The sheet as a figure of matplotlib."""
        from matplotlib.figure import Figure
        from matplotlib.transforms import Affine2D

        inches = self.width / 25.4, self.height / 25.4
        figure = Figure(figsize=inches, dpi=72, frameon=False)
        transform = Affine2D().scale(POINTS)
        for artist in self._artists:
            figure.add_artist(artist(transform=transform))
        return figure


def pdf(sheets: Sequence[Sheet], title: str) -> bytes:
    """Sheets, at least one, as the bytes of a PDF file, which asks viewers not to scale it."""
    import matplotlib
    from matplotlib.backends.backend_pdf import Name, PdfFile, RendererPdf

    buffer = io.BytesIO()
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update({"pdf.compression": 0, "pdf.use14corefonts": True})
        about = {"Title": title, "Creator": "DuoBench", "Producer": "DuoBench"}
        file = PdfFile(buffer, metadata={**about, "CreationDate": None})
        # In the place of the catalog that matplotlib has just written.
        catalog = {"Type": Name("Catalog"), "Pages": file.pagesObject}
        catalog["ViewerPreferences"] = {"PrintScaling": Name("None")}
        file.writeObject(file.rootObject, catalog)
        for sheet in sheets:
            figure = sheet.figure()
            width, height = figure.get_size_inches()
            file.newPage(width, height)
            renderer = RendererPdf(file, 72, height, width)
            figure.draw(renderer)
            renderer.finalize()
        file.finalize()
        file.close()
    return buffer.getvalue()
