"""What the cameras of a rig see, for whoever leads its arms from a page.

Images are encoded in a thread of their own, and only where somebody looks: the loop that leads the
arms never waits for them, and they are shown while that loop waits for the operator. A camera that
gives nothing new costs nothing, and the page says how old its image is.
"""

from __future__ import annotations

import io
import logging
import math
import threading
from typing import TYPE_CHECKING, Any

from PIL import Image as Pillow

from duobench.hardware.drivers.frames import STALE_S

if TYPE_CHECKING:
    from duobench.backend import Image
    from duobench.hardware.devices import Frame
    from duobench.hardware.duo import FrankaDuo
    from duobench.web.server import PageServer

_log = logging.getLogger(__name__)

PERIOD_S = 0.1
"""Seconds from one look at the cameras to the next."""
SHOWN_WIDTH = 640
"""Width in pixels of what is shown; wider images are made smaller by a whole number."""
_JPEG_QUALITY = 80


class CameraFeed:
    """Shows a page the newest image of each camera, as it came from it, and how old it is."""

    def __init__(self, duo: FrankaDuo, server: PageServer) -> None:
        """Begin to look.

        Args:
            duo: The rig, which may be connected later.
            server: The page.
        """
        self._duo, self._server = duo, server
        self._shown: dict[str, tuple[Frame, str]] = {}  # what each camera's address shows
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="cameras of the page", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Look no more; closing twice is harmless."""
        self._is_over.set()
        self._thread.join()

    def look(self) -> None:
        """Publish what is new, and say how old each image is."""
        frames = self._duo.frames()
        for name, frame in frames.items():
            before = self._shown.get(name)
            if before is None or before[0] is not frame:
                address = self._server.publish_image(f"camera-{name}", jpeg(frame.image))
                self._shown[name] = frame, address
        ages = self._duo.image_ages()
        self._server.publish_cameras([self._said(name, ages[name]) for name in ages])

    def _said(self, name: str, age_s: float) -> dict[str, Any]:
        """What the page is told about a camera."""
        frame, address = self._shown.get(name, (None, ""))
        is_stale = frame is not None and age_s > STALE_S
        return {
            "name": name,
            "title": f"{name.replace('_', ' ').capitalize()} camera",
            "image": address,
            "number": None if frame is None else frame.index,
            "stale_s": round(age_s, 1) if is_stale and math.isfinite(age_s) else None,
        }

    def _run(self) -> None:
        while not self._is_over.wait(PERIOD_S):
            if not self._server.has_viewers:
                continue
            try:
                self.look()
            except Exception:  # noqa: BLE001 - pictures for people end no session
                _log.exception("What the cameras see cannot be shown.")
                return


def jpeg(image: Image) -> bytes:
    """An image (height, width, 3) as JPEG of at most `SHOWN_WIDTH` pixels across."""
    picture = Pillow.fromarray(image)
    picture = picture.reduce(max(1, math.ceil(picture.width / SHOWN_WIDTH)))
    file = io.BytesIO()
    picture.save(file, "JPEG", quality=_JPEG_QUALITY)
    return file.getvalue()
