"""How the fine meshes of the robot are made from the published files.

`python -m dev.tools.fine_meshes FOLDER` writes `world/scene/robot_meshes_fine.npz` anew from the
files that `dev.tools.meshes` looks for in the folder, in about ten seconds. It needs
`meshoptimizer` 0.2.30a0 (MIT), of which nothing is shipped.

The parts of a link are reduced together, so that no crack opens where a white cover meets a black
band. A reduced mesh keeps vertices of the published one, and with them its normals. Links are 2 mm
apart at their joints, as the real ones are; a black ring inside of each gap lets no light through.
"""

from __future__ import annotations

import ctypes
import hashlib
import io
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dev.tools.meshes import DIGESTS, SEAMS, missing
from duobench.core.types import Array
from duobench.world.scene import fine_meshes
from duobench.world.scene.fine_meshes import NORMAL_STEPS, PAD, FineMesh
from duobench.world.scene.meshes import POINTS_PER_METRE
from duobench.world.scene.robotiq_2f85 import PAD_SIZE, PADS

Recipe = Mapping[str, Mapping[str, str]]

_ARM: tuple[Recipe, ...] = (
    {
        "link0_3": {"link0_3": "cover", "link0_1": "cover", "link0_2": "cover"},
        "link0_5": {"link0_5": "stop"},
        "link0_6": {"link0_6": "trim", "link0_0": "trim", "link0_4": "letters"},
    },
    {"link1": {"link1": "cover"}},
    {"link2": {"link2": "cover"}},
    {"link3_0": {"link3_0": "cover"}, "link3_1": {"link3_1": "trim"}},
    {"link4_0": {"link4_0": "cover"}, "link4_1": {"link4_1": "trim"}},
    {
        "link5_0": {"link5_0": "cover"},
        "link5_2": {"link5_2": "trim", "link5_1": "letters"},
    },
    {
        "link6_1": {"link6_1": "cover"},
        "link6_2": {"link6_2": "cover", "link6_3": "letters", "link6_5": "cover"},
        "link6_6": {
            "link6_6": "trim",
            "link6_0": "button",
            "link6_4": "stop",
            "link6_7": "button",
        },
    },
    {
        "link7_1": {"link7_1": "aluminium"},
        "link7_2": {"link7_2": "cover"},
        "link7_3": {"link7_3": "trim", "link7_0": "trim"},
    },
)
_GRIPPER: Mapping[str, str] = {
    "base": "housing",
    "base_coupling": "housing",
    "c-a01-85-open": "aluminium",
    "driver": "aluminium",
    "coupler": "housing",
    "spring_link": "housing",
    "follower": "housing",
    "tongue": "aluminium",
}
RECIPES: tuple[Recipe, ...] = (
    *(
        {
            f"fr3/{image}:visual": {f"fr3/{name}.obj": of for name, of in files.items()}
            for image, files in link.items()
        }
        for link in _ARM
    ),
    *(
        {f"robotiq_2f85/{part}:visual": {f"robotiq_2f85/{part}.stl": finish}}
        for part, finish in _GRIPPER.items()
    ),
)
"""For everything that is reduced together, by image of the classic scene, the published files that
are seen in its place, with their finishes; links 0 to 7 come first."""

