"""Objects from files of meshes: STL, OBJ and GLB.

A mesh is prepared once, with trimesh and CoACD of the extra `objects`: convex parts that collide, a
closed mesh to weigh and print, images. That lies beside it, as `mug.stl.parts.npz` with the digests
of the files it is made of, and episodes read nothing else: a decomposition may differ from one
processor to the next. All of it is in the axes and units of the file.
"""

from __future__ import annotations

import io
import os
import sys
import zipfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from duobench.core.errors import AssetError, DuoBenchError, TaskError, check_known
from duobench.core.files import digest_of, held, write, zipped
from duobench.core.machine import load_extra
from duobench.core.types import LONGEST, Array
from duobench.world.objects.prop import Prop
from duobench.world.objects.shapes import Colour, hull
from duobench.world.objects.solid import Image, Mesh, Solid, Texture, manifold_from, mesh_of

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

UNITS = {"mm": 0.001, "cm": 0.01, "m": 1.0, "in": 0.0254}
"""Metres in each unit that a mesh may have."""
SMALLEST = 0.002
"""Smallest length of an object in metres: what is smaller was given in another unit."""
MOST_MASS = 20.0
"""Largest mass of an object in kg: what is larger was given in grams."""
SAVED = ".parts.npz"
"""Ending of the prepared mesh, after the name of the file."""

CONCAVITY = 0.03
"""How far parts may stand out, as CoACD measures it: a mug's wall of 4 mm stays one."""
RECIPE = f"1: CoACD, concavity {CONCAVITY}, seed 0"
"""Steps that make what is saved, and their numbers."""
MOST_BYTES = 64_000_000
"""Largest file, in bytes."""
MOST_TRIANGLES = 100_000
MOST_PAIRS = 20_000_000
"""Most pairs of triangles with a corner in common, which decide what normals cost."""
MOST_TEXELS = 1024
"""Longest edge of a texture; larger images are reduced."""
MOST_PIXELS = 64_000_000
"""Most pixels of an image."""
WHITE = (0.95, 0.95, 0.95, 1.0)
"""Colour of a mesh without one."""
_SAME = 1e-6
"""Vertices closer than this share of the longest edge are one."""
_FLAT = 1e-5
"""Share of the longest edge up to which something is flat."""
_WAIT_S = 1800.0
_NEEDED = "Preparing a mesh needs trimesh and CoACD"

