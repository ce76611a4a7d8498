"""What a prop prints: each of its parts, on its own."""

from duobench.tasks import catalog


def test_a_prop_prints_its_parts() -> None:
    (chest,) = (prop for prop in catalog.get("hinge_chest").props if prop.parts)
    solids = chest.prints({})
    assert solids == (chest.solid, *(part.solid for part in chest.parts))
    assert len(solids) > 1
