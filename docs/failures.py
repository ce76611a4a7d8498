"""Whose each failure is: the table of docs/guides/evaluation.md, each cell of which a test raises.

`tests/evaluation/runners/test_failures.py` raises every cell with real parts and looks for the
effect.
"""

from collections.abc import Iterator
from dataclasses import dataclass

POLICY, TASK, MACHINERY, PERSON = "policy", "task", "machinery", "person"

FAILED = "the episode failed, with the error"
TWICE = "played again alone; the second time fails the episode"
AGAIN = "played again"
ASIDE = "played again, at most twice; then set aside, and the others are played"
UNPLAYED = "unplayed; the others are played"
ENDS = "played again, at most twice; then the run ends, the rest unplayed"
STOPS = "the run ends at once, the rest unplayed"
NOTHING = "nothing is played or written"


@dataclass(frozen=True, kw_only=True, slots=True)
class Row:
    """Failures of one owner at one moment, with one effect."""

    moment: str
    what: str
    owner: str
    effect: str
    cells: tuple[str, ...]
    """What raises them in the test; "local" and "served" are ways in which a policy plays."""


def both(*names: str) -> Iterator[str]:
    """Cells of a policy in a process of its own and of one at a server."""
    for name in names:
        yield f"local: {name}"
        yield f"served: {name}"


ROWS = (
    Row(
        moment="making the policy",
        what="it raises; it expects what no environment has",
        owner=POLICY,
        effect=NOTHING,
        cells=("local: cannot be made", "local: expects no camera", "served: is no server"),
    ),
    Row(
        moment="making the policy",
        what="three processes in a row cannot start",
        owner=POLICY,
        effect=NOTHING,
        cells=("local: dies when made",),
    ),
    Row(
        moment="its first answer, before anything is played",
        what="it raises, ends, or gives what is no chunk",
        owner=POLICY,
        effect=NOTHING,
        cells=tuple(both("raises first", "ends first", "too wide first")),
    ),
    Row(
        moment="`reset` or `act`",
        what="it raises, or calls `sys.exit`",
        owner=POLICY,
        effect=FAILED,
        cells=(
            *both("raises", "raises in reset", "says machinery", "exits"),
            "here: raises",
            "here: says machinery",
            "batched: raises",
        ),
    ),
    Row(
        moment="`reset` or `act`",
        what="its answer is no array (H, n) of finite numbers",
        owner=POLICY,
        effect=FAILED,
        cells=tuple(both("too wide", "not a number", "no array")),
    ),
    Row(
        moment="`reset` or `act`",
        what="it lives and sends what cannot be read, more than its largest chunk, or two answers",
        owner=POLICY,
        effect=FAILED,
        cells=(
            "served: bfloat16",
            "served: objects",
            "served: complex",
            "served: extension",
            "served: lying shape",
            "served: nested",
            "served: noise",
            "served: empty",
            *both("bad frame"),
            "served: bad text",
            "served: too large",
            "served: two answers",
        ),
    ),
    Row(
        moment="`reset` or `act`",
        what="it is too slow; a server says meanwhile at its health path that it lives",
        owner=POLICY,
        effect=FAILED,
        cells=tuple(both("late")),
    ),
    Row(
        moment="`reset` or `act`",
        what="its process ends; the connection is lost, and its server is back within `--wait`",
        owner=POLICY,
        effect=TWICE,
        cells=(
            *both("dies", "dies beside another"),
            "served: closes",
            "served: closes with 1011",
            "served: half a frame",
            "served: late and silent",
            "here: closes with 1011",
            "local: closes files",
        ),
    ),
    Row(
        moment="`reset` or `act`",
        what="the same, once",
        owner=POLICY,
        effect=AGAIN,
        cells=tuple(both("dies once")),
    ),
    Row(
        moment="`reset` or `act`",
        what="its server is not back within `--wait`, is another one, or says *try again later*",
        owner=MACHINERY,
        effect=ENDS,
        cells=("served: is gone", "served: is another", "served: is busy"),
    ),
    Row(
        moment="a step",
        what="finite actions make the physics diverge, or mean no pose",
        owner=POLICY,
        effect=FAILED,
        cells=("here: diverges", "local: no rotation"),
    ),
    Row(
        moment="making the environment, or its reset",
        what="the task's objects, layouts or words raise, or no layout is valid",
        owner=TASK,
        effect=UNPLAYED,
        cells=(
            "task: object raises",
            "task: misspelt name",
            "task: arrange raises",
            "task: accept raises in one",
            "task: accept raises here",
            "task: no valid layout",
            "task: counted as failures",
        ),
    ),
    Row(
        moment="a step",
        what="the task's stages raise",
        owner=TASK,
        effect=UNPLAYED,
        cells=(
            "task: stage raises",
            "task: stage raises here",
            "task: words raise",
            "task: words find nothing",
            "task: stage blames others",
            "task: stage blames others here",
            "task: stage raises, served",
        ),
    ),
    Row(
        moment="any",
        what="a simulator's process dies",
        owner=MACHINERY,
        effect=ASIDE,
        cells=("simulator: dies",),
    ),
    Row(
        moment="any",
        what="an image for policy or video cannot be rendered, whatever the driver raises",
        owner=MACHINERY,
        effect=ENDS,
        cells=(
            "video: device is empty",
            "video: device is a list",
            "video: device is a name",
            "video: no such device",
        ),
    ),
    Row(
        moment="making the policy",
        what="it or a video needs images, and nothing can render them",
        owner=MACHINERY,
        effect=NOTHING,
        cells=("images: device is empty", "images: no such library", "video: no such library"),
    ),
    Row(
        moment="any",
        what="a file cannot be written",
        owner=MACHINERY,
        effect=STOPS,
        cells=("disk: cannot be written",),
    ),
    Row(
        moment="any",
        what="Ctrl-C",
        owner=PERSON,
        effect=STOPS,
        cells=("person: interrupts",),
    ),
)
"""Owners and moments; served and local policies are in the same rows."""
