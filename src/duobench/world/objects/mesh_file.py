"""Objects from files of meshes: STL, OBJ and GLB.

A mesh is prepared once, with trimesh and CoACD of the extra `objects`: its convex parts, and what
is rendered. That lies beside it, as `mug.stl.parts.json`, and episodes read nothing else, since a
decomposition may differ from one processor to the next.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import (
    AssetError,
    DuoBenchError,
    FileError,
    TaskError,
    check_known,
)
from duobench.core.files import (
    digest_of,
    encode,
    held,
    read,
    write,
)
from duobench.core.machine import load_extra
from duobench.core.types import LONGEST, Array
from duobench.world.objects.blocks import WHITE
from duobench.world.objects.prop import Prop
from duobench.world.objects.shapes import Colour, hull
from duobench.world.objects.solid import (
    Image,
    Mesh,
    Solid,
    Texture,
    hull_of,
    manifold_from,
    mesh_of,
)

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

UNITS = {"mm": 0.001, "cm": 0.01, "m": 1.0, "in": 0.0254}
"""Metres in each unit that a mesh may have."""
SMALLEST = 0.002
"""Smallest length of an object in metres: what is smaller was given in another unit."""
MOST_MASS = 20.0
"""Largest mass of an object in kg: what is larger was given in grams."""
MOST_BYTES, MOST_TRIANGLES = 64_000_000, 100_000
"""Largest mesh."""
MOST_AROUND = 1_000
"""Most triangles with one corner; the time for normals grows with the square."""
MOST_TEXELS = 1024
"""Longest edge of a texture; larger images are reduced."""
ENDING = ".parts.json"
"""Ending of the prepared mesh, after the name of the file."""
CONCAVITY = 0.03
"""How far convex parts may stand out [CoACD]: they keep a mug's wall of 4 mm."""
MOST_CORNERS = 256
"""Most corners of a convex part."""
_SCHEMA = 1
_DIGITS = 5
"""Digits to which vertices count, of the longest edge."""
_FLAT = 1e-5
"""Share of the longest edge up to which something is flat."""
_HEADER, _TRIANGLE = 84, 50
"""Bytes of a binary STL before its triangles, and of each [STL]."""
_WAIT_S = 1800.0
_NEEDED = "Preparing a mesh needs trimesh and CoACD"

Point = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True, slots=True)
class RenderedFaces:
    """What is rendered in one colour or with one texture."""

    faces: tuple[tuple[int, int, int], ...]
    rgba: Colour
    corners: tuple[tuple[float, float], ...] = ()
    """Texture coordinates, if it has them; see `Texture`."""
    texture: bytes = b""
    """The texture as a PNG, if it has one."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PreparedMesh:
    """A mesh as it lies beside its file, in the file's axes and units."""

    CHECKED_FROM: ClassVar[int] = 1
    files: dict[str, str]
    """SHA-256 of each file that it was made of, by its name."""
    concavity: float
    vertices: tuple[Point, ...]
    surfaces: tuple[RenderedFaces, ...]
    parts: tuple[tuple[Point, ...], ...]
    """Corners of each convex part."""


def mesh_object(
    file: str | Path,
    *,
    name: str | None = None,
    mass: float | None = None,
    units: str | None = None,
    up: str | None = None,
    rgba: Colour | None = None,
    texture: str | Path | None = None,
    fixed: bool = False,
) -> Prop:
    """Return an object made of a mesh; its frame is at the middle of its underside, z up.

    Args:
        file: STL, OBJ or GLB file; a relative path begins in the folder of the calling module.
        name: Name of the object; the file's without its ending by default.
        mass: Mass in kg; that of a solid print by default.
        units: Unit of the file: "mm", "cm", "m" or "in"; GLB is in metres.
        up: Axis of the file that points up, "y" or "z"; of GLB y, else z by default.
        rgba: Colour, in place of the file's colours and textures.
        texture: Image, in place of the file's textures.
        fixed: Whether it stands still wherever the layout puts it.

    Raises:
        TaskError: An argument does not fit; when it is built, the mesh does not.
        AssetError: There is no such file; when it is built, it cannot be read or prepared.
    """
    path = found(file, (".stl", ".obj", ".glb"))
    is_glb = path.suffix.lower() == ".glb"
    if units is None and not is_glb:
        raise TaskError(
            f"{path.name} does not say its unit: give one, such as units='mm'."
        )
    check_known("unit", units or "m", UNITS)
    check_known("axis", up or "z", ("y", "z"))
    solid = partial(
        _solid,
        path,
        mass=mass,
        units=units or "m",
        is_y_up=(up or ("y" if is_glb else "z")) == "y",
        rgba=rgba,
        texture=None if texture is None else found(texture),
    )
    return Prop(name=name or path.stem, solid=solid, fixed=fixed)


