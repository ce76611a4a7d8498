"""The process that renders for this one, in which nothing of OpenGL is ever loaded.

What another library has opened, or failed to open, in a process can make MuJoCo hang there for
good, with the interpreter held: no time limit and no Ctrl-C would act. A driver can crash its
process as well. So images come from a child process of our own, one for each process that asks for
any. The child ends with its parent.

Each of the two kinds of renderers has a process of its own: Vulkan ends the process in which it
fails.
"""

import atexit
import math
import mmap
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
from collections import deque
from contextlib import suppress
from importlib import import_module
from operator import attrgetter
from typing import IO, Any

import mujoco
import numpy as np

from duobench.core.errors import RenderingError
from duobench.core.machine import VULKAN_PACKAGES, watch_parent
from duobench.core.types import Array
from duobench.world.sim.appearance import Appearance
from duobench.world.sim.offscreen import CameraRequest, OffscreenRenderer
from duobench.world.sim.opengl import (
    ASKED,
    VULKAN,
    RenderingInfo,
    child_environment,
    choose,
    in_words,
    info_of,
    open_context,
)

FRAME_TIMEOUT_S = 50.0
"""Seconds, while this process runs, after which an answer never comes."""
_SLICE_S = 0.25
"""The limit is counted in such parts; one in which this process was stopped is one."""
ROOM = 128 << 20
"""Bytes of the largest message; memory is taken as it is needed."""
_ADVICE = {
    False: f"without the card: {ASKED}=osmesa",
    True: "in a look that the classic renderer shows",
}
"""Where else to render, and whether that is said of Vulkan."""
_HEAD = 8
"""Bytes that say how long a message is."""
_MODEL = "model.mjb"
_STUDIO = "duobench.world.sim.studio"
"""The other renderer, whose libraries only its own process opens."""
_FAMILIES = ("geom", "mat", "light", "cam")
_STRUCTS = ("stat", "vis.global_", "vis.headlight", "vis.map")
"""Fields of a model that an image depends on, and that may change while it is simulated."""
_DATA = (
    "qpos",
    "xpos",
    "xquat",
    "xmat",
    "xipos",
    "ximat",
    "subtree_com",
    "geom_xpos",
    "geom_xmat",
    "site_xpos",
    "site_xmat",
    "cam_xpos",
    "cam_xmat",
    "light_xpos",
    "light_xdir",
)
"""Fields of a state that an image depends on, beside the time."""


class Pictured:
    """State that an image of a model depends on: taken out of one process, put into another."""

    def __init__(self, model: mujoco.MjModel) -> None:
        names = [name for name in dir(model) if name.partition("_")[0] in _FAMILIES]
        found = [getattr(model, name) for name in names]
        self._arrays = [each for each in found if isinstance(each, np.ndarray)]
        structs = [attrgetter(name)(model) for name in _STRUCTS]
        self._fields = [
            (struct, name)
            for struct in structs
            for name in dir(struct)
            if name[0] != "_"
        ]

    def of_model(self) -> tuple[bytes, list[Any]]:
        """Fields of the model as they are now."""
        values = [
            np.asarray(getattr(struct, name)).tolist() for struct, name in self._fields
        ]
        return _joined(self._arrays), values

    def put_model(self, content: bytes, values: list[Any]) -> None:
        """Let the model show what another one does."""
        _spread(content, self._arrays)
        for (struct, name), value in zip(self._fields, values, strict=True):
            setattr(struct, name, value)

    @staticmethod
    def of_data(data: mujoco.MjData) -> tuple[float, bytes]:
        """Time and fields of a state."""
        return data.time, _joined([getattr(data, name) for name in _DATA])

    @staticmethod
    def put_data(
        data: mujoco.MjData,
        time: float,
        content: bytes,
    ) -> None:
        """Let a state show what another one does."""
        data.time = time
        _spread(content, [getattr(data, name) for name in _DATA])


def _joined(arrays: list[Array]) -> bytes:
    return b"".join([array.tobytes() for array in arrays])


def _spread(content: bytes, arrays: list[Array]) -> None:
    start = 0
    for array in arrays:
        numbers = np.frombuffer(content, array.dtype, array.size, start)
        array[...] = numbers.reshape(array.shape)
        start += array.nbytes


class _RenderChannel:
    """One end of a connection on which two processes take turns.

    A message is in memory that they share, and the connection says how long it is.
    """

    def __init__(self, connection: socket.socket, memory: int) -> None:
        self._connection = connection
        self._room = mmap.mmap(memory, ROOM)
        os.close(memory)

    def send(self, message: Any) -> None:
        """Send a message."""
        content = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
        if len(content) > ROOM:
            raise RenderingError(
                f"Images of more than {ROOM >> 20} MiB at once; ask for fewer."
            )
        self._room[: len(content)] = content
        self._connection.send(len(content).to_bytes(_HEAD))

    def receive(self) -> Any:
        """Wait for a message, and receive it."""
        head = self._connection.recv(_HEAD)
        if not head:
            raise EOFError
        with memoryview(self._room) as room, room[: int.from_bytes(head)] as content:
            return pickle.loads(content)

    @property
    def is_closed(self) -> bool:
        """Whether this end was closed."""
        return self._connection.fileno() < 0

    def close(self) -> None:
        """Close this end."""
        self._connection.close()