ERROR_MM, NORMAL_WEIGHT = 0.4, 0.3
"""How far in millimetres a reduced surface may be from the published one, and how much a change of
its normals counts beside that: without it, narrow rounded edges go, and shading gets wrinkles."""
ERRORS_MM: Mapping[str, float] = {
    "fr3/link0_3:visual": 1.2,  # screws and plugs of the base, which no camera is near
    "fr3/link6_1:visual": 0.7,
    "fr3/link7_1:visual": 0.9,
    "robotiq_2f85/base:visual": 1.2,
    "robotiq_2f85/base_coupling:visual": 2.0,
    "robotiq_2f85/coupler:visual": 0.6,
    "robotiq_2f85/spring_link:visual": 0.6,
    "robotiq_2f85/tongue:visual": 0.2,
}
"""The same by first image, of what has much that hardly shows, and of what is near a camera."""
SMOOTH = math.cos(math.radians(40.0))
"""Published normals that are turned by less against a triangle are its own: cosine."""
RING_INSET, RING_REACH, RING_SIDES = 0.002, 0.007, 48
"""How much in metres the ring in a gap is smaller than the links' rims, and reaches into both; and
its number of sides."""
PAD_PROUD, PAD_INSET, PAD_BEVEL = 0.0002, 0.0007, 0.0006
"""By how much in metres a pad stands out of the tongue, is narrower, and has its edges cut."""
PAD_CORNER, PAD_STEPS = 0.0026, 7
"""Radius of its corners in metres, as the tongue's, and the points of each."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Surface:
    """Triangles of the parts of a link."""

    keys: Sequence[tuple[str, str]]
    """Image and finish of every part."""
    corners: Array
    """Corners (m, 3, 3) on the grid."""
    normals: Array
    """Unit normals (m, 3, 3)."""
    parts: NDArray[np.int64]
    """Numbers of the parts (m,)."""


def read(data: bytes, suffix: str) -> tuple[Array, Array]:
    """Corners (m, 3, 3) in metres and normals (m, 3, 3) of a published file."""
    if suffix == ".stl":
        count = int.from_bytes(data[80:84], "little")
        layout = np.dtype(
            [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("_", "<u2")]
        )
        corners = np.frombuffer(data, layout, count, 84)["corners"].astype(np.float64)
        return corners, np.repeat(_unit(_across(corners))[:, None], 3, axis=1)
    rows: dict[str, list[list[str]]] = {"v": [], "vn": [], "f": []}
    for line in data.decode().splitlines():
        kind, _, rest = line.partition(" ")
        if kind in rows:
            rows[kind].append(rest.split())
    points, normals = np.array(rows["v"], float), np.array(rows["vn"], float)
    index = (
        np.array([[each.split("//") for each in face] for face in rows["f"]], int) - 1
    )
    return points[index[..., 0]], _unit(normals[index[..., 1]])


def surface(recipe: Recipe, files: Mapping[str, bytes]) -> _Surface:
    """All that is published of the parts of a link; files by name."""
    keys: list[tuple[str, str]] = []
    corners: list[Array] = []
    normals: list[Array] = []
    parts: list[int] = []
    for image, sources in recipe.items():
        for source, finish in sources.items():
            key = image, finish
            if key not in keys:
                keys.append(key)
            points, directions = read(files[source], Path(source).suffix)
            corners.append(np.rint(points * POINTS_PER_METRE))
            normals.append(directions)
            parts += [keys.index(key)] * len(points)
    points = np.concatenate(corners)
    real = (_across(points) != 0.0).any(axis=1)  # and no line
    return _Surface(
        keys=keys,
        corners=points[real],
        normals=np.concatenate(normals)[real],
        parts=np.array(parts)[real],
    )


def reduced(whole: _Surface, error_mm: float) -> _Surface:
    """A surface of fewer triangles, whose corners are some of those of the whole one."""
    keys = np.column_stack([whole.corners.reshape(-1, 3), np.repeat(whole.parts, 3)])
    vertices, index = np.unique(keys, axis=0, return_inverse=True)
    index = index.ravel().astype(np.uint32)
    means = np.zeros((len(vertices), 3))
    area = np.repeat(_length(_across(whole.corners)), 3, axis=0)
    np.add.at(means, index, whole.normals.reshape(-1, 3) * area)
    points = (vertices[:, :3] / POINTS_PER_METRE).astype(np.float32, order="C")
    normals = _unit(means).astype(np.float32)
    weights = np.full(3, NORMAL_WEIGHT, dtype=np.float32)
    kept = np.empty_like(index)
    # The package's own function of this name leaves the types of the numbers to chance.
    simplify = import_module("meshoptimizer._loader").lib.meshopt_simplifyWithAttributes
    pointer, size = ctypes.c_void_p, ctypes.c_size_t
    simplify.argtypes = (
        *(pointer, pointer, size),
        *(pointer, size, size),
        *(pointer, size, pointer, size),
        *(pointer, size, ctypes.c_float, ctypes.c_uint, pointer),
    )
    simplify.restype = size
    count = simplify(
        *(kept.ctypes.data, index.ctypes.data, len(index)),
        *(points.ctypes.data, len(points), points.strides[0]),
        *(normals.ctypes.data, normals.strides[0], weights.ctypes.data, len(weights)),
        *(None, 0, error_mm / 1000, _ABSOLUTE, None),
    )
    faces = kept[:count].reshape(-1, 3)
    corners = vertices[faces, :3].astype(np.float64)
    return replace(
        whole,
        corners=corners,
        normals=_normals_of(whole, corners),
        parts=vertices[faces[:, 0], 3].astype(np.int64),
    )


_ABSOLUTE = 4
"""Option of the optimizer: the error is in metres."""


def _normals_of(whole: _Surface, corners: Array) -> Array:
    """Normals at the corners of a reduced surface.

    Each is the mean of what is published there and not across an edge, by area: what was flat looks
    flat.
    """
    _, place = np.unique(
        np.concatenate([whole.corners.reshape(-1, 3), corners.reshape(-1, 3)]),
        axis=0,
        return_inverse=True,
    )
    there, here = np.split(place.ravel(), [whole.corners.size // 3])
    by_place = np.argsort(there, kind="stable")
    first = np.searchsorted(there[by_place], np.arange(place.max() + 2))
    pairs = (first[1:] - first[:-1])[here]
    one = np.repeat(np.arange(len(here)), pairs)
    rank = np.arange(len(one)) - np.repeat(pairs.cumsum() - pairs, pairs)
    other = by_place[first[here[one]] + rank]
    faces = _unit(_across(corners))
    published = whole.normals.reshape(-1, 3)
    area = _length(_across(whole.corners))[:, 0]
    near = np.einsum("px,px->p", faces[one // 3], published[other]) >= SMOOTH
    one, other = one[near], other[near]
    total = np.zeros((len(here), 3))
    np.add.at(total, one, published[other] * area[other // 3, None])
    total = np.where(_length(total) > 0, total, np.repeat(faces, 3, axis=0))
    return _unit(total).reshape(-1, 3, 3)


def ring(number: int, image: str) -> _Surface:
    """The ring in the gap of a joint, in the frame of the link behind it."""
    height, radius = SEAMS[number]
    angles = np.linspace(0.0, 2 * math.pi, RING_SIDES, endpoint=False)
    around = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(RING_SIDES)])
    up = np.array([0.0, 0.0, RING_REACH])
    middle = np.array([0.0, 0.0, height])
    low = middle + (radius - RING_INSET) * around - up
    return _of_quads(
        _strip(low, low + 2 * up), _strip(around, around), (image, "joint")
    )


def pad() -> _Surface:
    """A pad with round corners, in the frame of the first of the boxes that grasp."""
    length = PADS[1] - PADS[0]
    half = np.array([PAD_SIZE[1], PAD_SIZE[2] + length / 2]) - PAD_INSET - PAD_CORNER
    angles = (
        np.linspace(0.0, math.pi / 2, PAD_STEPS) + np.arange(4)[:, None] * math.pi / 2
    )
    outward = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])[:, None]
    face = PAD_SIZE[0] + PAD_PROUD
    low, edge, high = (
        _outline(height, signs * half + (PAD_CORNER - cut) * outward, length / 2)
        for height, cut in ((0.0, 0.0), (face - PAD_BEVEL, 0.0), (face, PAD_BEVEL))
    )
    sideways, up = _outline(0.0, outward), np.array([1.0, 0.0, 0.0])
    slanted = _unit(sideways + up)
    half_way = len(high) // 2
    there, back = high[:half_way], high[half_way:][::-1]
    cap = np.stack([there[:-1], there[1:], back[1:], back[:-1]], axis=1)
    quads = np.concatenate([_strip(low, edge), _strip(edge, high), cap])
    normals = np.concatenate(
        [
            _strip(sideways, sideways),
            _strip(slanted, slanted),
            np.broadcast_to(up, cap.shape),
        ]
    )
    return _of_quads(quads, normals, (PAD, "rubber"))


def _outline(height: float, around: Array, middle: float = 0.0) -> Array:
    """Points across the x axis at a height along it, moved along z."""
    flat = around.reshape(-1, 2)
    return np.column_stack([np.full(len(flat), height), flat + np.array((0.0, middle))])


def _strip(low: Array, high: Array) -> Array:
    """The quads between two closed lines, counter-clockwise from outside."""
    return np.stack([low, np.roll(low, -1, 0), np.roll(high, -1, 0), high], axis=1)


def _of_quads(quads: Array, normals: Array, key: tuple[str, str]) -> _Surface:
    halves = np.array([(0, 1, 2), (0, 2, 3)])
    return _Surface(
        keys=[key],
        corners=np.rint(quads[:, halves].reshape(-1, 3, 3) * POINTS_PER_METRE),
        normals=normals[:, halves].reshape(-1, 3, 3),
        parts=np.zeros(2 * len(quads), dtype=np.int64),
    )


def meshes_of(surfaces: Iterable[_Surface]) -> list[FineMesh]:
    """The meshes of surfaces, one for each image and finish; vertices are in order."""
    found: dict[tuple[str, str], list[Array]] = {}
    for each in surfaces:
        for number, key in enumerate(each.keys):
            mine = each.parts == number
            corners, normals = each.corners[mine], each.normals[mine]
            steps = np.rint(normals * NORMAL_STEPS)
            found.setdefault(key, []).append(np.concatenate([corners, steps], axis=2))
    meshes: list[FineMesh] = []
    for (image, finish), pieces in found.items():
        corners = np.concatenate(pieces)
        rows, index = np.unique(corners.reshape(-1, 6), axis=0, return_inverse=True)
        meshes.append(
            FineMesh(
                image=image,
                finish=finish,
                vertices=(rows[:, :3] / POINTS_PER_METRE).astype(np.float32),
                normals=_unit(rows[:, 3:]).astype(np.float32),
                faces=index.reshape(-1, 3).astype(np.int32),
            )
        )
    return meshes


def packed(meshes: Sequence[FineMesh]) -> bytes:
    """The file that holds the meshes."""
    points = np.concatenate([mesh.vertices for mesh in meshes]) * POINTS_PER_METRE
    normals = np.concatenate([mesh.normals for mesh in meshes]) * NORMAL_STEPS
    content = io.BytesIO()
    np.savez(
        content,
        images=np.array([mesh.image for mesh in meshes]),
        finishes=np.array([mesh.finish for mesh in meshes]),
        counts=np.array([(len(mesh.vertices), len(mesh.faces)) for mesh in meshes]),
        points=np.rint(points).astype(np.int16),
        normals=np.rint(normals).astype(np.int16),
        faces=np.concatenate([mesh.faces for mesh in meshes]).astype(np.uint16),
    )
    return content.getvalue()


def published_files(folder: Path, digests: Path = DIGESTS) -> dict[str, bytes]:
    """The published files that are in a folder or below it, by the names that digests have."""
    published = dict(line.split() for line in digests.read_text("utf-8").splitlines())
    files: dict[str, bytes] = {}
    for path in folder.rglob("*"):
        if path.suffix in (".obj", ".stl"):
            data = path.read_bytes()
            name = published.get(hashlib.sha256(data).hexdigest())
            if name:
                files[name] = data
    return files


def make(folder: Path) -> bytes:
    """The shipped file, from a folder with the published ones."""
    files = published_files(folder)
    surfaces = [
        reduced(surface(each, files), ERRORS_MM.get(next(iter(each)), ERROR_MM))
        for each in RECIPES
    ]
    surfaces += [ring(number, next(iter(RECIPES[number]))) for number in SEAMS]
    surfaces.append(pad())
    return packed(meshes_of(surfaces))


def _across(corners: Array) -> Array:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _length(vectors: Array) -> Array:
    return np.sqrt((vectors * vectors).sum(axis=-1, keepdims=True))


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(_length(vectors), 1e-300)


if __name__ == "__main__":
    absent = missing(Path(sys.argv[1]))
    if absent:
        sys.exit(f"Missing, or with other bytes: {', '.join(absent)}")
    made = make(Path(sys.argv[1]))
    Path(fine_meshes.__file__).with_name(fine_meshes.FILE).write_bytes(made)
    print(hashlib.sha256(made).hexdigest())
