"""Which shapes of a prop are there: a compiled model is switched, not compiled again."""

from __future__ import annotations

import mujoco

from duobench.errors import LayoutError
from duobench.solids.prop import Prop


class Variants:
    """Switches shapes of props on and off: what is off is neither seen nor felt."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Remember how a model was compiled, with every shape on."""
        self._model = model
        self._masks = model.geom_contype.copy(), model.geom_conaffinity.copy()
        self._alpha = model.geom_rgba[:, 3].copy()

    def choose(self, prop: Prop, value: str | None) -> None:
        """Leave out the shapes that one variant leaves out, and no others.

        Raises:
            LayoutError: The prop has no such variant.
        """
        left_out = prop.variants.get(value) if value is not None else None
        if left_out is None:
            raise LayoutError(
                f"{prop.name!r} has a variant {prop.choice!r}, one of {', '.join(prop.variants)}; "
                f"the layout says {value!r}."
            )
        contype, conaffinity = self._masks
        for number in frozenset().union(*prop.variants.values()):
            geom = self._model.geom(f"{prop.name}:{number}").id
            there = number not in left_out
            self._model.geom_contype[geom] = contype[geom] if there else 0
            self._model.geom_conaffinity[geom] = conaffinity[geom] if there else 0
            self._model.geom_rgba[geom, 3] = self._alpha[geom] if there else 0.0
