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
        self._arrays = model.geom_contype, model.geom_conaffinity, model.geom_rgba
        self._compiled = [array.copy() for array in self._arrays]

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
        root = model.body(prop.name)
        geoms = slice(root.geomadr[0], root.geomadr[0] + root.geomnum[0])
        for array, compiled in zip(self._arrays, self._compiled, strict=True):
            array[geoms] = compiled[geoms]
        for number in chosen.without_shapes:
            geom = model.geom(f"{prop.name}:{number}").id
            model.geom_contype[geom] = model.geom_conaffinity[geom] = 0
        for number in chosen.without_images:
            model.geom_rgba[model.geom(f"{prop.name}:image{number}").id, 3] = 0.0
