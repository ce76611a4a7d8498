"""A prop builds its solids when they are asked for, and prints those of a layout."""

import pytest

from duobench.core.errors import UnknownNameError
from duobench.world.objects import RED, Part, Prop, Solid, Variant, cube
from duobench.world.sim.simulation import Simulation


def test_a_solid_is_built_once_when_it_is_first_read() -> None:
    built: list[Solid] = []

    def build() -> Solid:
        built.append(cube(RED))
        return built[-1]

    prop = Prop(name="box", solid=build, parts=(Part(name="lid", solid=build),))
    assert not built
    assert prop.solid is prop.solid is built[0]
    assert prop.prints({}) == (built[0], built[1])
    assert len(built) == 2


def test_the_root_is_printed_as_the_layouts_variant_has_it() -> None:
    whole, other = cube(RED), cube(RED)
    variants = {"whole": Variant(), "other": Variant(printed=other)}
    prop = Prop(name="box", solid=whole, choice="kind", variants=lambda: variants)
    assert prop.prints({"kind": "whole"}) == (whole,)
    assert prop.prints({"kind": "other"}) == (other,)
    with pytest.raises(UnknownNameError, match="'other'"):
        prop.prints({"kind": "othr"})


def test_a_single_box_is_its_own_image() -> None:
    variants = {"here": Variant(), "gone": Variant(without_images=frozenset({0}))}
    simulation = Simulation([Prop(name="box", solid=cube(RED), choice="it", variants=variants)])
    opacity = {}
    for value in variants:
        simulation.choose({"it": value})
        opacity[value] = simulation.model.geom("box:0").rgba[3]
    assert opacity == {"here": 1.0, "gone": 0.0}
