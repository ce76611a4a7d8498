"""Textures of a look in OpenGL, as materials beside those of the model."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from duobench.sim.materials import Texture

_RGB = mujoco.mjtTextureRole.mjTEXROLE_RGB.value
_CUBE = mujoco.mjtTexture.mjTEXTURE_CUBE.value
_ROLES = mujoco.mjtTextureRole.mjNTEXROLE.value
_NAMES = 10_000
"""Textures have OpenGL names from here on, which the engine never reaches. A name keeps the kind of
its first texture, so flat textures have even ones and those of objects odd ones."""


def upload(model: mujoco.MjModel, context: mujoco.MjrContext, textures: Sequence[Texture]) -> None:
    """Make textures the materials `model.nmat` and following of a context, in their order.

    The engine uploads textures of models only. So they stand in a small model of their own, which
    is never simulated, after as many as the rendered model has.

    Args:
        model: The model that the context was made of.
        context: Current on this thread.
        textures: Square ones (n, n, 3), or six squares below each other (6 n, n, 3).
    """
    if not textures:
        return
    spec = mujoco.MjSpec()
    of_model = np.zeros((1, 1, 3), dtype=np.uint8)
    for number, texels in enumerate([*[of_model] * model.ntex, *textures]):
        height, width, channels = texels.shape
        flat = height == width
        spec.add_texture(
            name=f"{number}",
            type=mujoco.mjtTexture.mjTEXTURE_2D if flat else mujoco.mjtTexture.mjTEXTURE_CUBE,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
            width=width,
            height=height,
            nchannel=channels,
        )
    holder = spec.compile()
    for number, texels in enumerate(textures, start=model.ntex):
        kind = int(holder.tex_type[number])
        context.texture[number] = _NAMES + 2 * number + (kind == _CUBE)
        context.textureType[number] = kind
        start = holder.tex_adr[number]
        holder.tex_data[start : start + texels.size] = texels.ravel()
        mujoco.mjr_uploadTexture(holder, context, number)
        _filter_quickly(kind, int(context.texture[number]))
        material = model.nmat + number - model.ntex
        roles = np.full(_ROLES, -1)
        roles[_RGB] = number
        context.mat_texid[_ROLES * material : _ROLES * (material + 1)] = roles
        context.mat_texrepeat[2 * material : 2 * (material + 1)] = 1.0
        context.mat_texuniform[material] = 0
    # Freeing the context frees them too.
    context.ntexture = max(context.ntexture, model.ntex + len(textures))


def _filter_quickly(kind: int, name: int) -> None:
    """Take texels of one size where the engine blends two: on a processor a fifth of an image."""
    # Only once a context is there, because this binds PyOpenGL to a library.
    from OpenGL.raw.GL.VERSION import GL_1_0, GL_1_1, GL_1_3

    target = GL_1_3.GL_TEXTURE_CUBE_MAP if kind == _CUBE else GL_1_0.GL_TEXTURE_2D
    GL_1_1.glBindTexture(target, name)
    GL_1_0.glTexParameteri(target, GL_1_0.GL_TEXTURE_MIN_FILTER, GL_1_0.GL_LINEAR_MIPMAP_NEAREST)
    GL_1_1.glBindTexture(target, 0)
