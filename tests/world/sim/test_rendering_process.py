"""Images from a process of their own: whatever was done with OpenGL in this one, and whatever
happens to the other.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from textwrap import dedent

import pytest

from tests.children import ran
from tests.quick_first import quick_first

IMAGES = """
import hashlib
import duobench
env = duobench.make("bin_sort", image_size=48)

def seen():
    pixels = env.reset(seed=0)[0]["pixels"]
    return hashlib.sha256(b"".join(image.tobytes() for image in pixels.values())).hexdigest()
"""
MODEL = """
import os, warnings
warnings.simplefilter("ignore")
import mujoco
model = mujoco.MjSpec().compile()
"""
BEFORE = {
    "nothing": "",
    "a renderer that found no display": """
try:
    mujoco.Renderer(model)
except mujoco.FatalError as error:
    assert "OpenGL platform library" in str(error)
""",
    "a context of MuJoCo without OpenGL": """
try:
    mujoco.MjrContext(model, 50)
except mujoco.FatalError:
    pass
""",
    "a renderer that works": """
import mujoco.egl
from mujoco.rendering.classic import gl_context
gl_context.GLContext = mujoco.egl.GLContext
import importlib, mujoco.rendering.classic.renderer as renderer
kept = importlib.reload(renderer).Renderer(model)
assert kept.render().shape == (240, 320, 3)
""",
    "a renderer that works, and one that fails": """
import mujoco.egl
kept = mujoco.egl.GLContext(8, 8)
kept.make_current()
context = mujoco.MjrContext(model, 50)
kept.free()
del os.environ["PYOPENGL_PLATFORM"]
try:
    mujoco.Renderer(model)
except mujoco.FatalError:
    pass
""",
    "PyOpenGL for a display": "import OpenGL.GL",
    "GLFW without a display": "import glfw; glfw.init(); glfw.create_window(8, 8, '', None, None)",
    "libraries of OpenGL": """
import ctypes
for name in ("libGL.so.1", "libEGL.so.1", "libOpenGL.so.0"):
    ctypes.CDLL(name, mode=ctypes.RTLD_GLOBAL)
""",
}
"""What somebody else does with OpenGL before the first image."""
COMMON = ("a renderer that found no display", "a renderer that works")
HEADLESS = {
    name: value
    for name, value in os.environ.items()
    if name not in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL", "PYOPENGL_PLATFORM")
}


@pytest.fixture(scope="module")
def clean() -> str:
    """What a process sees in which nothing else was done."""
    return ran("-c", IMAGES + "print(seen())", env=HEADLESS, timeout=120).stdout


@pytest.mark.parametrize(
    "before",
    [
        pytest.param(before, marks=pytest.mark.slow if before in COMMON else pytest.mark.long)
        for before in BEFORE
    ],
)
def test_images_are_the_same_to_the_bit_whatever_another_library_did(
    clean: str, before: str
) -> None:
    code = MODEL + BEFORE[before] + IMAGES + "print(seen())"
    done = ran("-c", code, env=HEADLESS, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout == clean != ""


CHANGES = """
import numpy as np
from duobench.envs.sim_env import SimEnv
from duobench.world.looks import catalog as looks
from duobench.world.sim.appearance import Appearance
from duobench.world.sim.offscreen import CameraRequest, OffscreenRenderer
from duobench.world.sim.opengl import choose
from duobench.world.sim.rendering import Renderer
from duobench.tasks import catalog

base = SimEnv(catalog.get("transfer_gate"))
base.reset()
model, data = base.simulation.model, base.simulation.data
cameras = {model.camera(number).name: number for number in range(model.ncam)}
kinds = "rgb", "depth", "segmentation"
requests = [CameraRequest(name, number, kinds, (60, 80)) for name, number in cameras.items()]
wanted = {kind: dict.fromkeys(cameras, (60, 80)) for kind in kinds}
here = OffscreenRenderer(model, 60, 80, 1, choose())
there = Renderer(model, height=60, width=80)
look = looks.as_look("random:3")

def appear():
    here.set_appearance(Appearance(model, look))
    there.set_look(look)

found = set()
for change in (
    "nothing",
    "base.simulation.data.qpos[:7] += 0.1; base.simulation.forward()",
    "base.reset(options={'layout_seed': 5})",
    "model.geom_rgba[:, :3] *= 0.5",
    "model.light_diffuse[:] *= 0.7",
    "model.cam_intrinsic[:, :2] *= 1.2",
    "model.vis.headlight.ambient[:] *= 0.5",
    "model.stat.extent *= 40.0",
    "model.vis.map.znear *= 2.0",
    "data.geom_xpos[:, 2] += 0.05",
    "data.cam_xpos[:, 2] += 0.05",
    "appear()",
):
    exec(change if change != "nothing" else "")
    expected, images = here.render(data, requests), there.render_kinds(data, wanted)
    for name in cameras:
        for kind in kinds:
            assert (expected[name][kind] == images[kind][name]).all(), (change, name, kind)
    seen = images["rgb"]
    assert (here.segment(data, 0) == there.segment(data, list(cameras)[0])).all(), change
    found.add(b"".join(image.tobytes() for image in seen.values()))
print(len(found))
"""


def test_whatever_changes_images_are_those_of_a_renderer_in_this_process() -> None:
    done = ran("-c", CHANGES, env=HEADLESS, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "12\n", "every change is seen"


LEFT_OUT = """
import numpy as np
from duobench.envs.sim_env import SimEnv
from duobench.world.looks import catalog as looks
from duobench.world.sim.appearance import Appearance
from duobench.world.sim.offscreen import CameraRequest, OffscreenRenderer
from duobench.world.sim.opengl import choose
from duobench.tasks import catalog

