"""Why a skin stands off its link: a cover that no mesh has, or a wrong frame.

A cover keeps the skin at a steady distance, with normals that agree with the link's, whichever
way the link faces. A wrong frame brings some taxels nearer and takes others away, or into the
body. Only where the skin is flat are the two alike: then a rigid move lays it on the link, and
both are said.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from skinmap.geometry.mesh import TriangleMesh
from skinmap.skin.fit import SkinFit
from skinmap.skin.registration import fit_to_mesh
from skinmap.skin.skin import Skin

FAR = 5e-3  # a taxel further than this from where it should be is not there [m]
STEADY = 0.5  # the middle nine tenths of the distances spread by less, in medians
ALONG = np.radians(35.0)  # normals of skin on a cover keep within this of the link's
ALIGNED = 0.9  # share of the normals that do
HIDDEN = 0.02  # share of taxels that may look into the body or lie inside it
LAID = 0.25  # a rigid move that leaves less than this of the distance explains it

Why = Literal["on it", "a cover", "a frame", "a cover or a frame"]


@dataclass(frozen=True, slots=True)
class Standing:
    """How a skin stands to its link.

    Attributes
    ----------
    why : str
        "on it" where it stands as the manifest says.
    far : int
        Taxels more than 5 mm from where they should be.
    low, median, high : float
        Distances from the link: 5th, 50th and 95th percentile [m].
    shift : float
        How far a rigid move would take it that lays it on the link [m]; NaN where none does.
    """

    why: Why
    far: int
    low: float
    median: float
    high: float
    shift: float = float("nan")


def judge_standing(skin: Skin, body: TriangleMesh, found: SkinFit, cover: float = 0.0) -> Standing:
    """Whether a skin stands as it should, else whether a cover or a wrong frame explains it.

    Parameters
    ----------
    skin : Skin
    body : TriangleMesh
        Of its link, or of its cover.
    found : SkinFit
        Of the two.
    cover : float
        Thickness of the cover that is known of [m].
    """
    far = int((np.abs(found.distance - cover) > FAR).sum())
    low, median, high = np.percentile(found.distance, [5.0, 50.0, 95.0]).tolist()
    if far == 0:
        return Standing("on it", far, low, median, high)
    hidden = float((found.inward | found.covered).mean())
    along = float((found.normal_angle < ALONG).mean())
    steady = high - low < STEADY * median and median > FAR
    if not steady or hidden > HIDDEN or along < ALIGNED:
        return Standing("a frame", far, low, median, high)
    moved = fit_to_mesh(skin.positions, body.vertices, body.faces)
    if moved.after.mean() < LAID * moved.before.mean():
        return Standing("a cover or a frame", far, low, median, high, moved.shift)
    return Standing("a cover", far, low, median, high)
