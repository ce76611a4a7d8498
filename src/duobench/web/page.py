"""The pages that show models in 3D: one that a server gives out, and replays that need none."""

import base64
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from markupsafe import Markup

from duobench.core import pages
from duobench.core.errors import OptionError, check_known
from duobench.core.types import CONTROL_HZ
from duobench.web.track import length

_PACKAGE = "duobench.web"
_ASSETS = files(_PACKAGE) / "assets"
_TYPES = {".js": "text/javascript; charset=utf-8", ".css": "text/css; charset=utf-8"}
_HTML = "text/html; charset=utf-8"
_REPLAY_MODULES = ("shaders", "scene", "orbit", "view", "controls", "track", "replay")
"""Modules of a replay, each after those that it imports."""
_IMPORT = re.compile(r"^import [^;]*;\n", re.MULTILINE)
_EXPORT = re.compile(r"^export ", re.MULTILINE)


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeReplay:
    """An episode that is watched in 3D."""

    title: str
    """Names the task and the episode."""
    scene: str
    """Name of its scene."""
    track: bytes
    """Poses of the scene's bodies after each control step; see `web.track`."""
    stage_changes: tuple[tuple[int, int], ...] = ()
    """Steps at which a stage was reached, and the stage, in time's order."""
    stages: tuple[str, ...] = ()
    """The task's stages in words, from the first on."""
    instruction: str = ""
    """Instruction of the episode."""
    id: str = ""
    """Identifier by which an element of the page opens it in `data-replay`, another one for each
    episode; empty for its place in the list, as in `replay-1`."""


@cache
def assets(page: str = "live_page.html") -> Mapping[str, tuple[str, bytes]]:
    """Assets of a server, by path: content type and content; the page itself is at `/`.

    The page loads the others, a scene, and a socket at `/ws`.

    Args:
        page: Template of the page: "live_page.html" shows the table in 3D, "trials_page.html" is
            that of the operator of real arms.
    """
    found = {"/": (_HTML, pages.render(_PACKAGE, page).encode())}
    for file in sorted(_ASSETS.iterdir(), key=lambda file: file.name):
        kind = _TYPES.get(file.name[file.name.rfind(".") :])
        if kind is not None:
            found[f"/{file.name}"] = (kind, file.read_bytes())
    common = files("duobench.core.pages") / "templates" / "style.css"
    found["/page.css"] = (
        _TYPES[".css"],
        common.read_bytes() + _asset("page.css").encode(),
    )
    return found


def replay_page(
    title: str, scenes: Mapping[str, bytes], replays: Sequence[EpisodeReplay]
) -> str:
    """A page that plays episodes in 3D, as HTML; it is one file that loads nothing.

    The first episode is shown at first; for the rest see `replay_fragment`.
    """
    fragment = replay_fragment(scenes, replays, is_open=True)
    return pages.render(
        _PACKAGE, "replay_page.html", title=title, fragment=Markup(fragment)
    )


def replay_fragment(
    scenes: Mapping[str, bytes],
    replays: Sequence[EpisodeReplay],
    *,
    is_open: bool = False,
) -> str:
    """The same as a part of a page in the style of `duobench.core.pages`; one such part a page.

    Other elements of the page open an episode too: a button with its id as `data-replay`. Nothing
    is unpacked, and no graphics are touched, before an episode is opened.

    Args:
        scenes: Scene files by name, `Geometry.data`; those that no episode needs are left out.
        replays: The episodes, in the order of the list.
        is_open: Whether the first episode is shown at once.
    """
    if not replays:
        raise OptionError("A page of replays needs at least one episode.")
    ids = [
        replay.id or f"replay-{number}"
        for number, replay in enumerate(replays, start=1)
    ]
    for replay in replays:
        check_known("scene", replay.scene, scenes)
    needed = list(dict.fromkeys(replay.scene for replay in replays))
    places = {scene: f"scene-data-{number}" for number, scene in enumerate(needed)}
    tracks = [f"track-data-{number}" for number in range(len(replays))]
    data = {places[scene]: _base64(scenes[scene]) for scene in needed}
    data |= {
        place: _base64(replay.track)
        for place, replay in zip(tracks, replays, strict=True)
    }
    episodes = [
        {
            "id": id,
            "title": replay.title,
            "scene": places[replay.scene],
            "track": track,
            "stage_changes": replay.stage_changes,
            "stages": replay.stages,
            "instruction": replay.instruction,
            "rate_hz": CONTROL_HZ,
        }
        for id, replay, track in zip(
            ids,
            replays,
            tracks,
            strict=True,
        )
    ]
    return pages.render(
        _PACKAGE,
        "replays.html",
        rows=[_row(id, replay) for id, replay in zip(ids, replays, strict=True)],
        is_open=is_open,
        data=data,
        episodes=Markup(json.dumps(episodes).replace("<", "\\u003c")),
        style=Markup(_asset("page.css")),
        script=Markup(bundle(_REPLAY_MODULES)),
    )


def bundle(modules: Iterable[str]) -> str:
    """Modules as one script, which a page can hold: a file cannot import from itself."""
    texts = [_asset(f"{module}.js") for module in modules]
    return "\n".join(_EXPORT.sub("", _IMPORT.sub("", text)) for text in texts)


def _row(id: str, replay: EpisodeReplay) -> dict[str, object]:
    stage = max((stage for _, stage in replay.stage_changes), default=0)
    seconds = max(0, length(replay.track) - 1) / CONTROL_HZ
    reached = f"stage {stage} of {len(replay.stages)} · " if replay.stages else ""
    return {"id": id, "title": replay.title, "detail": f"{reached}{seconds:.1f} s"}


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()


def _asset(name: str) -> str:
    return (_ASSETS / name).read_text(encoding="utf-8")
