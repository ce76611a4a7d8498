"""Objects from MJCF: one body with hinged parts; what would change the world is refused."""

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image as Pillow

from duobench.core.errors import AssetError, DuoBenchError, TaskError
from duobench.core.spatial import SE3
from duobench.tasks import Prop, mjcf_object
from duobench.world.objects import mass_properties
from duobench.world.objects.prop import digest_of
from duobench.world.scene.compose import compose
from duobench.world.sim.layout import Layout
from duobench.world.sim.simulation import Simulation

GEOM = '<geom type="box" size=".02 .02 .02"/>'
LID = """<body name="lid" pos="0 0 .03"><joint axis="0 1 0" range="0 60" {}/>
<geom type="box" size=".02 .02 .005"/>{}</body>"""


def file(
    folder: Path, body: str, before: str = "", *, world: str = "", name: str = "thing"
) -> Path:
    path = folder / f"{name}.xml"
    path.write_text(
        f'<mujoco>{before}<worldbody>{world}<body name="top" pos="1 2 3">{body}</body></worldbody>'
        "</mujoco>",
        encoding="utf-8",
    )
    return path


CHEST = """
<freejoint/>
<geom type="box" size="0.06 0.05 0.003" pos="0 0 0.003" mass="0.1" rgba="1 0 0 1"/>
<site name="mark"/>
<body pos="0 0 0.006">
  <geom type="mesh" mesh="deco" material="skin" contype="0" conaffinity="0" mass="0"/>
  <geom type="cylinder" size="0.01 0.02" pos="0 0 0.02" group="3" mass="0.05"/>
</body>
<body name="lid" pos="0 0 0.06" euler="0 0 90">
  <joint axis="1 0 0" pos="0 -0.06 0" range="-10 100" damping="0.01" stiffness="0.2"/>
  <geom type="box" size="0.05 0.06 0.003" friction="0.9 0.01 0.001" condim="4"/>
  <geom type="capsule" fromto="-0.02 0.05 0.012 0.02 0.05 0.012" size="0.006"
        friction="0.9 0.01 0.001" condim="4"/>
</body>
"""
ASSETS = """
<asset>
  <texture name="skin" type="2d" file="skin.png"/><material name="skin" texture="skin"/>
  <mesh name="deco" file="parts/deco.obj"/>
</asset>
"""


@pytest.fixture
def chest(tmp_path: Path) -> Prop:
    (tmp_path / "parts").mkdir()
    box = trimesh.creation.box([0.02, 0.02, 0.02])
    lines = [f"v {x} {y} {z}" for x, y, z in box.vertices.tolist()]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1"]
    lines += [f"f {a}/1 {b}/2 {c}/3" for a, b, c in (box.faces + 1).tolist()]
    (tmp_path / "parts" / "deco.obj").write_text("\n".join(lines))
    Pillow.new("RGBA", (4, 2), "blue").save(tmp_path / "skin.png")
    return mjcf_object(file(tmp_path, CHEST, ASSETS, name="Truhe ü"), name="chest")


def test_bodies_become_solids(chest: Prop) -> None:
    (lid,) = chest.parts
    assert (chest.name, lid.name) == ("chest", "lid")
    assert [shape.kind for shape in chest.solid.shapes] == ["box", "cylinder"]
    assert [shape.kind for shape in lid.solid.shapes] == ["box", "cylinder", "sphere", "sphere"]
    assert chest.solid.friction == (0.6, 0.005, 0.0001)
    assert (lid.solid.friction, lid.solid.condim) == ((0.9, 0.01, 0.001), 4)
    weighed = mass_properties(chest.solid)
    assert weighed.mass == pytest.approx(0.15)
    assert weighed.centre == pytest.approx([0, 0, (0.1 * 0.003 + 0.05 * 0.026) / 0.15])
    plain, deco = chest.solid.images
    assert plain.rgba == (1.0, 0.0, 0.0, 1.0)
    assert deco.texture is not None
    assert deco.texture.texels[0, 0].tolist() == [0, 0, 255]


def test_its_lid_turns_about_its_axis(chest: Prop) -> None:
    (lid,) = chest.parts
    assert lid.hinge is not None
    assert lid.hinge.limits == pytest.approx((np.radians(-10), np.radians(100)))
    assert (lid.hinge.stiffness, lid.hinge.damping) == (0.2, 0.01)
    assert lid.pose.translation == pytest.approx([0.06, 0, 0.06])
    sim = Simulation((chest,))
    sim.apply(Layout(poses={"chest": SE3.at(0.5, 0.1, 0.0)}, variants={}))
    model = sim.model
    sim.data.qpos[model.joint("chest/lid").qposadr[0]] = 0.5
    sim.forward()
    assert sim.angle("chest/lid") == 0.5
    assert model.body("chest/lid").mass[0] == pytest.approx(mass_properties(lid.solid).mass)
    centre = sim.data.body("chest/lid").xipos - sim.origin("chest/lid")
    assert np.hypot(centre[0], centre[2]) == pytest.approx(0.066, abs=0.004)
    assert centre[2] > 0.02  # it is open