def found(file: str | Path, kinds: tuple[str, ...] = ()) -> Path:
    """Absolute path of a file that the caller of the calling function names."""
    module = sys._getframe(2).f_globals.get("__file__")
    path = (Path(module).parent if module else Path()).absolute() / file
    if kinds and path.suffix.lower() not in kinds:
        raise TaskError(f"{path.name} ends in none of {', '.join(kinds)}.")
    if not path.is_file():
        raise AssetError(
            f"There is no file {path}; a relative path begins in the folder of the module that "
            "has it."
        )
    return path


def check_size(file: Path, points: Array, mass: float | None, units: str = "m") -> None:
    """Reject an object, by its points in metres and mass in kg, that was given in other units."""
    edge = float(np.ptp(points, axis=0).max())
    if not SMALLEST <= edge <= LONGEST:
        others = ", ".join(
            f"{edge / UNITS[units] * scale:.3g} m in {unit}"
            for unit, scale in UNITS.items()
        )
        raise TaskError(
            f"{file.name} is {edge:.4g} m long, read in {units}, and an object is {SMALLEST:g} to "
            f"{LONGEST:g} m long. It would be {others}."
        )
    is_mass = isinstance(mass, Real) and not isinstance(mass, bool)
    if mass is not None and not (is_mass and 0 < mass <= MOST_MASS):
        raise TaskError(
            f"The mass of {file.name} is in kg, above 0 and at most {MOST_MASS:g}; got {mass!r}."
        )


def _solid(
    file: Path,
    *,
    mass: float | None,
    units: str,
    is_y_up: bool,
    rgba: Colour | None,
    texture: Path | None,
) -> Solid:
    prepared = _prepared(file)

    def in_metres(points: Sequence[Point]) -> Array:
        x, y, z = UNITS[units] * np.array(points).T
        return np.column_stack([x, -z, y] if is_y_up else [x, y, z])

    vertices = in_metres(prepared.vertices)
    check_size(file, vertices, mass, units)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    origin = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    faces = [np.array(one.faces, dtype=np.int32) for one in prepared.surfaces]
    images = [
        _image(file, surface, Mesh(vertices - origin, each), rgba, texture)
        for surface, each in zip(prepared.surfaces, faces, strict=True)
    ]
    return Solid(
        shapes=tuple(
            hull((in_metres(part) - origin).tolist()) for part in prepared.parts
        ),
        rgba=images[0].rgba,
        mesh=_body(file, Mesh(vertices - origin, np.vstack(faces))),
        images=tuple(images),
        mass=mass,
    )


def _body(file: Path, mesh: Mesh) -> Mesh:
    """The body within a closed surface: the union of its shells, without hollows."""
    import manifold3d

    whole = manifold_from(mesh)
    if whole.status() != manifold3d.Error.NoError:
        raise AssetError(
            f"The surface of {file.name} has holes, or faces that meet at one edge otherwise than "
            "in pairs, so it has no volume to weigh and print; programs for printing close it."
        )
    shells = whole.decompose()
    if len(shells) == 1:
        return mesh
    filled, hollow = manifold3d.Manifold(), manifold3d.Manifold()
    for shell in shells:
        if shell.volume() > 0:
            filled += shell
        else:
            inside = mesh_of(shell)
            hollow += manifold_from(Mesh(inside.vertices, inside.faces[:, ::-1]))
    return mesh_of(filled - hollow)


