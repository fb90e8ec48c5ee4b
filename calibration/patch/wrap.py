"""Wrapping a board on a link: from its flat layout and a few anchors to where every taxel is."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calibration.patch.diagnosis import lay
from calibration.patch.patch_calibration import PatchCalibration
from calibration.patch.patch_evidence import check_anchors


def wrap_layout(
    layout: ArrayLike,
    vertices: ArrayLike,
    faces: ArrayLike,
    anchor_indices: ArrayLike,
    anchor_points: ArrayLike,
    *,
    anchor_sigma: ArrayLike = 1e-3,
    modules: ArrayLike | None = None,
    channels: ArrayLike | None = None,
    mirror: bool = False,
    rng: np.random.Generator | int,
) -> PatchCalibration:
    """Lay a flat board on a link so that lengths hold and the anchors are where they should be.

    Parameters
    ----------
    layout : (n, 2) array-like of float
        Taxels on the flat board, seen from outside [m].
    vertices, faces : (v, 3) array-like of float, (f, 3) array-like of int
        The link's mesh [m]; it may be open, doubled or partly inside out.
    anchor_indices : (k,) array-like of int
        Taxels whose place is known; at least three, not in a row.
    anchor_points : (k, 3) array-like of float
        Where they are, in the frame of the mesh [m].
    anchor_sigma : float
        Standard deviation of each coordinate of an anchor [m].
    modules : (n,) array-like of int, optional
        Rigid module of each taxel; without them the board is one flexible sheet.
    channels : (n,) array-like of int, optional
        What the taxels are called in messages; their rows by default.
    mirror : bool
        Whether the layout shows the board from its other side.
    rng : numpy.random.Generator or int
        Where the starts are taken; a number is its seed.

    Returns
    -------
    PatchCalibration
        Positions (n, 3) [m], their covariance, and whether they may be used.

    Raises
    ------
    InvalidArrayError
        NaN, wrong shapes, fewer than three anchors, anchors in a row or twice, a taxel that the
        layout lacks, lengths in other units than metres (names the factor).
    InvalidMeshError
        An empty mesh, or one that the anchors are far from.

    Examples
    --------
    >>> import skinmap
    >>> robot = skinmap.load_robot("kaspar")
    >>> skin = robot.skin("left_hand")
    >>> link, board = robot.mesh(skin.link), skinmap.flatten(skinmap.build_surface(skin)).uv
    >>> known = range(0, 144, 16)
    >>> found = skinmap.wrap_layout(
    ...     board, link.vertices, link.faces, known, skin.positions[known], rng=0
    ... )
    >>> found.status.value, bool(abs(found.positions - skin.positions).max() < 2e-3)
    ('ok', True)
    """
    return lay(
        layout, (vertices, faces),
        lambda flat, link, names: check_anchors(
            flat, link, anchor_indices, anchor_points, anchor_sigma, names
        ),
        modules=modules, channels=channels, mirror=mirror, rng=rng,
    )  # fmt: skip