Content = dict[str, NDArray[Any]]
"""Arrays that are saved. For each image, by its number from 0: `faces0` of `vertices`, `rgba0`,
`corners0` (see `Texture`), `texels0`; empty without a texture. `closed_faces` of `closed_vertices`
are empty for an open mesh. `points` of all parts, `counts` of each."""


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
        mass: Mass in kg; that of a solid print by default. An open mesh needs one.
        units: Unit of the file: "mm", "cm", "m" or "in"; GLB is in metres.
        up: Axis of the file that points up, "y" or "z"; of GLB y, else z by default.
        rgba: Colour, in place of the file's colours and textures.
        texture: Image, in place of the file's colours and textures.
        fixed: Whether it stands still wherever the layout puts it.

    Raises:
        TaskError: An argument does not fit, or later the mesh does not.
        AssetError: There is no such file, or later it cannot be read or prepared.
    """
    path = found(file, (".stl", ".obj", ".glb"))
    is_glb = path.suffix.lower() == ".glb"
    if units is None and not is_glb:
        raise TaskError(
            f"{path.name} does not say its unit: give one, such as units='mm' for millimetres."
        )
    check_known("unit", units or "m", UNITS)
    check_known("axis", up or "z", ("y", "z"))
    if mass is not None:
        check_mass(path, mass)
    solid = partial(
        _solid,
        path,
        mass=mass,
        units=units or "m",
        up=up or ("y" if is_glb else "z"),
        rgba=rgba,
        texture=None if texture is None else found(texture),
    )
    return Prop(name=name or path.stem, solid=solid, fixed=fixed)


def found(file: str | Path, kinds: tuple[str, ...] = ()) -> Path:
    """The absolute path of what the caller of the calling function names, of some endings."""
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


def check_mass(file: Path, mass: float) -> None:
    """Reject a mass in another unit."""
    if not 0 < mass <= MOST_MASS:
        raise TaskError(
            f"The mass of {file.name} is in kg, above 0 and at most {MOST_MASS:g}; got {mass!r}."
        )


def check_length(file: Path, length: float, units: str = "m") -> None:
    """Reject a length in metres that only another unit makes sense of."""
    lengths = {unit: length / UNITS[units] * scale for unit, scale in UNITS.items()}
    fitting = [unit for unit, one in lengths.items() if SMALLEST <= one <= LONGEST]
    if units not in fitting:
        raise TaskError(
            f"{file.name} is {length:.4g} m long, read in {units}; objects are {SMALLEST:g} to "
            f"{LONGEST:g} m long. "
            + ", ".join(f"In {unit} it is {lengths[unit]:.3g} m" for unit in fitting)
        )


def _solid(
    file: Path,
    *,
    mass: float | None,
    units: str,
    up: str,
    rgba: Colour | None,
    texture: Path | None,
) -> Solid:
    content = prepared(file)

    def turned(points: NDArray[Any]) -> Array:
        x, y, z = points.T.astype(np.float64) * UNITS[units]
        return np.column_stack([x, -z, y] if up == "y" else [x, y, z])

    vertices = turned(content["vertices"])
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    check_length(file, float((high - low).max()), units)
    origin = (low + high) / 2
    origin[2] = low[2]
    is_open = not len(content["closed_faces"])
    if is_open and mass is None:
        raise TaskError(
            f"The surface of {file.name} is open, so it has no volume to weigh: close it, or give "
            "`mass` in kg; it is then weighed and printed as its convex parts."
        )
    images = [
        _image(content, number, vertices - origin, rgba, texture)
        for number in range(int(content["images"]))
    ]
    points = turned(content["points"]) - origin
    return Solid(
        shapes=tuple(
            hull(part.tolist()) for part in np.split(points, content["counts"].cumsum()[:-1])
        ),
        rgba=images[0].rgba,
        mesh=None
        if is_open
        else Mesh(turned(content["closed_vertices"]) - origin, content["closed_faces"]),
        images=tuple(images),
        mass=mass,
    )


def _image(
    content: Content, number: int, vertices: Array, rgba: Colour | None, texture: Path | None
) -> Image:
    corners, texels = (content[f"{key}{number}"] for key in ("corners", "texels"))
    if texture is not None:
        if not len(corners):
            raise TaskError(f"The mesh has no texture coordinates for {texture.name}; give `rgba`.")
        texels = _opened(texture)
    is_textured = texels.size > 0 and rgba is None
    own = (1.0, 1.0, 1.0, 1.0) if is_textured else tuple(content[f"rgba{number}"].tolist())
    return Image(
        mesh=Mesh(vertices, content[f"faces{number}"]),
        rgba=rgba or own,
        texture=Texture(texels=texels, corners=corners) if is_textured else None,
    )


def _opened(file: Path) -> NDArray[np.uint8]:
    from PIL import Image as Pillow

    try:
        with Pillow.open(file) as picture:
            return _texels(picture)
    except OSError as error:
        raise AssetError(f"{file} cannot be read as an image: {error}.") from error


def _texels(picture: Picture) -> NDArray[np.uint8]:
    width, height = picture.size
    if width * height > MOST_PIXELS:
        raise AssetError(
            f"An image has {width} x {height} pixels; reduce it to {MOST_TEXELS} x {MOST_TEXELS}."
        )
    small = picture.convert("RGB")
    small.thumbnail((MOST_TEXELS, MOST_TEXELS))
    return np.asarray(small)


# --- what is saved beside the file ---


def prepared(file: Path) -> Content:
    """What is saved beside a mesh; where it is missing, or of other files, it is made first.

    Raises:
        AssetError: It is neither there, nor can it be made.
    """
    content = _saved(file)
    if content is not None:
        return content
    trimesh = load_extra("trimesh", "objects", _NEEDED, AssetError)
    coacd = load_extra("coacd", "objects", _NEEDED, AssetError)
    if not os.access(file.parent, os.W_OK):
        raise AssetError(
            f"The convex parts of {file.name} cannot be saved beside it: nothing may be written "
            f"into {file.parent}. Prepare it elsewhere, and bring {file.name}{SAVED} along."
        )
    with held(file, wait_s=_WAIT_S):
        content = _saved(file)  # another process may have made it
        if content is None:
            content = {key: np.asarray(value) for key, value in _made(file, trimesh, coacd).items()}
            entries = {f"{key}.npy": _npy(value) for key, value in content.items()}
            write(file.with_name(file.name + SAVED), zipped(entries, zipfile.ZIP_DEFLATED))
    return content


def _npy(array: NDArray[Any]) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=False)
    return stream.getvalue()


def _saved(file: Path) -> Content | None:
    """What is saved beside a mesh; None if it is missing, damaged, or of other files."""
    path = file.with_name(file.name + SAVED)
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(each.file_size for each in archive.infolist()) > 4 * MOST_BYTES:
                return None
        with np.load(path, allow_pickle=False) as saved:
            content = dict(saved)
        here = [digest_of(file.parent / name) for name in content["files"].tolist()]
        is_ours = str(content["recipe"]) == RECIPE and here == content["digests"].tolist()
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    return content if is_ours else None


class _Beside:
    """Files that a mesh refers to, in its folder: a resolver, as trimesh calls it."""

    def __init__(self, file: Path) -> None:
        self.file_name = file.name
        self.names = [file.name]
        self.missing: list[str] = []
        self._folder = file.parent

    def __getitem__(self, key: str) -> bytes:
        name = str(key).strip().replace("\\", "/")
        path = (self._folder / name).resolve()
        if not path.is_relative_to(self._folder.resolve()) or not path.is_file():
            self.missing.append(name)
            raise FileNotFoundError(name)
        self.names.append(name)
        return _read(path)

    get = __getitem__


def _read(path: Path) -> bytes:
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise AssetError(
            f"{path.name} has {size / 1e6:.0f} MB, and a mesh has {MOST_BYTES / 1e6:.0f} MB at most."
        )
    return path.read_bytes()


def _made(file: Path, trimesh: Any, coacd: Any) -> Content:
    """What is saved beside a mesh."""
    beside = _Beside(file)
    kind = file.suffix.lower().removeprefix(".")
    stream = io.BytesIO(_read(file))
    try:
        scene = trimesh.load_scene(stream, file_type=kind, resolver=beside)
        content = _images(file, _meshes(file, scene), trimesh)
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
    faces = np.vstack([content[f"faces{number}"] for number in range(content["images"])])
    surface = Mesh(content["vertices"].astype(np.float64), faces)
    closed = _closed(surface)
    parts = _parts(surface if closed is None else closed, coacd)
    if not parts:
        raise AssetError(f"{file.name} is flat, or all of its parts are.")
    return content | {
        "recipe": np.array(RECIPE),
        "files": np.array(beside.names),
        "digests": np.array([digest_of(file.parent / name) for name in beside.names]),
        "closed_vertices": np.empty((0, 3)) if closed is None else closed.vertices,
        "closed_faces": np.empty((0, 3), np.int32) if closed is None else closed.faces,
        "points": np.vstack(parts),
        "counts": np.array([len(part) for part in parts]),
    }


def _meshes(file: Path, scene: Any) -> list[Any]:
    """The meshes of a scene, each at its place; points and lines are left out."""
    places = [scene.graph[node] for node in scene.graph.nodes_geometry]
    meshes = [(scene.geometry[name], pose) for pose, name in places]
    meshes = [(mesh, pose) for mesh, pose in meshes if hasattr(mesh, "faces")]
    triangles = sum(len(mesh.faces) for mesh, _ in meshes)
    if not 0 < triangles <= MOST_TRIANGLES:
        raise AssetError(
            f"{file.name} has {triangles} triangles; an object has 1 to {MOST_TRIANGLES}."
        )
    return [mesh.copy().apply_transform(pose) for mesh, pose in meshes]


def _images(file: Path, meshes: list[Any], trimesh: Any) -> dict[str, Any]:
    """The images of meshes, whose vertices at one place are one, and whose faces look outwards."""
    counts = [len(mesh.vertices) for mesh in meshes]
    starts = np.cumsum(counts) - counts
    vertices, one = _merged(file, np.vstack([mesh.vertices for mesh in meshes]))
    owners = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
    apart = np.vstack([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)])
    is_whole = (one[apart] != one[np.roll(apart, 1, axis=1)]).all(axis=1)
    owners, apart = owners[is_whole], apart[is_whole]
    body = trimesh.Trimesh(vertices, one[apart], process=False)
    if not body.is_winding_consistent:
        trimesh.repair.fix_normals(body, multibody=True)
    if body.volume < 0:
        body.invert()
    is_turned = body.faces[:, 0] != one[apart][:, 0]
    apart[is_turned] = apart[is_turned][:, ::-1]
    around = np.bincount(one[apart].ravel()).astype(np.int64)
    if (around * around).sum() > MOST_PAIRS:
        raise AssetError(
            f"{file.name} has a corner with {around.max()} triangles; remesh it evenly."
        )
    content: dict[str, Any] = {"vertices": vertices.astype(np.float32)}
    used = np.unique(owners).tolist()
    for number, owner in enumerate(used):
        faces = apart[owners == owner]
        surface = _surface(meshes[owner].visual, faces.ravel() - starts[owner])
        content[f"faces{number}"] = one[faces].astype(np.int32)
        content |= {f"{key}{number}": value for key, value in surface.items()}
    return content | {"images": np.array(len(used))}


def _merged(file: Path, points: Array) -> tuple[Array, NDArray[np.intp]]:
    """Vertices without those at the place of another one, and the row there of each point."""
    with np.errstate(over="ignore"):
        points = points.astype(np.float32).astype(np.float64)
    size = np.ptp(points, axis=0)
    if not np.isfinite(size).all():
        raise AssetError(f"{file.name} has coordinates that are no numbers.")
    if not size.min() > _FLAT * size.max():
        raise AssetError(f"{file.name} is flat: {' x '.join(f'{edge:g}' for edge in size)}.")
    cells = np.rint((points - points.min(axis=0)) / (_SAME * size.max()))
    _, first, rows = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    return points[first], rows.ravel()


def _surface(visual: Any, corners: NDArray[np.intp]) -> dict[str, Any]:
    """Colour, texture coordinates and texture of a mesh, at some of its vertices."""
    material = getattr(visual, "material", None)
    colour, coordinates = WHITE, getattr(visual, "uv", None)
    if material is not None:
        colour = material.main_color / 255
    elif visual.defined:
        colour = visual.main_color / 255
    texels = np.empty(0, np.uint8)
    picture = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if picture is not None and coordinates is not None:
        texels = _texels(picture)
    # The first row of a texture is its upper edge.
    upright = np.empty((0, 2)) if coordinates is None else coordinates * (1, -1) + (0, 1)
    return {
        "rgba": np.array([*colour[:3], 1.0]),
        "corners": (upright[corners] if len(upright) else upright).astype(np.float32),
        "texels": texels,
    }


def _closed(mesh: Mesh) -> Mesh | None:
    """The body within a surface: of shells that overlap the union, without hollows. None if open."""
    import manifold3d

    body = manifold_from(mesh)
    if body.status() != manifold3d.Error.NoError or not body.volume() > 0:
        return None
    shells = body.decompose()
    if len(shells) == 1:
        return mesh
    bodies = [shell for shell in shells if shell.volume() > 0]
    hollows = [mesh_of(shell) for shell in shells if shell.volume() < 0]
    turned = [manifold_from(Mesh(one.vertices, one.faces[:, ::-1])) for one in hollows]
    add = manifold3d.OpType.Add
    union = manifold3d.Manifold.batch_boolean
    return mesh_of(union(bodies, add) - union(turned, add))


def _parts(mesh: Mesh, coacd: Any) -> list[NDArray[np.float32]]:
    """Corners (n, 3) of each convex part, but for flat ones."""
    import manifold3d

    coacd.set_log_level("error")
    parts = coacd.run_coacd(
        coacd.Mesh(mesh.vertices, mesh.faces), threshold=CONCAVITY, seed=0
    )
    least = _FLAT**2 * np.ptp(mesh.vertices, axis=0).prod()
    return [
        np.asarray(points, np.float32)
        for points, _ in parts
        if manifold3d.Manifold.hull_points(points).volume() > least
    ]
