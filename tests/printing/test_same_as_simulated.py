"""The printed object is the simulated one: volume and mass, against the compiled model."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import manifold3d
import mujoco
import numpy as np
import pytest

from duobench.core.spatial import SE3
from duobench.envs.sim_env import SimEnv
from duobench.printing import neutral_layout
from duobench.tasks import catalog
from duobench.world.objects.solid import placed
from tests.printing.printed import TASKS, as_read, belongs, job

NEAR = 0.02
"""Share by which volume and mass may differ."""
SEGMENTS = 256


@cache
def model_of(name: str, variant: str) -> mujoco.MjModel:
    """The model of a task as it is stepped, with a variant of its objects."""
    env = SimEnv(catalog.get(name))
    layout = neutral_layout(catalog.get(name))
    if variant:
        layout = catalog.get(name).arranged(replace(layout, variants={"board": variant}))
    env.simulation.apply(layout)
    return env.simulation.model


def solid_of(model: mujoco.MjModel, geom: int) -> manifold3d.Manifold:
    """What a geom takes up, in the frame of its body."""
    m, (x, y, z) = manifold3d.Manifold, model.geom_size[geom].tolist()
    kind = mujoco.mjtGeom(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        local = m.cube((2 * x, 2 * y, 2 * z), True)
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        local = m.cylinder(2 * y, x, x, SEGMENTS, True)
    elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        local = m.sphere(x, SEGMENTS)
    else:
        mesh = model.geom_dataid[geom]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        local = m.hull_points(model.mesh_vert[first : first + count].astype(float).tolist())
    return placed(local, SE3.from_wxyz(model.geom_quat[geom], model.geom_pos[geom]))


def collides(model: mujoco.MjModel, body: int) -> float:
    """Volume in m³ of what of a body collides."""
    geoms = [
        geom
        for geom in range(model.ngeom)
        if model.geom_bodyid[geom] == body
        and (model.geom_contype[geom] or model.geom_conaffinity[geom])
    ]
    solids = [solid_of(model, geom) for geom in geoms]
    return manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add).volume()


BODIES = [(name, mass.body) for name in TASKS for mass in job(name).masses]


def body_and_variant(label: str) -> tuple[str, str]:
    root, slash, rest = label.partition("/")
    stem, _, number = root.rpartition("_")
    return (stem + slash + rest, number) if number.isdigit() else (label, "")


@pytest.mark.parametrize(("name", "label"), BODIES)
def test_volume_and_mass_are_those_of_the_simulation(name: str, label: str) -> None:
    body, variant = body_and_variant(label)
    model = model_of(name, variant)
    simulated = model.body(body).id
    parts = [each for each in job(name).parts if belongs(each.body, label)]
    volume = sum(each.count * as_read(each).volume * 1e-9 for each in parts)
    assert volume == pytest.approx(collides(model, simulated), rel=NEAR)
    mass = sum(each.count * each.mass for each in parts)
    assert mass == pytest.approx(float(model.body_mass[simulated]), rel=NEAR)
    (weighed,) = (each.mass for each in job(name).masses if each.body == label)
    assert weighed == pytest.approx(float(model.body_mass[simulated]), rel=1e-9)


def test_all_bodies_of_the_printed_objects_are_compared() -> None:
    assert len(BODIES) == 3 + 1 + 2 + 11 + 4 + 3 + 2 + 3 + 2 + 4


def test_another_program_weighs_the_same() -> None:
    for name in TASKS:
        for each in job(name).parts:
            mesh = as_read(each)
            assert mesh.volume * 1e-9 * each.density == pytest.approx(each.mass, rel=1e-4)
            assert np.ptp(mesh.bounds, axis=0) == pytest.approx(1000 * each.size, abs=1e-3)
