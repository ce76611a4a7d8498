"""Looks: how images of a scene look, as values. `sim` renders them."""

from typing import TYPE_CHECKING

from duobench.core.references import lazy

if TYPE_CHECKING:
    from duobench.world.looks.catalog import names as names

lazy(__name__)
