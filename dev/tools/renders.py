"""Find out whether images can be rendered here; exit code 1, after a sentence, if they cannot.

python -m dev.tools.renders
"""

import sys

from duobench.cli.shared.process import load_engine
from duobench.core.errors import RenderingError
from duobench.core.machine import OPENGL_PACKAGES


def main() -> None:
    """Let a child process render an image with what would be chosen."""
    try:
        load_engine()
        from duobench.world.sim.opengl import choose, probe

        is_rendered = not isinstance(probe(choose()), str)
    except RenderingError:
        is_rendered = False
    if not is_rendered:
        sys.exit(
            "Nothing renders images here, so there will be no videos, but episodes in 3D; for "
            f"videos, as root: apt-get install {OPENGL_PACKAGES}"
        )


if __name__ == "__main__":
    main()