def test_what_it_is_made_of_identifies_it(chest: Prop, tmp_path: Path) -> None:
    again = mjcf_object(tmp_path / "Truhe ü.xml", name="chest")
    assert digest_of((again,)) == digest_of((chest,))
    Pillow.new("RGBA", (4, 2), "green").save(tmp_path / "skin.png")
    os.utime(tmp_path / "skin.png", (2e9, 2e9))  # MuJoCo reads what is as old as before once
    other = mjcf_object(tmp_path / "Truhe ü.xml", name="chest")
    assert digest_of((other,)) != digest_of((chest,))


def test_a_mesh_collides_as_its_hull_and_is_rendered_as_it_is(tmp_path: Path) -> None:
    tube = trimesh.creation.annulus(0.02, 0.03, 0.04)
    tube.export(tmp_path / "tube.stl")
    asset = '<asset><mesh name="m" file="tube.stl"/></asset>'
    path = file(tmp_path, '<geom type="mesh" mesh="m" rgba="1 0 0 1"/>', asset)
    solid = mjcf_object(path).solid
    (hull,), (image,) = solid.shapes, solid.images
    assert hull.kind == "hull"
    assert np.ptp(hull.corners(), axis=0) == pytest.approx([0.06, 0.06, 0.04], abs=1e-4)
    assert len(image.mesh.faces) == len(tube.faces)
    assert image.rgba == (1.0, 0.0, 0.0, 1.0)


def test_a_box_that_collides_does_not_hide_what_is_rendered(tmp_path: Path) -> None:
    body = '<geom size=".03" contype="0" conaffinity="0" rgba="1 0 0 1"/>'
    body += '<geom type="box" size=".02 .02 .02" group="3"/>'
    prop = mjcf_object(file(tmp_path, body))
    model = compose((prop,)).compile()
    assert model.geom("thing:0").group[0] > 2
    assert model.geom("thing:image0").rgba.tolist() == [1, 0, 0, 1]


REFUSED = {
    "light": (GEOM, "", "<light/>", "it has lights; remove them"),
    "light of the body": (GEOM + "<light/>", "", "", "it has lights"),
    "camera": (GEOM, "", "<camera/>", "it has cameras"),
    "floor": (GEOM, "", '<geom type="plane" size="1 1 1"/>', "1 bodies and 1 geoms"),
    "two": (GEOM, "", f"<body>{GEOM}</body>", "2 bodies and 0 geoms"),
    "option": (GEOM, '<option timestep="0.005"/>', "", "its option sets timestep"),
    "flag": (GEOM, '<option><flag gravity="disable"/></option>', "", "sets disableflags"),
    "keyframe": (GEOM, "<keyframe><key/></keyframe>", "", "it has keys"),
    "actuator": (
        GEOM + LID.format('name="j"', ""),
        '<actuator><motor joint="j"/></actuator>',
        "",
        "it has actuators",
    ),
    "excluded": (
        GEOM + LID.format("", ""),
        '<contact><exclude body1="top" body2="lid"/></contact>',
        "",
        "it has excludes",
    ),
    "slide": (GEOM + LID.format('type="slide"', ""), "", "", "otherwise than on one hinge"),
    "spring": (GEOM + LID.format('springref="9"', ""), "", "", "and springref"),
    "friction": (GEOM + LID.format('frictionloss="1"', ""), "", "", "without frictionloss"),
    "endless": (GEOM + LID.format('limited="false"', ""), "", "", "has no range"),
    "chain": (GEOM + LID.format("", LID.format("", "").replace("lid", "l2")), "", "", "hangs on"),
    "top": ('<joint type="slide"/>' + GEOM, "", "", "a joint that is not free"),
    "ellipsoid": ('<geom type="ellipsoid" size=".1 .1 .1"/>', "", "", "should be sphere"),
    "surfaces": (GEOM + '<geom size=".01" friction="2"/>', "", "", "one friction and condim"),
    "unfelt": ('<geom size=".01" contype="0" conaffinity="0"/>', "", "", "at least one"),
    "millimetres": ('<geom type="box" size="1 1 1.5"/>', "", "", "at most 2, in metres"),
    "grams": ('<geom size=".02" mass="150"/>', "", "", "in kg, above 0 and at most 20"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_object_is_refused_in_a_sentence(tmp_path: Path, name: str) -> None:
    body, before, world, reason = REFUSED[name]
    with pytest.raises(TaskError, match=reason):
        mjcf_object(file(tmp_path, body, before, world=world))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "empty file"),
        ("not XML", "XML parse error"),
        ('<mujoco><include file="thing.xml"/></mujoco>', "already included"),
        (
            '<mujoco><asset><mesh name="m" file="no.stl"/></asset><worldbody><body>'
            '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>',
            r"no\.stl",
        ),
    ],
)
def test_what_mujoco_cannot_read_is_said_in_a_line(tmp_path: Path, text: str, reason: str) -> None:
    (tmp_path / "thing.xml").write_text(text)
    with pytest.raises(AssetError, match=f"MuJoCo cannot read .*{reason}") as caught:
        mjcf_object(tmp_path / "thing.xml")
    assert "\n" not in str(caught.value)


def test_missing_files_and_other_endings_are_refused(tmp_path: Path) -> None:
    refused: list[DuoBenchError] = []
    for name in ("thing.xml", "thing.urdf"):
        with pytest.raises(DuoBenchError) as caught:
            mjcf_object(tmp_path / name)
        refused.append(caught.value)
    assert [type(error) for error in refused] == [AssetError, TaskError]
