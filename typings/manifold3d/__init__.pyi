"""The stubs of manifold3d spell array shapes as literals, which no list or computed array meets."""

from typing import Any

def __getattr__(name: str) -> Any: ...