class RenderingProcess:
    """A child process that renders, as its parent sees it; threads take turns.

    Raises:
        RenderingError: It cannot be started, or cannot render.
    """

    def __init__(self, backend: str) -> None:
        code = f"import sys; sys.path[:] = {sys.path!r}; "
        code += "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); "  # the parent's
        code += "from duobench.world.sim.rendering_process import serve; "
        code += f"serve({backend!r}, {os.getpid()})"
        self.backend = backend
        self._errors: IO[bytes] | None = None
        """What a process with Vulkan writes until it is seen to work."""
        self._lock = threading.Lock()
        self._freed: deque[int] = deque()
        self._last = 0
        try:
            ours, theirs = socket.socketpair(type=socket.SOCK_SEQPACKET)
            with theirs:
                ours.settimeout(_SLICE_S)
                memory = os.memfd_create("duobench-images")
                os.ftruncate(memory, ROOM)
                socket.send_fds(ours, [b"memory"], [memory])
                self._channel = _RenderChannel(ours, memory)
                if backend == VULKAN:
                    self._errors = os.fdopen(os.memfd_create("duobench-errors"), "w+b")
                self._process = subprocess.Popen(
                    [sys.executable, "-c", code],
                    env=child_environment(backend),
                    stdin=theirs.fileno(),
                    stdout=subprocess.DEVNULL,
                    stderr=self._errors,
                )
        except (
            OSError,
            AttributeError,
        ) as error:  # not on Linux, there is no such memory
            raise RenderingError(
                f"No process could be started to render: {error}."
            ) from error
        try:
            self.info: RenderingInfo = self.ask("info")
        except BaseException:
            self.end()
            raise
        self._forget_errors()

    @property
    def is_running(self) -> bool:
        """Whether it can be asked; one that was ended cannot, even where it takes long to die."""
        return not self._channel.is_closed and self._process.poll() is None

    def new_number(self) -> int:
        """A number for a renderer, which no other one has."""
        self._last += 1
        return self._last

    def free(self, number: int) -> None:
        """Free a renderer at the next request: the garbage collector may call this at any time."""
        self._freed.append(number)

    def ask(self, what: str, *arguments: Any) -> Any:
        """Answer of the process; anything that comes between ends it.

        Raises:
            RenderingError: It cannot, or did not answer in time, or ended.
        """
        with self._lock:
            freed = [self._freed.popleft() for _ in range(len(self._freed))]
            try:
                self._channel.send((what, arguments, freed))
                answer = self._answer()
            except TimeoutError:
                self.end()
                raise RenderingError(
                    f"No image came within {FRAME_TIMEOUT_S:g} s: the graphics driver hangs. Some "
                    "do when several processes render on one card at the same time. Render in "
                    f"fewer processes, or {_ADVICE[self.backend == VULKAN]}."
                ) from None
            except (OSError, EOFError):
                if self._errors is not None:
                    raise self._without_vulkan(self._errors) from None
                raise RenderingError(
                    f"The process that renders {self._end_in_words()}. The next image comes from a "
                    f"new one. If that ends too, render {_ADVICE[self.backend == VULKAN]}."
                ) from None
            except BaseException:
                self.end()
                raise
        if isinstance(answer, RenderingError):
            raise answer
        return answer

    def _answer(self) -> Any:
        """Answer within the limit of time."""
        for _ in range(math.ceil(FRAME_TIMEOUT_S / _SLICE_S)):
            with suppress(TimeoutError):
                return self._channel.receive()
        raise TimeoutError

    def end(self) -> None:
        """End the process; twice is harmless."""
        self._process.kill()
        with suppress(subprocess.TimeoutExpired):  # a driver may keep it from dying
            self._process.wait(1.0)
        self._channel.close()
        self._forget_errors()

    def _forget_errors(self) -> None:
        if self._errors is not None:
            self._errors.close()
            self._errors = None

    def _without_vulkan(self, errors: IO[bytes]) -> RenderingError:
        """Error of a process in which Vulkan failed, by what it wrote before it ended."""
        errors.seek(0)
        lines = errors.read().decode(errors="replace").splitlines()
        end = self._end_in_words()
        reasons = [line for line in lines if line.startswith("reason:")] or lines[-1:]
        reason = reasons[0].removeprefix("reason:").strip() if reasons else end
        return RenderingError(
            f"Looks by the renderer 'studio' need Vulkan, and it does not work here ({reason}). "
            f"Debian, Ubuntu: apt-get install {VULKAN_PACKAGES}. Every other look needs none."
        )

    def _end_in_words(self) -> str:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(1.0)
        code = self._process.returncode
        self.end()
        if code is not None and code < 0:
            return f"was ended by {signal.Signals(-code).name}"
        return f"ended with exit code {code}"


