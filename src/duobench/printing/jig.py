"""The jig: from the foot of the arms' mount to a line on the table, from which objects are placed.

The origin of the table is under the mount, where no hand gets to. The jig lies on the table against
the front edge and the left side of the mount's foot. Its own front edge is then the line x =
`LINE`, and a notch in it is y = 0. The layout sheets begin there.
"""

from dataclasses import dataclass, replace

from duobench.core.errors import FabricationError
from duobench.core.spatial import SE3
from duobench.printing.details import FREE, Dimension
from duobench.printing.parts import PrintJob, upright
from duobench.world.objects.blocks import YELLOW
from duobench.world.objects.shapes import Shape, box, prism
from duobench.world.objects.solid import mesh_of, union_of

ID = "jig"
LINE = 0.240
"""The jig's front edge: x in metres in the table frame. No layout of the benchmark has an object
that is nearer to the arms, and the jig fits a printer."""
WIDTH = 0.180
"""Length of the front edge in metres, half to each side: that of the sheets on A4."""
BAR, HEIGHT = 0.020, 0.008
"""Width of the jig's bars and its height, in metres."""
HOOK = (0.020, 0.015)
"""Length of the hook along the side of the foot, and its thickness, in metres."""
NOTCH = 0.004
"""Depth of the notch, and half its width, in metres."""
RELIEF = 0.003
"""Half the edge in metres of what is cut out of the inner corner: that of a foot is never sharp."""
FRONT, ACROSS = (0.025, 0.150), (0.100, 0.300)
"""Fronts and widths of feet in metres for which the jig fits a printer and lies steadily."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Foot:
    """The foot of the mount, as measured on the lab's own; by default the simulated one.

    The simulated foot is drawn, not measured: of the mount only the poses of the arms' bases are
    the manufacturer's.

    Raises:
        FabricationError: No jig fits it.
    """

    front: float = 0.045
    """Distance in metres of its front edge from the plane x = 0, in which are the middles of both
    faces that the arms are screwed to."""
    width: float = 0.250
    """Its width in metres along y; the arms stand over its middle."""

    def __post_init__(self) -> None:
        for value, (least, most) in ((self.front, FRONT), (self.width, ACROSS)):
            if not least <= value <= most:
                raise FabricationError(
                    f"A foot has its front edge {_mm(*FRONT)} mm in front of x = 0 and is "
                    f"{_mm(*ACROSS)} mm wide for a jig, and this one has {_mm(self.front)} and "
                    f"{_mm(self.width)} mm: draw the line x = {_mm(LINE)} mm by other means."
                )


def placing_jig(foot: Foot) -> PrintJob:
    """The jig for a foot."""
    mesh = mesh_of(union_of(_bars(foot)) - union_of(_cuts(foot)))
    sizes = (
        ("from the foot to the front edge", LINE - foot.front),
        ("from the hook's inner face to the notch", foot.width / 2),
        ("front edge", WIDTH),
    )
    return PrintJob(
        id=ID,
        title="Jig for placing",
        description="Lies against the mount of the arms; sheets and objects are placed from it.",
        parts=(
            replace(
                upright(ID, mesh, YELLOW),
                is_solid=False,
                sizes=tuple(
                    Dimension(what=what, mm=round(1000 * edge, 3), tolerance_mm=FREE)
                    for what, edge in sizes
                ),
            ),
        ),
        notes=_notes(foot),
    )


def _bars(foot: Foot) -> tuple[Shape, ...]:
    """Bars at the foot and at the line, two legs between them, and the hook."""
    half, side = WIDTH / 2, foot.width / 2
    depth, thickness = HOOK
    left = max(half, side + thickness)
    back, front = foot.front, LINE
    return (
        _block((back, back + BAR), (-half, left)),
        _block((front - BAR, front), (-half, half)),
        _block((back, front), (-half, BAR - half)),
        _block((back, front), (half - BAR, half)),
        _block((back - depth, back + BAR), (side, side + thickness)),
    )


def _cuts(foot: Foot) -> tuple[Shape, ...]:
    """The notch, and room for the corner of the foot."""
    notch = ((LINE + NOTCH, -2 * NOTCH), (LINE + NOTCH, 2 * NOTCH), (LINE - NOTCH, 0.0))
    x, y = foot.front, foot.width / 2
    return (
        prism(notch, 2 * HEIGHT, at=SE3.at(z=HEIGHT / 2)),
        _block((x - RELIEF, x + RELIEF), (y - RELIEF, y + RELIEF), 2 * HEIGHT),
    )


def _block(
    x: tuple[float, float], y: tuple[float, float], height: float = HEIGHT
) -> Shape:
    """A box between values of x and y, around the middle of the jig's height."""
    at = SE3.at(sum(x) / 2, sum(y) / 2, HEIGHT / 2)
    return box(
        x[1] - x[0],
        y[1] - y[0],
        height,
        at=at,
    )


def _notes(foot: Foot) -> tuple[str, ...]:
    return (
        f"Not yet tried on a mount. It is for a foot that is {_mm(foot.width)} mm wide, with its "
        f"front edge {_mm(foot.front)} mm in front of the middles of the faces that the arms are "
        "screwed to. Look into the drawing of your mount; where it differs, write the jig again.",
        "Lay it on the table, its hook at the left side of the foot as the robot has it. Push it "
        "against the front edge of the foot, then to the right until the hook touches; tape it "
        "down.",
        f"Its front edge is now the line x = {_mm(LINE)} mm, and the notch is y = 0. Sheet 1 of a "
        "layout lies against this edge, its mark at the notch; cut it at its frame before.",
        "Measure from the line and the notch where there is no sheet. Take the jig off before the "
        "arms move.",
    )


def _mm(*metres: float) -> str:
    return " to ".join(f"{1000 * each:g}" for each in metres)
