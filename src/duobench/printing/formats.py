"""Files that printers' programs read: STL, one part, and 3MF, all parts of a job laid out.

An STL has triangles in millimetres, without unit and colour. In a 3MF colours are a group of the
materials extension, which printers' programs read more often than base materials. The archive is
not compressed, and its dates are fixed: the same parts give the same bytes with every version of
zlib there is.
"""

from collections.abc import Iterator, Sequence
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from duobench.core.files import zipped
from duobench.printing.parts import (
    PrintedPart,
    PrintJob,
    Spot,
    lay_out,
)
from duobench.world.objects.shapes import PRINTER, Colour
from duobench.world.objects.solid import Mesh

BED_STEP = 1.2 * PRINTER
"""Distance between beds along x in metres, as programs with several beds have them."""
_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_MATERIALS = "http://schemas.microsoft.com/3dmanufacturing/material/2015/02"
_MODEL = "3D/3dmodel.model"
_HEADER = 80
_TRIANGLE = np.dtype(
    [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")]
)

_TYPES = """<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
"""
_RELATIONS = f"""<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Target="/{_MODEL}" Id="rel0" \
Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"""


def stl_bytes(mesh: Mesh, name: str) -> bytes:
    """A mesh in metres as the bytes of a binary STL file in millimetres, with a name as header."""
    corners = 1000 * mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    triangles = np.zeros(len(corners), dtype=_TRIANGLE)
    triangles["normal"] = normals / np.maximum(lengths, np.finfo(np.float64).tiny)
    triangles["corners"] = corners
    # A header that begins with "solid" would be taken for that of a text file.
    header = f"DuoBench, mm: {name}".encode("ascii", "replace")[:_HEADER].ljust(_HEADER)
    return (
        header + np.uint32(len(triangles)).astype("<u4").tobytes() + triangles.tobytes()
    )


def threemf_bytes(job: PrintJob) -> bytes:
    """The parts of a job as the bytes of a 3MF file in millimetres.

    Several beds lie side by side along x, `BED_STEP` apart.
    """
    texts = {
        "[Content_Types].xml": _TYPES,
        "_rels/.rels": _RELATIONS,
        _MODEL: "\n".join(_lines(job, lay_out(job.parts))) + "\n",
    }
    return zipped({name: text.encode() for name, text in texts.items()})


def hex_colour(rgba: Colour) -> str:
    """A colour as #RRGGBB, as it looks on a screen."""
    return "#" + "".join(
        f"{round(255 * min(max(part, 0.0), 1.0)):02X}" for part in rgba[:3]
    )


def _lines(job: PrintJob, spots: Sequence[Spot]) -> Iterator[str]:
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield f'<model unit="millimeter" xml:lang="en-US" xmlns="{_CORE}" xmlns:m="{_MATERIALS}">'
    yield f'<metadata name="Title">{escape(job.title)}</metadata>'
    yield '<metadata name="Designer">DuoBench</metadata>'
    yield f'<metadata name="Description">{escape(job.description)}</metadata>'
    yield '<metadata name="LicenseTerms">Apache-2.0</metadata>'
    colours = sorted({hex_colour(part.rgba) for part in job.parts})
    yield "<resources>"
    if colours:
        yield '<m:colorgroup id="1">'
        yield from (f'<m:color color="{colour}FF"/>' for colour in colours)
        yield "</m:colorgroup>"
    for number, part in enumerate(job.parts, 2):
        yield from _object(number, part, colours.index(hex_colour(part.rgba)))
    yield "</resources>\n<build>"
    numbers = {part.name: number for number, part in enumerate(job.parts, 2)}
    for spot in spots:
        x, y = _mm(spot.x + spot.bed * BED_STEP), _mm(spot.y)
        yield (
            f'<item objectid="{numbers[spot.part.name]}" transform="1 0 0 0 1 0 0 0 1 {x} {y} 0"/>'
        )
    yield "</build>\n</model>"


def _object(
    number: int,
    part: PrintedPart,
    colour: int,
) -> Iterator[str]:
    name = quoteattr(part.name)
    yield f'<object id="{number}" type="model" name={name} pid="1" pindex="{colour}">'
    yield "<mesh>\n<vertices>"
    for x, y, z in part.mesh.vertices.tolist():
        yield f'<vertex x="{_mm(x)}" y="{_mm(y)}" z="{_mm(z)}"/>'
    yield "</vertices>\n<triangles>"
    for a, b, c in part.mesh.faces.tolist():
        yield f'<triangle v1="{a}" v2="{b}" v3="{c}"/>'
    yield "</triangles>\n</mesh>\n</object>"


def _mm(metres: float) -> str:
    """A length in millimetres, in as few digits as tell it to a nanometre."""
    text = f"{1000 * metres:.6f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