_PROCESSES: dict[tuple[int, bool], RenderingProcess] = {}
"""The rendering processes of a process, by its number (a forked one inherits what is not its own),
and by whether they render with Vulkan."""
_LOCKS: dict[int, threading.Lock] = {}


def current(backend: str | None = None) -> RenderingProcess:
    """Rendering process of this process, started unless it runs already.

    Args:
        backend: What it renders with; None for any library of OpenGL.
    """
    own = os.getpid()
    kind = own, backend == VULKAN
    with _LOCKS.setdefault(own, threading.Lock()):
        process = _PROCESSES.get(kind)
        if process and process.is_running and backend in (None, process.backend):
            return process
        if process:
            process.end()
        _PROCESSES[kind] = RenderingProcess(backend or choose())
        return _PROCESSES[kind]


@atexit.register
def _end_own() -> None:
    for with_vulkan in (False, True):
        process = _PROCESSES.pop((os.getpid(), with_vulkan), None)
        if process:
            process.end()


def serve(backend: str, parent: int) -> None:
    """Render what the parent asks for over the standard input: the process itself."""
    watch_parent(parent, lambda: os._exit(1))
    connection = socket.socket(fileno=0)
    _, (memory,), _, _ = socket.recv_fds(connection, _HEAD, 1)
    channel, served = _RenderChannel(connection, memory), _Served(backend)
    with suppress(EOFError, OSError):
        while True:
            answer = served.answer(*channel.receive())
            try:
                channel.send(answer)
            except RenderingError as error:
                channel.send(error)
    os._exit(0)  # drivers have crashed while a process that had rendered was taken down


class _Served:
    """Work of the rendering process; its public methods can be asked for."""

    def __init__(self, backend: str) -> None:
        self._backend = backend
        self._scenes: dict[int, tuple[Any, mujoco.MjData, Pictured]] = {}
        self._current: Any = None

    def answer(
        self,
        what: str,
        arguments: tuple[Any, ...],
        freed: list[int],
    ) -> Any:
        """Result of a method; every error in it is a `RenderingError`."""
        try:
            for number in freed:
                self._free(number)
            return getattr(self, what)(*arguments)
        except RenderingError as error:
            return error
        except Exception as error:  # noqa: BLE001 - the parent raises it
            return RenderingError(f"An image could not be rendered: {in_words(error)}")

    def info(self) -> RenderingInfo:
        """Library, renderer and driver in use."""
        if self._backend == VULKAN:
            return import_module(_STUDIO).studio_info()
        context = open_context(self._backend, 1, 1)
        info = info_of(self._backend)
        context.free()
        return info

    def open(
        self, number: int, packed: bytes, height: int, width: int, samples: int
    ) -> None:
        """Make the renderer of a model."""
        model = mujoco.MjModel.from_binary_path(_MODEL, {_MODEL: packed})
        self._current = None
        shape = height, width, samples
        if self._backend == VULKAN:
            renderer = import_module(_STUDIO).StudioRenderer(model, *shape)
        else:
            renderer = OffscreenRenderer(model, *shape, self._backend)
        self._scenes[number] = renderer, mujoco.MjData(model), Pictured(model)
        self._current = renderer

    def set_appearance(self, number: int, appearance: Appearance | None) -> None:
        """Render in a look from now on."""
        self._renderer(number).set_appearance(appearance)

    def set_model(
        self,
        number: int,
        content: bytes,
        values: list[Any],
    ) -> None:
        """Render what a model shows by now."""
        self._scenes[number][2].put_model(content, values)

    def render(
        self, number: int, time: float, content: bytes, requests: list[CameraRequest]
    ) -> Any:
        """Images of a state; see `OffscreenRenderer`."""
        _, data, pictured = self._scenes[number]
        pictured.put_data(data, time, content)
        return self._renderer(number).render(data, requests)

    def segment(
        self,
        number: int,
        time: float,
        content: bytes,
        camera: int,
    ) -> Any:
        """Ids of geoms of a state; see `OffscreenRenderer`."""
        _, data, pictured = self._scenes[number]
        pictured.put_data(data, time, content)
        return self._renderer(number).segment(data, camera)

    def _free(self, number: int) -> None:
        if number in self._scenes:
            self._renderer(number).free()
            self._current = None
            del self._scenes[number]

    def _renderer(self, number: int) -> Any:
        """A renderer, with its context current."""
        renderer = self._scenes[number][0]
        if renderer is not self._current:
            renderer.make_current()
            self._current = renderer
        return renderer
