"""Python in a process of its own, in which nobody has chosen an OpenGL library."""

import os
import subprocess
import sys
import textwrap

from duobench.sim.opengl import ASKED
from duobench.sim.probe import CHOSEN

VARIABLES = (ASKED, CHOSEN, "PYOPENGL_PLATFORM")


def run_python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    kept = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    return subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        env={**kept, **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
