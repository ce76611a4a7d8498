"""Mass, centre and inertia of every solid of the benchmark, against those of another library."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from duobench.tasks import catalog
from duobench.world.objects.prop import Prop
from duobench.world.objects.solid import MassProperties, Mesh, mass_properties, printable

PROPS = [
    pytest.param(prop, id=f"{name}: {prop.name}")
    for name in catalog.names()
    for prop in catalog.get(name).props
    if not prop.name.startswith("marble") or prop.name == "marble0"
]


@pytest.mark.parametrize("prop", PROPS)
def test_mass_properties_agree_with_another_library(prop: Prop) -> None:
    for solid in (prop.solid, *(part.solid for part in prop.parts)):
        mesh = printable(solid)
        body = trimesh.Trimesh(vertices=mesh.vertices, faces=mesh.faces, process=False)
        found: MassProperties = mass_properties(solid)
        density = solid.density if solid.mass is None else solid.mass / body.volume
        size = float(np.ptp(mesh.vertices, axis=0).max())
        assert found.mass == pytest.approx(body.volume * density, rel=1e-12)
        assert found.centre == pytest.approx(body.center_mass, abs=1e-12 * size)
        inertia = body.moment_inertia * density
        assert found.inertia == pytest.approx(inertia, abs=1e-12 * found.mass * size**2)


def test_the_order_of_triangles_does_not_matter() -> None:
    chest = catalog.get("hinge_chest").props[1].solid
    mesh = printable(chest)
    other = replace(chest, mesh=Mesh(vertices=mesh.vertices, faces=mesh.faces[::-1].copy()))
    one, two = mass_properties(chest), mass_properties(other)
    assert one.mass == two.mass
    assert np.array_equal(one.centre, two.centre)
    assert np.array_equal(one.inertia, two.inertia)