class Whole(OffscreenRenderer):
    def _leave_out(self, data, requests):
        return [[] for _ in requests]

class Counting(OffscreenRenderer):
    counts = []
    def _leave_out(self, data, requests):
        found = super()._leave_out(data, requests)
        Counting.counts += [len(numbers) for numbers in found]
        return found

base = SimEnv(catalog.get("hinge_chest"))
base.reset()
simulation = base.simulation
model, data = simulation.model, simulation.data
names = [model.camera(number).name for number in range(model.ncam)]
forwards = [CameraRequest(name, at, ("rgb",), (60, 80)) for at, name in enumerate(names)]
mixed = [
    CameraRequest("deep", 2, ("depth",), (60, 80)),
    CameraRequest("one", 0, ("rgb", "segmentation"), (30, 40)),
    CameraRequest("other", 1, ("depth", "rgb"), (60, 60)),
    CameraRequest("again", 0, ("rgb",), (60, 80)),
]
renderers = [kind(model, 60, 80, 1, choose()) for kind in (Counting, Whole)]
rng = np.random.default_rng(0)
for look in (None, "side_light", "random:3"):
    for renderer in renderers:
        renderer.make_current()
        seen = None if look is None else Appearance(model, looks.as_look(look))
        renderer.set_appearance(seen)
    for number in range(4):
        for joints in simulation.duo.joints:
            data.qpos[joints] += rng.normal(0.0, 0.2, len(joints))
        simulation.forward()
        if number == 3:
            data.cam_xpos[:] += rng.normal(0.0, 0.3, data.cam_xpos.shape)
        alone = [[request] for request in forwards]
        for requests in (forwards, forwards[::-1], mixed, *alone):
            images = []
            for renderer in renderers:
                renderer.make_current()
                images.append(renderer.render(data, requests))
            for name, found in images[0].items():
                for kind, image in found.items():
                    assert (image == images[1][name][kind]).all(), (look, number, name, kind)
assert max(Counting.counts) > 60, sorted(Counting.counts)
"""


@pytest.mark.slow
def test_what_is_left_out_of_an_image_changes_nothing() -> None:
    done = ran("-c", LEFT_OUT, env=HEADLESS, timeout=120)
    assert done.returncode == 0, done.stderr


def started(code: str) -> subprocess.Popen[str]:
    """A process that has broken its own OpenGL, has an image, and whose child was stopped."""
    begin = """
        import os, signal
        from duobench.core.errors import RenderingError
        from duobench.world.sim import rendering_process
        first = seen()
        child = rendering_process.current()._process.pid
        print(child, flush=True)
        """
    broken = BEFORE["a renderer that found no display"]
    return subprocess.Popen(
        [sys.executable, "-c", MODEL + broken + IMAGES + dedent(begin) + dedent(code)],
        env=HEADLESS,
        stdout=subprocess.PIPE,
        text=True,
    )


def line_of(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline()


def is_gone(number: int) -> bool:
    """Whether a process ends within some seconds; one that nobody waited for counts."""
    for _ in range(100):
        try:
            stat = Path(f"/proc/{number}/stat").read_text()
        except FileNotFoundError:
            return True
        if stat.rpartition(")")[2].split()[0] == "Z":
            return True
        time.sleep(0.1)
    return False


@pytest.mark.slow
def test_a_child_that_hangs_ends_in_an_error_and_the_next_image_comes_from_another() -> None:
    with started(
        """
        rendering_process.FRAME_TIMEOUT_S = 1.0
        os.kill(child, signal.SIGSTOP)
        try:
            seen()
        except RenderingError as error:
            print(error)
        rendering_process.FRAME_TIMEOUT_S = 60.0
        print(seen() == first)
        """
    ) as process:
        child = int(line_of(process))
        assert "No image came within 1 s: the graphics driver hangs" in line_of(process)
        assert line_of(process) == "True\n"
        assert is_gone(child)
    assert process.returncode == 0


def test_ctrl_c_ends_the_wait_for_a_child_that_hangs() -> None:
    with started(
        """
        os.kill(child, signal.SIGSTOP)
        try:
            print("waits", flush=True)
            seen()
        except KeyboardInterrupt:
            print("interrupted", flush=True)
        print(seen() == first)
        """
    ) as process:
        child = int(line_of(process))
        assert line_of(process) == "waits\n"
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        assert line_of(process) == "interrupted\n"
        assert line_of(process) == "True\n"
        assert is_gone(child)
    assert process.returncode == 0


@pytest.mark.parametrize("number", quick_first(["SIGKILL", "SIGSEGV"]))
def test_a_child_that_crashes_in_an_image_is_an_error_that_names_how(number: str) -> None:
    with started(
        f"""
        import threading
        os.kill(child, signal.SIGSTOP)
        threading.Timer(0.5, os.kill, (child, signal.{number})).start()
        threading.Timer(0.6, os.kill, (child, signal.SIGCONT)).start()
        try:
            seen()
        except RenderingError as error:
            print(error)
        print(seen() == first)
        """
    ) as process:
        line_of(process)
        assert f"The process that renders was ended by {number}" in line_of(process)
        assert line_of(process) == "True\n"


@pytest.mark.slow
def test_between_images_a_child_may_die_unnoticed() -> None:
    with started("rendering_process.current().end()\nprint(seen() == first)") as process:
        child = int(line_of(process))
        assert line_of(process) == "True\n"
        assert is_gone(child)


@pytest.mark.parametrize("how", quick_first(["killed", "left"]))
def test_a_child_ends_with_its_parent(how: str) -> None:
    code = "input()" if how == "killed" else "os._exit(0)"
    with started(code) as process:
        child = int(line_of(process))
        if how == "killed":
            process.kill()
        assert is_gone(child)
