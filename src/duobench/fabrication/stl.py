"""Binary STL: the triangles of one part in millimetres, without unit and colour."""

from __future__ import annotations

import numpy as np

from duobench.objects.solid import Mesh

_HEADER = 80
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])


def stl_bytes(mesh: Mesh, name: str) -> bytes:
    """A mesh as the bytes of a binary STL file in millimetres.

    Args:
        mesh: What is printed, in metres.
        name: Name in the header, cut after 60 bytes.
    """
    corners = 1000 * mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    triangles = np.zeros(len(corners), dtype=_TRIANGLE)
    triangles["normal"] = normals / np.maximum(lengths, np.finfo(np.float64).tiny)
    triangles["corners"] = corners
    # A header that begins with "solid" would be taken for that of a text file.
    header = f"DuoBench, mm: {name}".encode("ascii", "replace")[:_HEADER].ljust(_HEADER)
    return header + np.uint32(len(triangles)).astype("<u4").tobytes() + triangles.tobytes()