def _image(
    file: Path,
    surface: RenderedFaces,
    mesh: Mesh,
    rgba: Colour | None,
    chosen: Path | None,
) -> Image:
    data = surface.texture if chosen is None else chosen.read_bytes()
    if rgba is not None or not data:
        return Image(mesh=mesh, rgba=rgba or surface.rgba)
    if not surface.corners:
        raise TaskError(f"{file.name} has no texture coordinates; give it `rgba`.")
    return Image(
        mesh=mesh,
        rgba=(1.0, 1.0, 1.0, 1.0),
        texture=Texture(
            texels=np.asarray(_picture(data, chosen or file)),
            corners=np.array(surface.corners, dtype=np.float32),
        ),
    )


def _picture(data: bytes, file: Path) -> Picture:
    from PIL import Image as Pillow

    try:
        with Pillow.open(io.BytesIO(data)) as picture:
            return _reduced(picture)
    except (OSError, SyntaxError, Pillow.DecompressionBombError) as error:
        raise AssetError(f"{file} is no image that can be read: {error}.") from error


def _reduced(picture: Picture) -> Picture:
    small = picture.convert("RGB")
    small.thumbnail((MOST_TEXELS, MOST_TEXELS))
    return small


# --- what lies beside the file ---


def _prepared(file: Path) -> PreparedMesh:
    """What lies beside a mesh; where that is missing, or of other files, it is made first."""
    path = file.with_name(file.name + ENDING)
    prepared = _saved(path)
    if prepared is not None:
        return prepared
    trimesh = load_extra("trimesh", "objects", _NEEDED, AssetError)
    coacd = load_extra("coacd", "objects", _NEEDED, AssetError)
    if not os.access(file.parent, os.W_OK):
        raise AssetError(
            f"{file} has no {path.name} beside it that fits, and nothing may be written there: "
            "prepare it elsewhere, and copy that file."
        )
    with held(file, wait_s=_WAIT_S):
        prepared = _saved(path)  # another process may have made it
        if prepared is None:
            prepared = _prepare(file, trimesh, coacd)
            write(path, encode(prepared, _SCHEMA))
    return prepared


def _saved(path: Path) -> PreparedMesh | None:
    try:
        prepared = read(path, PreparedMesh, _SCHEMA)
        now = {name: digest_of(path.parent / name) for name in prepared.files}
    except (FileError, OSError):
        return None
    is_same = prepared.files == now and prepared.concavity == CONCAVITY
    return prepared if is_same else None


