"""Lines from the tools down to what lies below them."""

from __future__ import annotations

import numpy as np
import pytest

from duobench.core.types import SIDES, Array, Side
from duobench.envs.protocol import make_env
from duobench.envs.sim_env import SimEnv, sim_of
from duobench.teleop.plumb import PlumbLines
from duobench.world.objects.pot import HANDLE_OFFSET, HANDLE_Z

CUBE = 0.032
"""Side of a cube of this task in metres."""


class Table:
    """Arms over the table, led without a page."""

    def __init__(self, task: str = "bin_sort") -> None:
        env = make_env(task, cameras=False, action_mode="cartesian", horizon=10_000)
        env.reset(seed=3)
        self._env = env
        self.env: SimEnv = sim_of(env)
        self.sim = self.env.simulation
        self._targets = self.env.backend.read().tcp_poses.copy()
        self._openings = np.ones(2)

    def lead(self, side: Side, *, to: tuple[float, float, float], opening: float = 1.0) -> None:
        """Move a tool straight to a place, and its fingers to an opening."""
        start = self._targets[side.index, :3].copy()
        self._openings[side.index] = opening
        for share in np.linspace(0.0, 1.0, 60).tolist() + [1.0] * 30:
            self._targets[side.index, :3] = start + share * (np.array(to) - start)
            rows = [
                np.append(self._targets[each.index], self._openings[each.index]) for each in SIDES
            ]
            self._env.step(np.concatenate(rows))

    def row(self, side: Side, *, has_objects: bool = True) -> tuple[Array, Array, float]:
        """The tool, the beginning of its line, and its length."""
        row = PlumbLines(self.sim, has_objects=has_objects).rows()[side.index].astype(np.float64)
        return row[:3], row[3:6], float(row[6])


@pytest.fixture(scope="module")
def table() -> Table:
    return Table()


def test_a_line_ends_at_what_lies_below_and_begins_where_what_is_held_ends(table: Table) -> None:
    side = Side.RIGHT
    tool, start, height = table.row(side)  # home: its own fingers are in the way, and do not count
    assert np.array_equal(tool, start)
    assert height == pytest.approx(tool[2], abs=1e-5)
    x, y, z = table.sim.origin("black_cube")
    table.lead(side, to=(x, y, 0.15))
    tool, start, height = table.row(side)
    assert height == pytest.approx(tool[2] - (z + CUBE / 2), abs=2e-3)
    # On a rig nobody knows where objects are: the table stays.
    assert table.row(side, has_objects=False)[2] == pytest.approx(tool[2], abs=1e-5)

    table.lead(side, to=(x, y, z))
    table.lead(side, to=(x, y, z), opening=0.0)
    table.lead(side, to=(x, y, 0.2), opening=0.0)
    tool, start, height = table.row(side)
    lowest = table.sim.min_height("black_cube")
    assert lowest > 0.1  # it is held
    assert start[2] == pytest.approx(lowest, abs=1e-5)
    assert height == pytest.approx(lowest, abs=1e-5)
    assert np.array_equal(start[:2], tool[:2])


def test_who_holds_a_handle_holds_the_pot() -> None:
    table = Table("carry_pot")
    grasps = {
        side: table.sim.pose("pot").apply((0.0, side.sign * HANDLE_OFFSET, HANDLE_Z))
        for side in SIDES
    }
    for opening, up in ((0.45, 0.1), (0.45, 0.0), (0.0, 0.0)):
        for side, (x, y, z) in grasps.items():
            table.lead(side, to=(x, y, z + up), opening=opening)
    for side in SIDES:
        _tool, start, height = table.row(side)
        assert start[2] == pytest.approx(table.sim.min_height("pot"), abs=1e-3)
        assert height < 0.005  # it stands on the table
