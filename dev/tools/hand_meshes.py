"""How the images of the Franka Hand are made from the published files.

`python -m dev.tools.hand_meshes FOLDER` writes them into `world/scene/robot_meshes.npz` anew; the
other meshes there stay as they are. The folder holds the files of `franka_emika_panda`, as those of
`dev.tools.meshes`; `meshoptimizer` is needed as for `dev.tools.fine_meshes`, whose reduction they
get. The plug and the cable of the hand, and its icons, are left out.
"""

import hashlib
import io
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dev.tools.fine_meshes import Recipe, published_files, reduced, surface
from dev.tools.meshes import missing
from duobench.world.scene import meshes

Image = tuple[NDArray[Any], NDArray[Any]]
"""Vertices (n, 3) and triangles (m, 3), in whole numbers."""
DIGESTS = Path(__file__).with_suffix(".sha256")
"""SHA-256 and name of every published file, in the format of `sha256sum`."""
RECIPES: tuple[Recipe, ...] = (
    {
        "franka_hand/hand:visual": {
            "franka_hand/hand_3.obj": "",
            "franka_hand/hand_4.obj": "",
        }
    },
    {
        "franka_hand/finger:visual": {"franka_hand/finger_0.obj": ""},
        "franka_hand/tip:visual": {"franka_hand/finger_1.obj": ""},
    },
)
"""For everything that is reduced together, by image, the published files."""
ERROR_MM = 2.5
"""How far in millimetres a reduced surface may be from the published one: a hand and two fingers
have about a thousand triangles then, as the other gripper."""


def made(files: Mapping[str, bytes]) -> dict[str, Image]:
    """Vertices on the grid and triangles of each image, by its name."""
    found: dict[str, Image] = {}
    for recipe in RECIPES:
        few = reduced(surface(recipe, files), ERROR_MM)
        for number, (image, _) in enumerate(few.keys):
            corners = few.corners[few.parts == number].reshape(-1, 3)
            vertices, index = np.unique(corners, axis=0, return_inverse=True)
            found[image] = (
                vertices.astype(np.int32),
                index.reshape(-1, 3).astype(np.int32),
            )
    return found


def with_hand(data: bytes, images: Mapping[str, Image]) -> bytes:
    """The shipped file, from the one before, with these images in place of those of that name."""
    with np.load(io.BytesIO(data)) as file:
        before = dict(file)
    ends = before["counts"].cumsum(axis=0)[:-1]
    pairs = zip(
        np.split(before["points"], ends[:, 0]),
        np.split(before["faces"], ends[:, 1]),
        strict=True,
    )
    found: dict[str, Image] = dict(zip(before["names"].tolist(), pairs, strict=True))
    found.update(images)
    counts = [(len(points), len(faces)) for points, faces in found.values()]
    content = io.BytesIO()
    np.savez(
        content,
        names=np.array([*found]),
        counts=np.array(counts, dtype=np.int32),
        points=np.concatenate([points for points, _ in found.values()]),
        faces=np.concatenate([faces for _, faces in found.values()]),
    )
    return content.getvalue()


if __name__ == "__main__":
    absent = missing(Path(sys.argv[1]), DIGESTS)
    if absent:
        sys.exit(f"Missing, or with other bytes: {', '.join(absent)}")
    images = made(published_files(Path(sys.argv[1]), DIGESTS))
    written = with_hand(meshes.shipped(meshes.FILE), images)
    Path(meshes.__file__).with_name(meshes.FILE).write_bytes(written)
    print({name: len(faces) for name, (_, faces) in images.items()})
    print(hashlib.sha256(written).hexdigest())
