"""Looks: how images of a scene look, as values. `sim` renders them."""

from typing import TYPE_CHECKING

from duobench.core.references import lazy

if TYPE_CHECKING:
    from duobench.world.looks.catalog import names as names
else:
    __getattr__, __dir__, __all__ = lazy(
        __name__,
        {
            "duobench.world.looks.catalog": ["names"],
        },
    )
