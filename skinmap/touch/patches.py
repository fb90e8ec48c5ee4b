"""The patches of a skin as skins of their own: what leave-one-patch-out protocols test on."""

from __future__ import annotations

import numpy as np

from skinmap.skin.skin import Skin
from skinmap.surface.surface_mesh import SurfaceMesh


def cut_into_patches(mesh: SurfaceMesh) -> tuple[Skin, ...]:
    """One skin for each connected patch, the largest first, named `part/0`, `part/1`...

    A part of one patch keeps its name. Taxels that no face uses belong to no patch and are
    left out.
    """
    skin, patch = mesh.skin, mesh.taxel_patches
    if mesh.n_patches == 1 and (patch == 0).all():
        return (skin,)
    return tuple(_cut(skin, np.flatnonzero(patch == k), k) for k in range(mesh.n_patches))


def _cut(skin: Skin, rows: np.ndarray, number: int) -> Skin:
    return Skin(
        f"{skin.part}/{number}",
        skin.link,
        skin.channels[rows],
        skin.modules[rows],
        skin.positions[rows],
        skin.normals[rows],
    )
