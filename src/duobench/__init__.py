"""DuoBench: a benchmark for two-armed manipulation on the Franka FR3 Duo.

Importing the package registers the environments with Gymnasium and does nothing else. Without
Gymnasium, as on a policy's server, `duobench.policy` can still be imported.
"""

import duobench.world.looks  # noqa: F401 - so that it is there
from duobench.core.errors import DuoBenchError
from duobench.core.versions import __version__
from duobench.tasks.catalog import names as task_ids
from duobench.world.robot.camera_geometry import point_cloud
from duobench.world.robot.cameras import Camera

__all__ = [
    "Camera",
    "DuoBenchError",
    "__version__",
    "make",
    "make_vec",
    "point_cloud",
    "register",
    "task_ids",
]

try:
    from duobench.envs.registration import (
        make,
        make_vec,
        register,
        register_catalog,
    )
except ModuleNotFoundError as error:
    if error.name != "gymnasium":
        raise
else:
    register_catalog()
