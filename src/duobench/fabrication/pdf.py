"""Pages of lines, polygons and text as PDF, in millimetres from the lower left corner.

Nothing in it depends on a clock or on a library: the same pages give the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

POINTS = 72 / 25.4
"""Points of a PDF in a millimetre."""

Point = Sequence[float]


@dataclass(slots=True)
class Page:
    """One page that is drawn on."""

    width: float
    """Width in mm."""
    height: float
    """Height in mm."""
    _content: list[str] = field(default_factory=list)

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
        """Draw a polygon, or with `closed` off a line through points.

        Args:
            points: Corners (n, 2) in mm.
            line: Width of the line in mm.
            grey: Its colour, 0 black to 1 white.
            dash: Length of its dashes in mm; 0 for a solid line.
            fill: Grey that it is filled with, or None.
            closed: Whether the last point is joined to the first one.
        """
        path = [f"{_pt(x)} {_pt(y)} {'m' if k == 0 else 'l'}" for k, (x, y) in enumerate(points)]
        end = ("b" if fill is not None else "s") if closed else "S"
        dashes = f"[{_pt(dash)} {_pt(dash)}] 0 d" if dash else "[] 0 d"
        shade = [f"{_number(fill)} g"] if fill is not None else []
        pen = [f"{_pt(line)} w", f"{_number(grey)} G", dashes]
        self._content += ["q", *pen, *shade, *path, end, "Q"]

    def line(self, start: Point, end: Point, **style: float) -> None:
        """Draw a line; see `polygon`."""
        self.polygon((start, end), closed=False, **style)

    def text(self, x: float, y: float, text: str, size: float = 3.5, *, bold: bool = False) -> None:
        """Write a line of text whose lower left corner is at a point, with capitals `size` mm."""
        shown = text.encode("cp1252", "replace").decode("cp1252")
        safe = shown.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
        font = "/F2" if bold else "/F1"
        self._content.append(
            f"BT {font} {_pt(size / 0.72)} Tf {_pt(x)} {_pt(y)} Td 0 g ({safe}) Tj ET"
        )

    @property
    def content(self) -> bytes:
        """What is drawn, in the language of PDF."""
        return "\n".join(self._content).encode("cp1252")


def pdf(pages: Sequence[Page], title: str) -> bytes:
    """Pages as the bytes of a file.

    Args:
        pages: At least one.
        title: Its title.
    """
    fonts = ("Helvetica", "Helvetica-Bold")
    first_page = 3 + len(fonts)
    numbers = [first_page + 2 * k for k in range(len(pages))]
    kids = " ".join(f"{number} 0 R" for number in numbers)
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        f"<< /Type /Pages /Kids [{kids}] /Count {len(pages)} >>".encode(),
        *(
            f"<< /Type /Font /Subtype /Type1 /BaseFont /{font} "
            "/Encoding /WinAnsiEncoding >>".encode()
            for font in fonts
        ),
    ]
    for number, page in zip(numbers, pages, strict=True):
        box = f"[0 0 {_pt(page.width)} {_pt(page.height)}]"
        objects.append(
            f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents {number + 1} 0 R "
            "/Resources << /Font << /F1 3 0 R /F2 4 0 R >> >> >>".encode()
        )
        content = page.content
        objects.append(b"<< /Length %d >>\nstream\n%b\nendstream" % (len(content), content))
    safe = title.encode("ascii", "replace").decode().translate({40: "[", 41: "]", 92: "/"})
    objects.append(f"<< /Title ({safe}) /Producer (DuoBench) >>".encode())
    return _file(objects)


def _file(objects: Sequence[bytes]) -> bytes:
    """Objects, the first of which is the catalog and the last the title, with their index."""
    data = bytearray(b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n")
    starts = []
    for number, content in enumerate(objects, 1):
        starts.append(len(data))
        data += b"%d 0 obj\n%b\nendobj\n" % (number, content)
    index = len(data)
    count = len(objects) + 1
    data += b"xref\n0 %d\n0000000000 65535 f \n" % count
    for start in starts:
        data += b"%010d 00000 n \n" % start
    data += b"trailer\n<< /Size %d /Root 1 0 R /Info %d 0 R >>\n" % (count, len(objects))
    return bytes(data + b"startxref\n%d\n%%%%EOF\n" % index)


def _pt(mm: float) -> str:
    """A length in points."""
    return _number(mm * POINTS)


def _number(value: float) -> str:
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
