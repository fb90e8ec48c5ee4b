"""What becomes of structures that were never seen."""

from __future__ import annotations

import numpy as np

from skinmap.classifiers.descriptors import adopt_nearest
from skinmap.neighbours.offsets import neighbourhoods
from skinmap.neighbours.structures import assign, find_structures


def hoods_of(points):
    up = np.tile([0.0, 0, 1], (len(points), 1))
    return neighbourhoods(points, up, np.tile([0.0, 1, 0], (len(points), 1)), radius=8e-3)


def test_taxels_of_unseen_structures_take_the_nearest_or_stay_out(tiling_12):
    flat = tiling_12[:144]
    known = find_structures(hoods_of(flat), rotations=6)
    # Stretched by a third: no neighbour is within the tolerance of its place.
    strange = hoods_of(flat * [1.35, 1.0, 1.0])
    matched = assign(strange, known.prototypes)
    adopted = adopt_nearest(strange, matched)
    before = matched.labels >= 0
    assert not before.all()
    assert (adopted.labels >= 0).all()
    np.testing.assert_array_equal(adopted.labels[before], matched.labels[before])


def test_adopting_undoes_a_forgotten_match(tiling_12):
    hoods = hoods_of(tiling_12[:144])
    known = find_structures(hoods, rotations=6)
    forgotten = type(known)(
        known.prototypes,
        np.full(144, -1),
        np.full_like(known.neighbours, -1),
        np.zeros(144, np.int64),
    )
    found = adopt_nearest(hoods, forgotten)
    # The nearest prototype of a taxel that matches one exactly is that one; a few on the edge
    # of the patch are as near to another.
    assert np.mean(found.labels == known.labels) > 0.95
    same = (found.labels == known.labels) & (found.rotation == known.rotation)
    agree = found.neighbours[same] == known.neighbours[same]
    assert agree.mean() > 0.99


def test_a_taxel_without_neighbours_stays_without_structure(tiling_12):
    known = find_structures(hoods_of(tiling_12[:144]), rotations=6)
    lonely = hoods_of(np.zeros((1, 3)))
    found = type(known)(
        known.prototypes,
        np.array([-1]),
        np.full((1, known.neighbours.shape[1]), -1),
        np.zeros(1, np.int64),
    )
    assert adopt_nearest(lonely, found).labels[0] == -1
