"""Contact geometry: lengths, areas and counts on the skin that name a touch on any robot.

Every number is a length or area along the skin, a count or a share, so it means the same on
any lattice, patch or robot.
"""

from __future__ import annotations

import numpy as np

from skinmap.arrays import FloatArray, IntArray
from skinmap.touch.contacts import SkinGeometry, find_contacts

MM = 1e3
FEATURES = (
    "active_area_mm2",
    "contacts",
    "effective_contacts",
    "length_mm",
    "width_mm",
    "largest_area_mm2",
    "largest_length_mm",
    "largest_width_mm",
    "contact_distance_mm",
    "largest_share",
    "peak",
    "mean",
    "strongest_fifth_share",
)


def contact_geometry(geometry: SkinGeometry, pressures: FloatArray) -> FloatArray:
    """The numbers named in `FEATURES` for pressures (n,) of 0 to 255 counts; zeros if untouched.

    Lengths are principal: square roots of the largest eigenvalues of the spread of the load,
    from path distances alone (classical scaling), so no plane is needed.
    """
    active, label = find_contacts(geometry, pressures)
    index = np.flatnonzero(active)
    if len(index) == 0:
        return np.zeros(len(FEATURES))
    load = pressures[index]
    areas = geometry.areas[index]
    piece = label[index]
    loads = np.bincount(piece, load)
    share = loads / load.sum()
    largest = index[piece == 0]
    whole = principal_lengths(geometry.distances, index, load)
    main = principal_lengths(geometry.distances, largest, pressures[largest])
    strongest = np.sort(load)[::-1][: max(1, len(load) // 5)]
    return np.array(
        [
            areas.sum() * MM**2,
            len(loads),
            1.0 / (share**2).sum(),
            whole[0] * MM,
            whole[1] * MM,
            geometry.areas[largest].sum() * MM**2,
            main[0] * MM,
            main[1] * MM,
            _largest_gap(geometry.distances, index, piece, load, share) * MM,
            share[0],
            load.max(),
            load.mean(),
            strongest.sum() / load.sum(),
        ]
    )


def principal_lengths(distances: FloatArray, index: IntArray, load: FloatArray) -> FloatArray:
    """(2,) standard deviations [m] of a load along its two principal directions on the skin."""
    if len(index) < 2:
        return np.zeros(2)
    weight = load / load.sum()
    squared = distances[np.ix_(index, index)] ** 2
    row = squared @ weight
    centred = -0.5 * (squared - row[:, None] - row[None, :] + weight @ row)
    root = np.sqrt(weight)
    values = np.linalg.eigvalsh(centred * np.outer(root, root))
    return np.sqrt(np.maximum(values[-2:][::-1], 0.0))


def _largest_gap(
    distances: FloatArray, index: IntArray, piece: IntArray, load: FloatArray, share: FloatArray
) -> float:
    """Largest distance [m] between the load centres of contacts that carry 5 % or more."""
    centres = []
    for contact in np.flatnonzero(share >= 0.05):
        members = index[piece == contact]
        to_all = distances[np.ix_(members, members)] @ load[piece == contact]
        centres.append(members[np.argmin(to_all)])
    return float(distances[np.ix_(centres, centres)].max()) if centres else 0.0
