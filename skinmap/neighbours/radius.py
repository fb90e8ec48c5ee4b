"""The radius of neighbourhoods that no taxel lies near: between two rings of the lattice."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from skinmap.arrays import FloatArray
from skinmap.errors import InvalidArrayError
from skinmap.geometry.triangles import pair_lengths
from skinmap.neighbours.offsets import BAND

RANGE = (0.75, 1.4)  # of the requested radius: further off it is another ring's
NARROWEST, WIDEST = 1e-4, 1.0  # neighbourhoods that anyone may ask for [m]
STEPS = 261  # radii that are tried
SLACK = 0.02  # of the mean: as good as empty


def auto_radius(skins: Sequence[FloatArray], *, near: float, band: float = BAND) -> float:
    """The middle of the widest gap in the distances between taxels, near a requested radius.

    A gap is where the fewest pairs lie in the soft band. Skins whose distances have no gap give
    the radius with the fewest pairs about it; skins without pairs give back the request.

    Parameters
    ----------
    skins : sequence of (n, 3) array of float
        Positions of the taxels of each part [m].
    near, band : float
        The requested radius, and half the width of the soft band [m].

    Returns
    -------
    float
    [m].

    Raises
    ------
    InvalidArrayError
        A radius that is not positive.

    Examples
    --------
    >>> import skinmap
    >>> from skinmap.neighbours import auto_radius
    >>> skin = skinmap.load_robot("icub").skin("left_forearm")
    >>> 6e-3 < auto_radius([skin.positions], near=8e-3) < 11e-3
    True
    """
    if not near > 0:
        raise InvalidArrayError(f"a radius is above 0, got {near} m")
    radii = near * np.linspace(*RANGE, STEPS)
    lengths = [np.zeros(0)]
    for points in skins:
        pairs = cKDTree(points).query_pairs(radii[-1] + band, output_type="ndarray")
        lengths.append(pair_lengths(points, pairs))
    length = np.sort(np.concatenate(lengths))
    count = np.searchsorted(length, radii + band) - np.searchsorted(length, radii - band)
    if not count.any():
        return near
    share = count / radii  # a ring of a random layout holds pairs in proportion to its radius
    low = np.flatnonzero(share <= share.min() + SLACK * share.mean())
    runs = np.split(low, np.flatnonzero(np.diff(low) > 1) + 1)
    widest = max(runs, key=lambda run: (len(run), -abs(radii[run].mean() - near)))
    return float(radii[widest].mean())
