"""What becomes of structures that were never seen."""

from __future__ import annotations

import numpy as np
import pytest

from skinmap.neighbours import structures
from skinmap.neighbours.offsets import neighbourhoods
from skinmap.neighbours.structures import adopt_nearest, assign, find_structures


def hoods_of(points, radius=8e-3):
    up = np.tile([0.0, 0, 1], (len(points), 1))
    return neighbourhoods(points, up, np.tile([0.0, 1, 0], (len(points), 1)), radius=radius)


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


def test_a_taxel_without_neighbours_has_a_structure_too(tiling_12):
    known = find_structures(hoods_of(tiling_12[:144]), rotations=6)
    lonely = hoods_of(np.zeros((1, 3)))
    found = type(known)(
        known.prototypes,
        np.array([-1]),
        np.full((1, known.neighbours.shape[1]), -1),
        np.zeros(1, np.int64),
    )
    adopted = adopt_nearest(lonely, found)
    assert adopted.labels[0] >= 0
    assert (adopted.neighbours == -1).all()


@pytest.mark.parametrize("radius", [1e-4, 4e-3, 8e-3, 0.02, 0.06, 1.0])
@pytest.mark.parametrize("rotations", [1, 6])
def test_every_taxel_has_a_structure_at_any_radius(tiling_12, radius, rotations):
    few = tiling_12[:72]
    found = find_structures(hoods_of(few, radius), rotations=rotations)
    assert (found.labels >= 0).all()
    assert found.counts.sum() == len(few)


def test_beyond_the_patch_every_taxel_is_a_structure_of_its_own(tiling_12):
    few = tiling_12[:72]
    assert len(find_structures(hoods_of(few, 1.0), rotations=1).prototypes) == len(few)


def test_few_structures_hold_noisy_taxels_together(tiling_12, rng):
    for sigma in (0.5e-3, 1e-3, 2e-3):
        noise = rng.normal(size=tiling_12.shape) * [sigma, sigma, 0.0]
        found = find_structures(hoods_of(tiling_12 + noise, 8.8e-3), rotations=1)
        assert (found.labels >= 0).all()
        # 16 without noise; one a taxel would be the raw values under another name.
        assert len(found.prototypes) <= len(tiling_12) / 4


def test_more_shapes_than_there_may_be_are_shared(tiling_12, monkeypatch):
    monkeypatch.setattr(structures, "MAX_PROTOTYPES", 20)
    found = find_structures(hoods_of(tiling_12[:72], 1.0), rotations=1)
    assert len(found.prototypes) == 20
    assert (found.labels >= 0).all()
