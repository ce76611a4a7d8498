"""The jig lies against the foot of the mount, and its front edge is where sheets begin."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import manifold3d
import numpy as np
import pytest

from duobench.cli import main
from duobench.core.errors import FabricationError
from duobench.envs.sim_env import SimEnv
from duobench.printing import Foot, lay_out, placing_jig
from duobench.printing.jig import ACROSS, FRONT, LINE, WIDTH
from duobench.tasks import catalog
from duobench.world.objects.shapes import KEPT_FREE, PRINTER
from duobench.world.objects.solid import manifold_from, placed
from duobench.world.robot.frames import ROBOT
from tests.printing.test_folder import contents, failure, printed

FEET = [
    Foot(front=front, width=width)
    for front, width in (*itertools.product(FRONT, ACROSS), (0.045, 0.25), (0.08, 0.15))
]
feet = pytest.mark.parametrize("foot", FEET, ids=str)
NOISE = 1e-12
"""Volume in m³ that arithmetic leaves of nothing."""


def jig(foot: Foot) -> manifold3d.Manifold:
    """The jig where it lies, in the table frame."""
    (part,) = placing_jig(foot).parts
    return placed(manifold_from(part.mesh), part.print_from_object.inverse())


def block(foot: Foot, **moved: float) -> manifold3d.Manifold:
    """A foot of sharp edges, as deep as wide."""
    middle = (foot.front - foot.width / 2 + moved.get("x", 0.0), moved.get("y", 0.0), 0.0)
    return manifold3d.Manifold.cube((foot.width, foot.width, 0.05), True).translate(middle)


@feet
def test_it_lies_against_the_front_and_the_left_side_of_its_foot(foot: Foot) -> None:
    lies = jig(foot)
    assert len(lies.decompose()) == 1
    assert (lies ^ block(foot)).volume() < NOISE
    play = 1e-4
    front, side = block(foot, x=play), block(foot, x=-play, y=play)
    against_front, against_side = (lies ^ front).bounding_box(), (lies ^ side).bounding_box()
    # Two points far apart at the front, and one at the side, decide where it lies.
    assert against_front[4] - against_front[1] >= 0.09
    assert against_side[3] - against_side[0] >= 0.01
    assert against_side[1] == pytest.approx(foot.width / 2, abs=1e-6)


@feet
def test_its_front_edge_is_the_line_and_its_notch_the_middle(foot: Foot) -> None:
    section = jig(foot).slice(0.004)
    (_, low, x, high) = section.bounds()
    assert x == pytest.approx(LINE)
    edge = section ^ manifold3d.CrossSection.square((1e-4, 1.0)).translate((LINE - 1e-4, -0.5))
    left, right = sorted(edge.decompose(), key=lambda each: -each.bounds()[1])
    assert left.bounds()[3] == pytest.approx(WIDTH / 2)
    assert right.bounds()[1] == pytest.approx(-WIDTH / 2)
    assert left.bounds()[1] == pytest.approx(-right.bounds()[3])
    assert left.bounds()[1] < 0.005
    assert low == pytest.approx(-WIDTH / 2)
    assert high >= WIDTH / 2
    (part,) = placing_jig(foot).parts
    assert [size.mm for size in part.sizes] == pytest.approx(
        [1000 * (x - foot.front), 500 * foot.width, 1000 * (left.bounds()[3] - right.bounds()[1])]
    )


@feet
def test_it_fits_a_printer_and_leaves_the_corner_free(foot: Foot) -> None:
    job = placing_jig(foot)
    (spot,) = lay_out(job.parts)
    width, depth, _ = spot.part.size
    assert max(width, depth) <= PRINTER
    left, front = spot.x - width / 2, spot.y - depth / 2
    assert min(left, front) >= -1e-9
    assert left >= KEPT_FREE[0] - 1e-9 or front >= KEPT_FREE[1] - 1e-9


@pytest.mark.parametrize(
    ("front", "width"),
    [(0.02, 0.25), (0.16, 0.25), (0.045, 0.09), (0.045, 0.31), (math.nan, 0.25), (0.045, math.inf)],
)
def test_a_foot_that_no_jig_fits_is_refused(front: float, width: float) -> None:
    with pytest.raises(FabricationError, match=r"draw the line x = 240 mm by other means"):
        Foot(front=front, width=width)


def test_by_default_it_is_for_the_simulated_foot_between_the_arms() -> None:
    model = SimEnv(catalog.get("bin_sort")).simulation.model
    lies, foot = jig(Foot()), Foot()
    low = [
        geom
        for geom in range(model.ngeom)
        if model.geom_bodyid[geom] == 0
        and model.geom_type[geom] == 6  # a box
        and 0 < model.geom_pos[geom][2] - model.geom_size[geom][2] + 1e-3 < 2e-3
    ]
    fronts = [model.geom_pos[geom][0] + model.geom_size[geom][0] for geom in low]
    assert max(fronts) == pytest.approx(foot.front)
    widths = [2 * model.geom_size[geom][1] for geom in low]
    assert max(widths) == pytest.approx(foot.width)
    for geom in low:
        cube = manifold3d.Manifold.cube((2 * model.geom_size[geom]).tolist(), True)
        assert (cube.translate(model.geom_pos[geom].tolist()) ^ lies).volume() < NOISE
    bases = np.array([pose.translation for pose in ROBOT.mount.bases.values()])
    assert np.abs(bases[:, 0]).max() == 0
    assert bases[:, 1].sum() == 0


def test_it_is_written_for_the_foot_that_is_given(tmp_path: Path) -> None:
    default = printed(tmp_path / "default", "jig")
    assert {"jig/jig.stl", "jig/jig.3mf", "jig/recipe.md"} <= set(default)
    assert not any(name.endswith("layout.pdf") for name in default)
    mine = printed(tmp_path / "mine", "jig", "--foot", "60", "180")
    assert mine["jig/jig.stl"] != default["jig/jig.stl"]
    page = mine["jig/recipe.md"].decode()
    assert "a foot that is 180 mm wide, with its front edge 60 mm in front" in page
    assert "| `jig` | from the foot to the front edge | 180 | 0.2 |" in page
    message = failure(tmp_path / "mine", "jig")
    assert "foot (45.0, 250.0) instead of (60.0, 180.0)" in message
    assert contents(tmp_path / "mine") == mine
    both = printed(tmp_path / "both", "bin_sort", "--foot", "60", "180")
    assert both["jig/jig.stl"] == mine["jig/jig.stl"]
    assert "bin_sort/layout.pdf" in both


def test_a_foot_that_is_no_foot_is_told(tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["print", "jig", "--foot", "45", "25", "--out", str(tmp_path / "new")])
    assert "100 to 300 mm wide" in str(caught.value)
    assert not (tmp_path / "new").exists()
