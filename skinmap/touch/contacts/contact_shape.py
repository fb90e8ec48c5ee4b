"""The shape of a contact as distances on the skin: how much of it lies how far from the rest.

Histograms of distances in millimetres do not change when a touch is turned, mirrored or shifted,
and hardly with the pitch of the taxels or with some that are dead. A ring, the jaws of a gripper
and a hand have islands alike, and differ in how far those are apart.
"""

from __future__ import annotations

import numpy as np

from skinmap.arrays import BoolArray, FloatArray
from skinmap.touch.contacts.contact_geometry import MM, skin_plane, strongest_taxels
from skinmap.touch.contacts.skin_geometry import ACTIVE, SkinGeometry, check_pressures

STRONGEST = 128  # taxels at most that distances are taken between
STEP = 0.71  # between bins, of the root of a distance [mm**0.5]
PAIRS, REACH, RANKS = 20, 14, 8  # bins: to 182 mm, to 85 mm; loads by rank
SIZE = 2 * PAIRS + 5 * REACH + RANKS


def contact_shape(geometry: SkinGeometry, pressures: FloatArray) -> FloatArray:
    """(118,) roots of shares of a touch by distance; zeros if untouched.

    Between any two of its taxels, by their load and by their skin; from its centre, by load, by
    skin and by the skin at the border; along its long and its short axis, by skin. Then loads by
    rank, of the largest.

    Parameters
    ----------
    geometry : SkinGeometry
        n taxels.
    pressures : (n,) float
        0 to 255 counts.

    Raises
    ------
    SkinMismatchError, InvalidArrayError
        Pressures of another length than the skin, NaN or infinity.

    Examples
    --------
    >>> import numpy as np, skinmap
    >>> from skinmap.touch.prepared_skin import PreparedSkin
    >>> skin = PreparedSkin(skinmap.load_robot("kaspar").skin("torso"))
    >>> contact_shape(skin.geometry, np.zeros(len(skin))).shape
    (118,)
    """
    pressures = check_pressures(pressures, geometry)
    index = np.flatnonzero(pressures > ACTIVE)
    if len(index) == 0:
        return np.zeros(SIZE)
    load = pressures[index].astype(np.float64)
    index, load, _ = strongest_taxels(index, load, index)
    plane = MM * skin_plane(geometry, index, load)
    return distance_shares(plane, load, geometry.areas[index] * MM**2, geometry.border[index])


def distance_shares(
    plane: FloatArray, load: FloatArray, area: FloatArray, border: BoolArray
) -> FloatArray:
    """The same of taxels (k,) by place (k, 2) [mm], load, skin [mm2], and whether it ends there."""
    # In single precision: last bits of distances differ from processor to processor.
    table = np.column_stack([plane, load, area, border]).astype(np.float32).astype(np.float64)
    table = table[np.sort(np.argsort(-table[:, 2], kind="stable")[:STRONGEST])]
    plane, (load, area, border) = table[:, :2], table[:, 2:].T
    even, heavy = area / area.sum(), load * area / (load @ area)
    apart = np.hypot(*(plane[:, None] - plane).T).ravel()
    away = plane - even @ plane
    radius = np.hypot(*away.T)
    rank = np.interp(np.linspace(0.0, 1.0, RANKS), np.linspace(0.0, 1.0, len(load)), np.sort(load))
    shares = [
        _shares(apart, np.outer(heavy, heavy).ravel(), PAIRS),
        _shares(apart, np.outer(even, even).ravel(), PAIRS),
        *(_shares(radius, one, REACH) for one in (heavy, even, even * border)),
        *(_shares(np.abs(one), even, REACH) for one in away.T),
        rank / load.max(),
    ]
    return np.asarray(np.sqrt(np.concatenate(shares)))


def _shares(distances: FloatArray, weights: FloatArray, bins: int) -> FloatArray:
    """(bins,) weights (m,) by their distances (m,) [mm], each divided between two bins."""
    place = np.minimum(np.sqrt(distances) / STEP, bins - 1.001)
    low = place.astype(np.int64)
    upper = (place - low) * weights
    found = np.bincount(low, weights - upper, minlength=bins)
    return np.asarray(found + np.bincount(low + 1, upper, minlength=bins))
