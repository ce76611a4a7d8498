"""Which parts of a prop are there: a compiled model is switched, not compiled again."""

from __future__ import annotations

import mujoco

from duobench.errors import LayoutError
from duobench.objects.prop import Prop


class Variants:
    """Switches shapes and images of props on and off."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Remember how a model was compiled, with everything on."""
        self._model = model
        self._contype = model.geom_contype.copy()
        self._conaffinity = model.geom_conaffinity.copy()
        self._alpha = model.geom_rgba[:, 3].copy()

    def choose(self, prop: Prop, value: str | None) -> None:
        """Leave out what one variant leaves out, and nothing else.

        Raises:
            LayoutError: The prop has no such variant.
        """
        chosen = prop.variants.get(value) if value is not None else None
        if chosen is None:
            raise LayoutError(
                f"{prop.name!r} has a variant {prop.choice!r}, one of {', '.join(prop.variants)}; "
                f"the layout says {value!r}."
            )
        model = self._model
        for variant in prop.variants.values():
            for number in variant.without_shapes:
                geom = model.geom(f"{prop.name}:{number}").id
                there = number not in chosen.without_shapes
                model.geom_contype[geom] = self._contype[geom] if there else 0
                model.geom_conaffinity[geom] = self._conaffinity[geom] if there else 0
            for number in variant.without_images:
                geom = model.geom(f"{prop.name}:image{number}").id
                there = number not in chosen.without_images
                model.geom_rgba[geom, 3] = self._alpha[geom] if there else 0.0
