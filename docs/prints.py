"""Draw the printed parts of every task, and how they go together; write the page about them.

Part of `make docs`. `python docs/prints.py --out images` draws into another folder.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np
import PIL.Image
from prints_page import DRAWN, FOLDER, JOBS, digest, job, together_file

from duobench.core.spatial import SE3
from duobench.printing import PrintJob, lay_out
from duobench.printing.formats import BED_STEP
from duobench.tasks import catalog
from duobench.world.objects import Solid, chest as chests, cylinder, mesh_of, pieces_of
from duobench.world.objects.joint_blocks import BAR, PEG_HEIGHT
from duobench.world.objects.shapes import PRINTER, Colour
from duobench.world.objects.solid import Mesh, manifold_from, manifold_of, placed
from duobench.world.scene.meshes import add_visual_mesh
from duobench.world.sim.rendering import Renderer

DRAWER = Path(__file__).parent / "tasks"
"""Where the page is."""
SIZE = (440, 720)
"""Height and width of a picture in pixels."""
SAMPLES = 16
QUALITY = 82
FIELD_OF_VIEW = 30.0
BED_COLOUR, TABLE_COLOUR = (0.55, 0.57, 0.60, 1.0), (0.86, 0.86, 0.87, 1.0)
STEEL = (0.70, 0.71, 0.73, 1.0)
BED_THICKNESS = 0.004
FROM = (-0.45, -1.0, 0.75)
"""Direction in which the camera stands."""

Drawn = tuple[Mesh, Colour]


def on_beds(what: PrintJob) -> Iterator[Drawn]:
    """Return the parts of a job as they lie, with the beds."""
    spots = lay_out(what.parts)
    for bed in sorted({spot.bed for spot in spots}):
        middle = SE3.at(bed * BED_STEP + PRINTER / 2, PRINTER / 2, -BED_THICKNESS / 2)
        yield moved(plate(PRINTER, PRINTER, BED_THICKNESS), middle), BED_COLOUR
    for spot in spots:
        at = SE3.at(spot.x + spot.bed * BED_STEP, spot.y)
        yield moved(spot.part.mesh, at), spot.part.rgba


def together(name: str) -> Iterator[Drawn]:
    """Return the parts of a task as they go together, a little apart; nothing for most tasks."""
    task = catalog.get(name)
    solids = {
        prop.name: prop.prints({prop.choice or "": "0"})
        for prop in task.props
        if name in APART
    }
    if name == "hinge_chest":
        box, lid = solids["chest"]
        hinge = SE3.at(*chests.HINGE)
        yield from pieces(box, (SE3(),))
        yield from pieces(lid, (hinge.moved(z=0.06) @ SE3.about((0, 1, 0), 0.5),))
        for sign in (-1, 1):
            at = hinge.moved(y=sign * 0.165) @ SE3.about((1, 0, 0), math.pi / 2)
            head = at.moved(y=sign * 0.0115)
            yield mesh_of(manifold_of(cylinder(0.0015, 0.020, at=at))), STEEL
            yield mesh_of(manifold_of(cylinder(0.00275, 0.003, at=head))), STEEL
    elif name == "ball_maze":
        (board,), (ball,) = solids["board"], solids["ball"]
        below = [SE3.at(z=-0.05)] * (len(board.pieces) - 2)
        yield from pieces(board, (SE3(), SE3.at(z=0.07), *below))
        yield from pieces(ball, (SE3.at(-0.08, 0.08, 0.13),))
    elif name == "transfer_gate":
        (gate,) = solids["gate"]
        yield from pieces(gate, (SE3(), SE3.at(z=0.05), SE3.at(z=0.10)))
    elif name == "join_blocks":
        (light,), (dark,), (wall,) = (
            solids[k] for k in ("light_block", "dark_block", "wall")
        )
        step = BAR[0] + 0.040
        yield from pieces(light, (SE3.at(-2 * step, 0.0, PEG_HEIGHT),))
        yield from pieces(dark, (SE3.at(-step, 0.0, PEG_HEIGHT),))
        yield from pieces(wall, (SE3(),))
    elif name == "transfer_reorient":
        (peg,), (board,) = solids["peg"], solids["board"]
        upright = SE3.at(-0.06, 0.0, 0.12) @ SE3.about((0, 1, 0), -math.pi / 2)
        turned = upright @ SE3.about((1, 0, 0), math.pi / 2)
        yield from pieces(peg, (turned,))
        yield from pieces(board, (SE3(),))


APART = (
    "hinge_chest",
    "ball_maze",
    "join_blocks",
    "transfer_gate",
    "transfer_reorient",
)
"""Tasks of which parts go together."""


def pieces(solid: Solid, poses: Sequence[SE3]) -> Iterator[Drawn]:
    """Return the pieces of a solid in their colours, each at a pose."""
    for number, (mesh, pose) in enumerate(zip(pieces_of(solid), poses, strict=True)):
        own = solid.pieces[number].rgba if solid.pieces else None
        yield moved(mesh, pose), own or solid.rgba


def plate(x: float, y: float, z: float) -> Mesh:
    """Return a plate around the origin."""
    import manifold3d

    return mesh_of(manifold3d.Manifold.cube((x, y, z), True))


def moved(mesh: Mesh, pose: SE3) -> Mesh:
    """Return a mesh at a pose."""
    return mesh_of(placed(manifold_from(mesh), pose))


def render(drawn: Sequence[Drawn], *, stands: bool) -> np.ndarray:
    """Return an image of meshes from the front, on a table if they stand on one."""
    points = np.vstack([mesh.vertices for mesh, _ in drawn])
    low, high = points.min(axis=0), points.max(axis=0)
    middle, radius = (low + high) / 2, np.linalg.norm(high - low) / 2
    spec = mujoco.MjSpec()
    spec.stat.center, spec.stat.extent = middle, 2 * radius
    spec.visual.headlight.ambient = (0.45, 0.45, 0.46)
    spec.visual.headlight.diffuse = (0.0, 0.0, 0.0)
    spec.visual.headlight.specular = (0.0, 0.0, 0.0)
    for eye, light, shadow in (
        ((-0.5, -0.9, 1.8), 0.5, True),
        ((1.0, -0.4, 0.6), 0.2, False),
    ):
        spec.worldbody.add_light(
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            pos=middle + 4 * radius * np.array(eye),
            dir=-np.array(eye),
            diffuse=(light, light, light),
            specular=(0.1, 0.1, 0.1),
            castshadow=shadow,
        )
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=(10.0, 10.0, 0.1),
        pos=(0.0, 0.0, low[2] - (0.0005 if stands else 0.0)),
        rgba=TABLE_COLOUR,
    )
    for number, (mesh, rgba) in enumerate(drawn):
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=add_visual_mesh(spec, f"mesh{number}", mesh),
            rgba=rgba,
            contype=0,
            conaffinity=0,
        )
    back = np.array(FROM) / np.linalg.norm(FROM)
    across = np.cross((0.0, 0.0, 1.0), back)
    across /= np.linalg.norm(across)
    up = np.cross(back, across)
    half = math.tan(math.radians(FIELD_OF_VIEW) / 2)
    aspect = SIZE[1] / SIZE[0]
    away = points - middle
    needed = np.maximum(
        np.abs(away @ up) / half, np.abs(away @ across) / (half * aspect)
    )
    distance = 1.06 * float((needed + away @ back).max())
    spec.worldbody.add_camera(
        name="camera",
        pos=middle + distance * back,
        xyaxes=(*across, *up),
        fovy=FIELD_OF_VIEW,
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with Renderer(model, height=SIZE[0], width=SIZE[1], samples=SAMPLES) as renderer:
        return renderer.render(data, "camera")


def save(image: np.ndarray, path: Path) -> None:
    """Write an image as JPEG."""
    path.parent.mkdir(parents=True, exist_ok=True)
    PIL.Image.fromarray(image).save(
        path, quality=QUALITY, optimize=True, progressive=True
    )


def main() -> None:
    """Draw all pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=DRAWER / FOLDER)
    out: Path = parser.parse_args().out
    for name in JOBS:
        if job(name).parts:
            save(render(list(on_beds(job(name))), stands=True), out / f"{name}.jpg")
        if name in APART:
            save(render(list(together(name)), stands=True), out / together_file(name))
    (out / DRAWN).write_text(
        json.dumps({name: digest(job(name)) for name in JOBS}, indent=1) + "\n",
        encoding="utf-8",
    )


if __name__ == "__main__":
    main()