class _Beside(dict[str, bytes]):
    """Files in a mesh's folder, read when trimesh asks for them."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.digests = {file.name: digest_of(file)}
        self.missing: list[str] = []
        self._folder = file.parent.resolve()

    def __missing__(self, name: str) -> bytes:
        name = name.strip().replace("\\", "/")
        path = (self._folder / name).resolve()
        if not path.is_relative_to(self._folder) or not path.is_file():
            self.missing.append(name)
            raise FileNotFoundError(name)
        data = _bytes_of(path)
        self.digests[name] = digest_of(path)
        return data

    def get(self, name: str, _default: object = None) -> bytes:
        """A file, as trimesh asks for a texture."""
        return self[name]


def _bytes_of(path: Path) -> bytes:
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise AssetError(
            f"{path.name} has {size / 1e6:.0f} MB, and may have {MOST_BYTES / 1e6:.0f}."
        )
    data = path.read_bytes()
    kind = path.suffix.lower()
    triangles = int.from_bytes(data[80:84], "little")
    is_text = kind == ".stl" and size != _HEADER + _TRIANGLE * triangles
    if is_text or kind in (".obj", ".mtl"):
        data = data.decode(errors="replace").encode()  # names in any encoding
    return data


def _prepare(file: Path, trimesh: Any, coacd: Any) -> PreparedMesh:
    data = _bytes_of(file)
    beside = _Beside(file)
    kind = file.suffix.lower().removeprefix(".")
    try:
        scene = trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=beside)
        vertices, surfaces = _surfaces(file, scene)
    except DuoBenchError:
        raise
    except Exception as error:
        # What reads bytes of others raises anything.
        raise AssetError(
            f"{file.name} is no valid {kind.upper()} file: {error!r:.200}."
        ) from error
    if beside.missing:
        raise AssetError(
            f"{file.name} refers to {', '.join(beside.missing)}, missing in its folder: put it "
            "there, or remove the reference."
        )
    faces = np.vstack([one.faces for one in surfaces]).astype(np.int32)
    body = _body(file, Mesh(vertices, faces))
    coacd.set_log_level("error")
    mesh = coacd.Mesh(body.vertices, body.faces)
    parts = coacd.run_coacd(
        mesh, threshold=CONCAVITY, decimate=True, max_ch_vertex=MOST_CORNERS, seed=0
    )
    size = np.ptp(vertices, axis=0)
    least = _FLAT**2 * size.prod()
    return PreparedMesh(
        files=beside.digests,
        concavity=CONCAVITY,
        vertices=_rows(vertices),
        surfaces=tuple(surfaces),
        parts=tuple(
            _rows(np.asarray(points).round(_decimals(size)))
            for points, _ in parts
            if hull_of(points).volume() > least
        ),
    )


def _decimals(size: Array) -> int:
    return _DIGITS - int(np.log10(size.max()))


def _rows(array: NDArray[Any]) -> tuple[Any, ...]:
    return tuple(map(tuple, array.tolist()))


def _surfaces(file: Path, scene: Any) -> tuple[Array, list[RenderedFaces]]:
    """Vertices of a scene, none of them twice, and its meshes, whose faces look outwards."""
    places = [scene.graph[node] for node in sorted(scene.graph.nodes_geometry)]
    placed = [(scene.geometry[key], pose) for pose, key in places]
    placed = [(mesh, pose) for mesh, pose in placed if hasattr(mesh, "faces")]
    count = sum(len(mesh.faces) for mesh, _ in placed)
    if not 0 < count <= MOST_TRIANGLES:
        raise AssetError(
            f"{file.name} has {count} triangles; an object has 1 to {MOST_TRIANGLES}."
        )
    meshes = [mesh.copy().apply_transform(pose) for mesh, pose in placed]
    points = np.vstack([mesh.vertices for mesh in meshes])
    size = np.ptp(points, axis=0)
    if not (np.isfinite(size).all() and size.min() > _FLAT * size.max()):
        edges = " x ".join(f"{edge:.4g}" for edge in size)
        raise AssetError(f"{file.name} is {edges} large: flat, or without numbers.")
    vertices, merged = np.unique(
        points.round(_decimals(size)), axis=0, return_inverse=True
    )
    merged = merged.ravel()
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)]).tolist()
    corners = np.vstack(
        [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    )
    owner = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
    is_whole = (merged[corners] != merged[np.roll(corners, 1, axis=1)]).all(axis=1)
    owner, corners = owner[is_whole], corners[is_whole]
    if np.bincount(merged[corners].ravel(), minlength=1).max() > MOST_AROUND:
        raise AssetError(
            f"{file.name} has more than {MOST_AROUND} triangles around a corner; remesh it."
        )
    faces = merged[corners].astype(np.int32)
    if manifold_from(Mesh(vertices, faces)).volume() < 0:
        corners = corners[:, ::-1]
    return vertices, [
        _surface(
            meshes[number].visual,
            corners[owner == number] - starts[number],
            merged[corners[owner == number]],
        )
        for number in np.unique(owner).tolist()
    ]


def _surface(visual: Any, corners: NDArray[Any], faces: NDArray[Any]) -> RenderedFaces:
    """What a mesh looks like, by its corners in rows of its own, and its faces."""
    material, places = getattr(visual, "material", None), getattr(visual, "uv", None)
    picture = getattr(material, "baseColorTexture", None)
    picture = picture or getattr(material, "image", None)
    stream = io.BytesIO()
    at_corners: tuple[Any, ...] = ()
    if places is not None:
        # The first row of a texture is its upper edge.
        at_corners = _rows((places * (1, -1) + (0, 1))[corners.ravel()].round(_DIGITS))
        if picture is not None:
            _reduced(picture).save(stream, "PNG")
    colour = WHITE
    if material is not None or visual.defined:
        red, green, blue, _ = ((material or visual).main_color / 255).tolist()
        colour = red, green, blue, 1.0
    return RenderedFaces(
        faces=_rows(faces),
        rgba=colour,
        corners=at_corners,
        texture=stream.getvalue(),
    )
