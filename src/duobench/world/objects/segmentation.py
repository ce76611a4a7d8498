"""Numbers of the parts of a scene in a segmentation; the same in every episode of a task."""

from collections.abc import Iterable

from duobench.core.errors import TaskError
from duobench.core.types import SIDES
from duobench.world.objects.prop import Prop

NOTHING = 0
"""Number of pixels that show no part."""
TABLE, ROOM, MOUNT, CAMERA = "table", "room", "mount", "camera"
"""Table top and legs; walls, floor and furniture; column, block and post that carry the arms; the
housings of all cameras."""


ARMS = {side: f"{side}_arm" for side in SIDES}
GRIPPERS = {side: f"{side}_gripper" for side in SIDES}
WORKCELL = (
    TABLE,
    ROOM,
    *ARMS.values(),
    *GRIPPERS.values(),
    CAMERA,
    MOUNT,
)
"""Parts that every task has, in the order of their numbers."""


def segmentation_ids(props: Iterable[Prop]) -> dict[str, int]:
    """Numbers from 1 on by name: parts of the workcell, then each prop and its parts.

    Raises:
        TaskError: A prop is called as a part of the workcell.
    """
    names = list(WORKCELL)
    for prop in props:
        if prop.name in WORKCELL:
            raise TaskError(
                f"The prop {prop.name!r} has the name of a part of the workcell, which a "
                f"segmentation numbers; call it otherwise, such as '{prop.name}_1'."
            )
        names += [prop.name, *(prop.part_name(part.name) for part in prop.parts)]
    return {name: number for number, name in enumerate(names, NOTHING + 1)}
